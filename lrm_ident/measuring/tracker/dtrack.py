"""A tracker that sends ART DTrack's ASCII output, one UDP datagram a frame: `fr` (frame), `ts` (time), `6d` (targets).

    fr 21753
    ts 39596.024831
    6d 1 [0 1.000][326.848 -187.216 109.503 -160.5 15.5 148.0][r11 r21 r31 r12 r22 r32 r13 r23 r33]

`6d` gives the number of targets; for each its number and quality, its position in mm with three angles in deg (not
used), and its rotation matrix by columns. Targets that are not seen are left out, or have a negative quality. Other
lines are ignored.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager

import numpy as np

from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame
from lrm_math.arm.arm_file import MM
from lrm_math.errors import LrmError

LONGEST = 65_536
"""Bytes of a datagram."""
TARGET = re.compile(r"\[\s*(\d{1,6})\s+(\S+)\s*\]\s*\[([^\[\]]*)\]\s*\[([^\[\]]*)\]\s*")
FARTHEST = 1e3
"""m; a position beyond it is a fault of the line."""
RIGID = 1e-2
"""Largest deviation of R R^T from the identity: a matrix printed with three digits still passes."""
FLOOD = 100_000
"""Datagrams of one rest after which it ends: a port that is flooded must not hold the campaign."""


class UdpTracker(AbstractContextManager["UdpTracker"]):
    """Listens on a port of an address; what is no frame is ignored."""

    def __init__(self, host: str, port: int) -> None:
        """Raises `LrmError` if the port cannot be had."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise LrmError(f"tracker {host}:{port}: cannot listen there ({error.strerror})") from None

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    @property
    def port(self) -> int:
        """The port, also where 0 was requested."""
        return int(self._socket.getsockname()[1])

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`."""
        self._drain()
        came = map(parse_dtrack, self._datagrams(time.monotonic() + seconds))
        return [frame for frame in came if frame is not None]

    def _drain(self) -> None:
        """Takes what arrived before, without looking at it."""
        for _ in self._datagrams(0.0):
            pass

    def _datagrams(self, end: float) -> Iterator[bytes]:
        """Datagrams that come until a time (monotonic s), and those that wait there then: computers are late."""
        for _ in range(FLOOD):
            self._socket.settimeout(max(0.0, end - time.monotonic()))
            try:
                yield self._socket.recv(LONGEST)
            except (TimeoutError, BlockingIOError):
                return
            except OSError:
                continue


def parse_dtrack(data: bytes) -> TrackerFrame | None:
    """The frame of one datagram; None for anything that is not one, whatever it is.

    A frame without `ts` has no time and is not used; a target whose numbers make no pose counts as not seen.
    """
    try:
        lines = data[:LONGEST].decode("ascii").splitlines()
    except UnicodeDecodeError:
        return None
    fields = dict(reversed([(word, rest) for word, _, rest in (line.strip().partition(" ") for line in lines)]))
    number, t, seen = fields.get("fr", "").strip(), _numbers(fields.get("ts", ""), 1), fields.get("6d")
    if not re.fullmatch(r"\d{1,18}", number, re.ASCII) or t is None or seen is None:
        return None
    count, _, rest = seen.strip().partition(" ")
    matches = TARGET.findall(rest)
    if count != str(len(matches)) or TARGET.sub("", rest.strip()):
        return None
    targets = {int(name): _target(quality, place, turn) for name, quality, place, turn in matches}
    return TrackerFrame(int(number), t[0], {name: pose for name, pose in targets.items() if pose is not None})


def _target(quality: str, at: str, turn: str) -> TargetPose | None:
    quality_values, position, rotation = _numbers(quality, 1), _numbers(at, 6), _numbers(turn, 9)
    if quality_values is None or quality_values[0] < 0.0 or position is None or rotation is None:
        return None
    place, R = np.array(position[:3]) * MM, np.array(rotation).reshape(3, 3).T
    near, rigid = np.abs(place).max() < FARTHEST, np.abs(R @ R.T - np.eye(3)).max() < RIGID
    return TargetPose(place, R) if near and rigid and np.linalg.det(R) > 0.0 else None


def _numbers(text: str, count: int) -> list[float] | None:
    """So many finite numbers, or None."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return None
    return values if len(values) == count and all(abs(value) < 1e12 for value in values) else None
