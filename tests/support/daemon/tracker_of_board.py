"""A tracker's datagrams of where a simulated board says that the tip is, with noise, and garbage between the frames."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count

import numpy as np

from examples.demo.simulated_tracker import dtrack_text
from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame
from lrmd.sim.control_socket import ControlError
from tests.support.background import repeated
from tests.support.daemon.daemon_process import BoardProcess

FRAME_S = 0.02


@contextmanager
def tracker_of(board: BoardProcess, port: int) -> Iterator[None]:
    """Sends to a UDP port of this machine until the block ends; a frame that the board is too busy for is left out."""
    numbers, rng = count(1), np.random.default_rng(0)

    def send() -> None:
        with suppress(ControlError):
            found = board.ask("tcp")
            tip = np.array([float(str(found[axis])) for axis in ("x_mm", "y_mm", "z_mm")]) * 1e-3
            targets = {0: TargetPose(np.zeros(3), np.eye(3))}
            targets[1] = TargetPose(tip + rng.normal(scale=1e-4, size=3), np.eye(3))
            sender.sendto(rng.bytes(50), ("127.0.0.1", port))
            sender.sendto(dtrack_text(TrackerFrame(next(numbers), time.monotonic(), targets)), ("127.0.0.1", port))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, repeated(send, FRAME_S):
        yield
