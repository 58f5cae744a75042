"""Units of a LeRobot robot's joints: degrees, or −100 … 100 over the range that its calibration swept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

DEGREES, SYMMETRIC = "degrees", "range_m100_100"
"""Values of LeRobot's `MotorNormMode`."""


def radians_per_unit(robot: Any, names: Sequence[str]) -> Array:
    """(n,), of a connected robot's joints; their zero is the middle of the range. Raises `LrmError`.

    A robot without a motor bus is taken to speak degrees, as LeRobot's do.
    """
    bus = getattr(robot, "bus", None)
    motors = getattr(bus, "motors", None)
    if not motors:
        return np.full(len(names), math.radians(1.0))
    return np.array([_of_motor(bus, name) for name in names])


def _of_motor(bus: Any, name: str) -> float:
    if name not in bus.motors:
        raise LrmError(f"the robot's bus has no motor '{name}'; it has {', '.join(bus.motors)}")
    motor = bus.motors[name]
    mode = getattr(motor.norm_mode, "value", motor.norm_mode)
    if mode == DEGREES:
        return math.radians(1.0)
    if mode != SYMMETRIC:
        raise LrmError(f"motor '{name}' is commanded in {mode}; a joint should be in {DEGREES} or {SYMMETRIC}")
    swept = bus.calibration.get(name)
    if swept is None or swept.range_max <= swept.range_min:
        raise LrmError(f"motor '{name}' has no calibrated range; calibrate the robot first (lerobot-calibrate)")
    steps = bus.model_resolution_table[motor.model] - 1
    half = 0.5 * (swept.range_max - swept.range_min) * 2.0 * math.pi / steps
    inverted = bus.apply_drive_mode and swept.drive_mode
    return float(-half if inverted else half) / 100.0
