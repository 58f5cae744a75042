"""Zeros of a model's joints, which files of servos can hold: LeRobot's calibration file, and that of a ROS 2 driver.

LeRobot reads an angle as (count − middle of the range) · 2π/4095, count = encoder − homing offset. A joint that stands
at δ where it reads zero is put right by a range that lies δ lower, both of its ends alike: its width, and so what
−100 … 100 mean, stays. Where that range would leave the turn (LeRobot gives a joint without stops the whole of it), the
homing offset takes it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from lrm_ident.data.robot_files.urdf_export import zero_offset
from lrm_ident.data.wording import joint_labels
from lrm_math.effects import ParameterRef
from lrm_math.errors import FileError, name_suggestion
from lrm_math.model.model import Model
from lrm_math.text_file import read_json

COUNTS = 4096
"""Counts of one turn of an encoder (STS3215, XL330)."""
PER_RAD = (COUNTS - 1) / (2.0 * math.pi)
"""LeRobot's counts per rad."""
MOST_HOMING = 2047
"""Largest number that a servo's register holds."""
DRIVER_ZERO = COUNTS // 2
"""Count that the Feetech driver of ROS 2 takes for zero."""


ZERO = "theta_rad"


def zero_offsets(model: Model) -> dict[str, float]:
    """Angle of each joint where it is commanded zero (rad), names as in the robot's own description."""
    return {name: zero_offset(model, model.chain, i) for i, name in enumerate(joint_labels(model.arm))}


def beyond_zeros(model: Model) -> tuple[str, ...]:
    """Effects of a model, `effect@place`, that are more than zero offsets of joints."""
    out = []
    for effect, values in model.parts():
        rigid = effect.id == "offsets" and effect.place in model.arm.joint_names
        kept = [value for key, value in zip(effect.keys, values, strict=True) if ParameterRef.parse(key).name != ZERO]
        if not rigid:
            out.append(effect.name)
        elif any(kept):
            out.append(f"{effect.name} (its lengths and angles; its zero is)")
    return tuple(out)


def check_names(path: Path, model: Model, have: Iterable[str]) -> None:
    """Raises `FileError` where a file lacks one of the model's joints."""
    labels = list(have)
    for name in zero_offsets(model):
        if name not in labels:
            raise FileError(path, "", f"no joint '{name}'", name_suggestion(name, labels))


@dataclass(frozen=True)
class MotorCalibration:
    """One motor: numbers as in LeRobot's file, counts."""

    id: int
    drive_mode: int
    homing_offset: int
    range_min: int
    range_max: int

    @property
    def middle(self) -> float:
        """The count that is read as zero."""
        return 0.5 * (self.range_min + self.range_max)


def read_calibration(path: Path) -> dict[str, MotorCalibration]:
    """A calibration file that `lerobot-calibrate` wrote. Raises `FileError`."""
    tables = read_json(path, "lerobot-calibrate writes it")
    if not isinstance(tables, dict) or not tables:
        raise FileError(path, "", "is no calibration of LeRobot", '{"shoulder_pan": {"id": 1, …}, …}')
    if "motor_names" in tables:
        what = "a calibration of an older LeRobot, a list of each quantity by motor_names"
        raise FileError(
            path, "", what, "calibrate with LeRobot 0.3 or newer: lerobot-calibrate writes one table a motor"
        )
    return {name: _motor(path, name, table) for name, table in tables.items()}


def _motor(path: Path, name: str, table: object) -> MotorCalibration:
    wanted = [field.name for field in fields(MotorCalibration)]
    numbers = table if isinstance(table, dict) else {}
    for key in wanted:
        if type(numbers.get(key)) is not int:
            raise FileError(path, f"{name}.{key}", f"{numbers.get(key, 'missing')}", "should be a whole number")
    motor = MotorCalibration(*(numbers[key] for key in wanted))
    if motor.range_min >= motor.range_max:
        what = f"from {motor.range_min} to {motor.range_max}"
        raise FileError(path, f"{name}.range_min", what, "calibrate it again: lerobot-calibrate")
    return motor


def corrected(path: Path, model: Model) -> dict[str, MotorCalibration]:
    """The motors of a file with the zeros of a model. Raises `FileError`: a motor is missing, or turned about."""
    motors = read_calibration(path)
    check_names(path, model, motors)
    for name, offset in zero_offsets(model).items():
        if motors[name].drive_mode:
            what = "drive_mode 1 turns −100 … 100 about but not degrees"
            raise FileError(path, name, what, "calibrate with drive_mode 0")
        motors[name] = _shifted(path, name, motors[name], round(offset * PER_RAD))
    return motors


def _shifted(path: Path, name: str, motor: MotorCalibration, counts: int) -> MotorCalibration:
    low, high, homing = motor.range_min - counts, motor.range_max - counts, motor.homing_offset - counts
    if low >= 0 and high < COUNTS:
        return replace(motor, range_min=low, range_max=high)
    if abs(homing) <= MOST_HOMING:
        return replace(motor, homing_offset=homing)
    what = f"its zero is {counts} counts off, which neither its range nor its homing offset has room for"
    raise FileError(path, name, what, "calibrate it again with the joint in the middle of its range")


def calibration_text(motors: Mapping[str, MotorCalibration]) -> str:
    """Text of LeRobot's file."""
    return json.dumps({name: asdict(motor) for name, motor in motors.items()}, indent=4) + "\n"


def joint_config_text(path: Path, motors: Mapping[str, MotorCalibration]) -> str:
    """Text of the file `joint_config_file` of the driver feetech_ros2_driver, whose zero is count 2048.

    Raises `FileError`: a homing offset that a servo has no room for.
    """
    lines = ["joints:"]
    for name, motor in motors.items():
        counts = round(motor.middle) - DRIVER_ZERO
        homing = motor.homing_offset + counts
        if abs(homing) > MOST_HOMING:
            raise FileError(path, name, f"zero at count {motor.middle:g} has no homing offset", "calibrate it again")
        low, high = max(motor.range_min - counts, 0), min(motor.range_max - counts, COUNTS - 1)
        lines += [f"  {name}:", f"    id: {motor.id}", f"    homing_offset: {homing}"]
        lines += [f"    range_min: {low}", f"    range_max: {high}"]
    return "\n".join(lines) + "\n"
