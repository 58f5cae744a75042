"""Settling of an arm between poses that are driven to one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.settling import Settling, settling

SPEED, WITHIN = np.radians(30.0), 1e-4
"""rad/s at which poses are driven to, and m within which a tip stands still."""


def settling_times(
    model: MotionModel, poses: Sequence[Sequence[float]], speed_deg: float | None = None, within: float = WITHIN
) -> list[Settling]:
    """Settling at every pose (rad) after the first; `speed_deg`: deg/s of the fastest joint."""
    speed = SPEED if speed_deg is None else float(np.radians(speed_deg))
    angles = [np.array(pose) for pose in poses]
    return [settling(model, a, b, speed, within) for a, b in pairwise(angles)]


def longest(times: Sequence[Settling]) -> Settling:
    """The longest of all; none: no time."""
    return max(times, key=lambda times: times.seconds, default=Settling(0.0, 0))
