"""Zero offsets in the files of servos: what a joint reads is where it stands, by each reader's own rule."""

from __future__ import annotations

import json
import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.robot_files.lerobot_calibration import (
    MotorCalibration,
    calibration_text,
    corrected,
    joint_config_text,
)
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.model.model import Model, model_of
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import examples

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
COUNT = 2.0 * math.pi / 4096.0
MODEL = """\
schema = "lrm/model/1"
arm = "so101"
effects = ["offsets", "compliance@joint2"]
[parameters]
"offsets.joint2.theta_rad" = 0.05
"offsets.joint3.theta_rad" = -0.02
"offsets.joint3.a_mm" = 1.0
"compliance.joint2.k_rad_per_Nm" = 0.03
"""
XACRO = """\
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="so101">
  <!-- mine -->
  <xacro:macro name="control" params="prefix">
    <ros2_control name="so101" type="system">
      <hardware><plugin>{plugin}</plugin><param name="usb_port">/dev/ttyACM0</param></hardware>
      {joints}
    </ros2_control>
  </xacro:macro>
</robot>
"""


def model_with(**offsets: float) -> Model:
    arm = load_arm("so101")
    return model_of(arm, effects_at(arm, "offsets"), {f"offsets.{j}.theta_rad": v for j, v in offsets.items()})


def calibration_file(folder: Path, **changes: object) -> Path:
    motor = {"id": 1, "drive_mode": 0, "homing_offset": 100, "range_min": 900, "range_max": 3100}
    motors = {name: {**motor, "id": number} for number, name in enumerate((*JOINTS, "gripper"), start=1)}
    motors["wrist_roll"] |= {"range_min": 0, "range_max": 4095}
    motors["elbow_flex"] |= changes
    path = folder / "mine.json"
    path.write_text(json.dumps(motors))
    return path


def lerobot_reads(motor: MotorCalibration, encoder: float) -> float:
    """LeRobot's angle (rad) in degrees mode of an encoder's count; `_normalize` of its motors_bus.py."""
    return (encoder - motor.homing_offset - (motor.range_min + motor.range_max) / 2.0) * 2.0 * math.pi / 4095.0


@pytest.mark.long
@examples(15, 30)
@given(offsets=st.lists(st.floats(-0.3, 0.3), min_size=5, max_size=5), encoder=st.integers(0, 4095))
def test_lerobot_reads_it_true(tmp_path_factory: pytest.TempPathFactory, offsets: list[float], encoder: int) -> None:
    path = calibration_file(tmp_path_factory.mktemp("calibration"))
    model = model_with(**{f"joint{i}": value for i, value in enumerate(offsets, start=1)})
    before, after = corrected(path, model_with()), corrected(path, model)
    for name, offset in zip(JOINTS, offsets, strict=True):
        told = lerobot_reads(after[name], encoder) - lerobot_reads(before[name], encoder)
        assert told == pytest.approx(offset, abs=0.51 * COUNT)
        assert after[name].range_max - after[name].range_min == before[name].range_max - before[name].range_min
        assert 0 <= after[name].range_min < after[name].range_max <= 4095
    assert after["gripper"] == before["gripper"]
    assert json.loads(calibration_text(after))["elbow_flex"]["id"] == 3


def test_the_driver_of_ros_reads_the_same_angle_from_its_own_zero(tmp_path: Path) -> None:
    path = calibration_file(tmp_path)
    motors = corrected(path, model_with(joint2=0.05))
    lines = joint_config_text(path, motors).splitlines()
    assert lines[0] == "joints:"
    start = lines.index("  shoulder_lift:")
    numbers = {key: int(value) for key, value in (line.strip().split(": ") for line in lines[start + 1 : start + 5])}
    for encoder in (1200, 2100, 3000):
        driver = (encoder - numbers["homing_offset"] - 2048) * COUNT
        assert driver == pytest.approx(lerobot_reads(motors["shoulder_lift"], encoder), abs=2.0 * COUNT)
    assert numbers["range_max"] - numbers["range_min"] == 2200


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"range_max": 900}, "elbow_flex.range_min: from 900 to 900"),
        ({"range_max": "many"}, "elbow_flex.range_max: many; should be a whole number"),
        ({"drive_mode": 1}, "drive_mode 1 turns"),
        ({"range_min": 0, "range_max": 4095, "homing_offset": -2047}, "has room for"),
    ],
)
def test_a_calibration_beyond_repair_is_one_line(tmp_path: Path, changes: dict[str, object], said: str) -> None:
    (tmp_path / "model.toml").write_text(MODEL.replace('joint3.theta_rad" = -0.02', 'joint3.theta_rad" = 0.02'))
    path, out = calibration_file(tmp_path, **changes), tmp_path / "out.json"
    assert said in stderr_of("arm", "export", tmp_path / "model.toml", "--calibration", path, "-o", out)
    assert not out.exists()


def test_the_command_lists_what_a_calibration_cannot_hold(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    path, out = calibration_file(tmp_path), tmp_path / "out.json"
    said = stdout_of("arm", "export", tmp_path / "model.toml", "--calibration", path, "-o", out)
    assert "offsets@joint3 (its lengths and angles; its zero is)" in " ".join(said.split())
    assert "compliance@joint2" in said
    assert json.loads(out.read_text())["shoulder_lift"]["range_min"] == 900 - round(0.05 * 4095 / (2.0 * math.pi))
    ur5 = stderr_of("arm", "export", "ur5", "--calibration", path, "-o", out)
    assert "no joint" in ur5
    assert "name it .json, .yaml" in stderr_of(
        "arm", "export", "so101", "--calibration", path, "-o", tmp_path / "o.xml"
    )


def xacro(folder: Path, plugin: str, *params: str) -> Path:
    joints = "".join(f'<joint name="${{prefix}}{name}">{"".join(params)}</joint>' for name in JOINTS)
    path = folder / "control.xacro"
    path.write_text(XACRO.format(plugin=plugin, joints=joints))
    return path


def parameters(path: Path, joint: str) -> dict[str, str]:
    (element,) = (e for e in ElementTree.parse(path).iter("joint") if (e.get("name") or "").endswith(joint))
    return {param.get("name") or "": param.text or "" for param in element.findall("param")}


def test_offsets_as_the_drivers_read_them(tmp_path: Path) -> None:
    """Dynamixel: joint = motor − offset, rad, any finite number. Feetech: counts, whole numbers (std::stoi)."""
    (tmp_path / "model.toml").write_text(MODEL)
    out = tmp_path / "out.xacro"
    dynamixel = xacro(tmp_path, "dynamixel_hardware/DynamixelHardware", '<param name="id">7</param>')
    stdout_of("arm", "export", tmp_path / "model.toml", "--ros2-control", dynamixel, "-o", out)
    assert parameters(out, "shoulder_lift") == {"id": "7", "offset": "-0.05"}
    assert float(parameters(out, "shoulder_pan")["offset"]) == 0.0
    assert "<!-- mine -->" in out.read_text()
    assert "<xacro:macro" in out.read_text()
    feetech = "feetech_ros2_driver/FeetechHardwareInterface"
    plain = xacro(tmp_path, feetech, '<param name="offset">2048</param>')
    stdout_of("arm", "export", tmp_path / "model.toml", "--ros2-control", plain, "-o", out)
    assert parameters(out, "shoulder_lift") == {"offset": str(2048 - 33)}
    homing = xacro(tmp_path, feetech, '<param name="homing_offset">-10</param><param name="range_min">900</param>')
    stdout_of("arm", "export", tmp_path / "model.toml", "--ros2-control", homing, "-o", out)
    assert parameters(out, "shoulder_lift") == {"homing_offset": "-43", "range_min": "933"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("plugin", "param", "said"),
    [
        ("mock_components/GenericSystem", "", "its driver is mock_components/GenericSystem"),
        ("feetech_ros2_driver/FeetechHardwareInterface", "", "neither offset nor homing_offset"),
        (
            "feetech_ros2_driver/FeetechHardwareInterface",
            '<param name="offset">${zero}</param>',
            "expand a xacro expression first",
        ),
    ],
)
def test_a_description_without_offsets_is_one_line(tmp_path: Path, plugin: str, param: str, said: str) -> None:
    path, out = xacro(tmp_path, plugin, param), tmp_path / "out.xacro"
    assert said in stderr_of("arm", "export", "so101", "--ros2-control", path, "-o", out)
    path.write_text("<robot name='x'/>")
    assert "no <ros2_control> in it" in stderr_of("arm", "export", "so101", "--ros2-control", path, "-o", out)


def test_a_calibration_of_an_older_lerobot_is_named(tmp_path: Path) -> None:
    path = tmp_path / "main_follower.json"
    path.write_text(
        '{"homing_offset": [2048, -1024], "drive_mode": [0, 1], "motor_names": ["shoulder_pan", "gripper"]}'
    )
    said = stderr_of("arm", "export", "so101", "--calibration", path, "-o", tmp_path / "out.json")
    assert "a calibration of an older LeRobot" in said
