"""A simulated ART tracker: asks the simulated board where the servos stand, and sends where the true tip is.

The tip is that of the independent generator, with its hidden effect; nothing of the fitted model's code is in it. The
targets are seen at rest only. Every rest has an error of its own, as a tracker's errors depend on the place, and every
frame a further one. `python -m examples.demo.simulated_tracker BOARD PORT SEED` runs it until it is ended.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from examples.demo.hidden import hidden_arm
from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrmd.sim.control_socket import ControlError, query_board
from validation.synthetic import ArmDescription, GroundTruth, Schedule, load_arm, true_state
from validation.synthetic.example import ARM_FILE

REST_SD_M, FRAME_SD_M = 0.0002, 0.0001
"""Per axis: error of a rest, and of a frame beside it. Together below the 0.5 mm of Conenna 2024, section 5.3."""
FRAME_S = 0.015
DAY_S = 86400.0
"""s of the computer's clock between frames."""
STILL = 1e-9
"""rad."""
BASE, TOOL = 0, 1
BASE_IN_ROOM = TargetPose(
    np.array([0.812, -0.344, 0.951]),
    np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]),
)
"""Where the base target stands in the tracker's room: level, turned about the vertical."""


@dataclass(frozen=True, eq=False)
class BoardState:
    """State of the board: servo angles (n,) in rad, load (kg), its time (s), power-on session; has it pulses?"""

    q: Array
    payload: float
    t: float
    session: int
    pulses: bool = True

    @classmethod
    def of(cls, board: Path, joints: int) -> BoardState:
        """Asks the board at its link. Raises `ControlError`."""
        servos, status = query_board(board, "joints"), query_board(board, "status")
        q = np.radians([servos[f"joint{i + 1}"]["angle_deg"] for i in range(joints)])  # type: ignore[index]
        numbers = {name: float(str(status[name])) for name in ("payload_g", "t_s", "session")}
        pulses = any(width is not None for width in status["pulse_us"])  # type: ignore[attr-defined]
        return cls(q, numbers["payload_g"] * 1e-3, numbers["t_s"], int(numbers["session"]), pulses)

    def same(self, other: BoardState | None) -> bool:
        """Whether the arm has not moved and carries the same."""
        return other is not None and self.payload == other.payload and float(np.abs(self.q - other.q).max()) < STILL


def true_tip(arm: ArmDescription, truth: GroundTruth, rest: BoardState, warming_s: float = 0.0) -> Array:
    """(3,), true tip (m) at a rest, in the frame of the arm, which has power since `warming_s`.

    No effect of `truth` remembers where the arm was.
    """
    schedule = Schedule(np.array([warming_s]), np.array([float(rest.session)]), rest.q)
    return np.asarray(true_state(arm, truth, rest.q[None], rest.payload, schedule).tcp_m[0])


def in_room(tip: Array) -> TargetPose:
    """The tool's target in the tracker's room, for a tip in the frame of the base target."""
    return TargetPose(BASE_IN_ROOM.position + BASE_IN_ROOM.rotation @ tip, BASE_IN_ROOM.rotation)


def frames(board: Path, arm: ArmDescription, truth: GroundTruth, seed: int) -> Iterator[TrackerFrame]:
    """One frame after the other, by the board's time, for as long as it answers; then raises `ControlError`.

    The arm warms up by the computer's time since its servos have pulses, as the daemon takes it.
    """
    rng, cold = np.random.default_rng([seed, 99]), time.monotonic()
    before: BoardState | None = None
    rest: BoardState | None = None
    tip = np.zeros(3)
    for number in count(1):
        seen = BoardState.of(board, len(arm.links))
        cold = cold if seen.pulses else time.monotonic()
        targets = {BASE: BASE_IN_ROOM}
        if seen.same(before):
            if not seen.same(rest):
                rest = seen
                tip = true_tip(arm, truth, rest, time.monotonic() - cold) + rng.normal(scale=REST_SD_M, size=3)
            targets[TOOL] = in_room(tip + rng.normal(scale=FRAME_SD_M, size=3))
        before = seen
        yield TrackerFrame(number, seen.t, targets)


def dtrack_text(frame: TrackerFrame) -> bytes:
    """A frame as DTrack sends it; the three angles, which nobody should use, are zero."""
    targets = "".join(_target_text(number, pose) for number, pose in sorted(frame.targets.items()))
    head = f"fr {frame.number}\nts {frame.t:.6f}\n6dcal {len(frame.targets)}\n"
    return f"{head}6d {len(frame.targets)} {targets.strip()}\n".encode("ascii")


def _target_text(number: int, pose: TargetPose) -> str:
    x, y, z = (f"{value / MM:.3f}" for value in pose.position)
    turn = " ".join(f"{value:.6f}" for value in pose.rotation.T.ravel())
    return f"[{number} 1.000][{x} {y} {z} 0.0000 0.0000 0.0000][{turn}] "


def track(truth_of: Callable[[ArmDescription, int], GroundTruth]) -> None:
    """Sends frames of the arm that a seed makes until the board or the parent process ends; from the command line."""
    arm = load_arm(ARM_FILE)
    send(lambda board, seed: frames(board, arm, truth_of(arm, seed), seed))


def send(frames_of: Callable[[Path, int], Iterator[TrackerFrame]]) -> None:
    """Sends the frames of a board and a seed until the board or the parent process ends; from the command line.

    They carry the computer's time, by which the daemon follows what time changes, not that of a board that runs faster.
    """
    board, port, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    sender, parent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), os.getppid()
    with suppress(ControlError, KeyboardInterrupt):
        for frame in frames_of(board, seed):
            sender.sendto(dtrack_text(replace(frame, t=time.time() % DAY_S)), ("127.0.0.1", port))
            time.sleep(FRAME_S)
            if os.getppid() != parent:
                return


if __name__ == "__main__":
    track(lambda arm, seed: hidden_arm(arm, seed).truth)
