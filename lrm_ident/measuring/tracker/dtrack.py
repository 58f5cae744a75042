"""ART DTrack's ASCII output, one UDP datagram a frame: lines `fr` (frame), `ts` (time), `6d` (targets).

    fr 21753
    ts 39596.024831
    6d 1 [0 1.000][326.848 -187.216 109.503 -160.5 15.5 148.0][r11 r21 r31 r12 r22 r32 r13 r23 r33]

`6d` gives the number of targets; for each its number and quality, its position in mm with three angles in deg (not
used), and its rotation matrix by columns. Targets that are not seen are left out, or have a negative quality. Other
lines are ignored.
"""

from __future__ import annotations

import math
import re

import numpy as np

from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame, is_rotation
from lrm_math.arm.arm_file import MM

LONGEST = 65_536
"""Bytes of a datagram."""
TARGET = re.compile(r"\[\s*(\d{1,6})\s+(\S+)\s*\]\s*\[([^\[\]]*)\]\s*\[([^\[\]]*)\]\s*")
FARTHEST = 1e3
"""m; a position beyond it is a fault of the line."""


def parse_dtrack(data: bytes) -> TrackerFrame | None:
    """The frame of one datagram; None for anything that is not one, whatever it is.

    A frame without `ts` has no time and is not used; a target whose numbers make no pose counts as not seen.
    """
    try:
        lines = data[:LONGEST].decode("ascii").splitlines()
    except UnicodeDecodeError:
        return None
    fields = dict(reversed([(word, rest) for word, _, rest in (line.strip().partition(" ") for line in lines)]))
    number, time, seen = fields.get("fr", "").strip(), _number(fields.get("ts", "")), fields.get("6d")
    if not re.fullmatch(r"\d{1,18}", number, re.ASCII) or time is None or seen is None:
        return None
    count, _, rest = seen.strip().partition(" ")
    found = TARGET.findall(rest)
    if count != str(len(found)) or TARGET.sub("", rest.strip()):
        return None
    targets = {int(name): _target(quality, place, turn) for name, quality, place, turn in found}
    return TrackerFrame(int(number), time, {name: pose for name, pose in targets.items() if pose is not None})


def _target(quality: str, place: str, turn: str) -> TargetPose | None:
    known, position, rotation = _number(quality), _numbers(place, 6), _numbers(turn, 9)
    if known is None or known < 0.0 or position is None or rotation is None:
        return None
    pose = TargetPose(np.array(position[:3]) * MM, np.array(rotation).reshape(3, 3).T)
    near = bool(np.abs(pose.position).max() < FARTHEST)
    return pose if near and is_rotation(pose.rotation) else None


def _numbers(text: str, count: int) -> list[float] | None:
    values = [_number(word) for word in text.split()]
    good = [value for value in values if value is not None]
    return good if len(good) == len(values) == count else None


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) and abs(value) < 1e12 else None
