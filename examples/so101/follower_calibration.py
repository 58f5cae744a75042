"""LeRobot's calibration file of the simulated SO-101: its zeros are the middle of its encoders, nothing is swept."""

from __future__ import annotations

from pathlib import Path

from examples.so101.hidden_arm import ARM_FILE, GRIPPER
from lrm_ident.data.robot_files.lerobot_calibration import COUNTS, MotorCalibration, calibration_text
from lrm_math.arm.arm_file import read_arm
from lrm_math.errors import FileError


def write_calibration(path: Path) -> None:
    """Writes the file `ID.json`, and its folder. Raises `FileError` over a file with another content."""
    names = [*(joint.name for joint in read_arm(ARM_FILE).joints), "gripper"]
    motors = {name: MotorCalibration(i, 0, 0, 0, COUNTS - 1) for i, name in enumerate(names, start=1)}
    assert motors["gripper"].id == GRIPPER
    text = calibration_text(motors)
    try:
        if path.exists() and path.read_text(encoding="utf-8") != text:
            raise FileError(path, "", "is another calibration", "name another file")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "", "cannot be written", str(error)) from None
