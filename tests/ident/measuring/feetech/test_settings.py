"""Settings of servos: read from the bus, kept with data and model, refused in one line where they differ."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.dynamixel_bus import DynamixelBus, DynamixelServo
from examples.so101.feetech_servo import P_GAIN
from lrm_ident.measuring.servo_bus import dynamixel
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.servos import held_servos
from lrm_ident.study import api as lrm
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.lerobot_registers import settings_of
from lrm_math.arm.servo_settings import JointServoSettings, require_same_settings, settings_difference
from lrm_math.errors import LrmError
from lrm_math.model.model_file import settings_of_model
from tests.conftest import EXAMPLE
from tests.ident.measuring.feetech.test_feetech_servos import BusLine, held, line_of

SETTINGS = st.builds(JointServoSettings, p=st.none() | st.integers(0, 254), d=st.none() | st.integers(0, 254))


def test_feetech_servos_say_how_they_are_set() -> None:
    line = line_of(1, 2, 3, 4, 5)
    P_GAIN.write(line.bus.servos[1].memory, 16)
    found = held(line).settings()
    assert found["shoulder_lift"] == JointServoSettings(
        p=16, i=0, d=32, torque_limit=1000, return_delay_us=0, firmware="3.10"
    )
    assert found["elbow_flex"].p == 32


def test_dynamixel_servos_say_how_they_are_set() -> None:
    servos = [DynamixelServo(number) for number in range(1, 6)]
    dynamixel.P_GAIN.write(servos[0].control, 640)
    line = BusLine(DynamixelBus(servos))  # type: ignore[arg-type]
    found = held_servos("dynamixel:/dev/x", ServoHost(line, dynamixel.DYNAMIXEL), load_arm("so101"), (1, 2, 3, 4, 5))
    assert found.settings()["shoulder_pan"].p == 640


@given(st.dictionaries(st.sampled_from(["a", "b"]), SETTINGS), st.dictionaries(st.sampled_from(["a", "b"]), SETTINGS))
def test_only_what_differs_is_said(now: dict[str, JointServoSettings], then: dict[str, JointServoSettings]) -> None:
    assert settings_difference(now, now) == ""
    assert bool(settings_difference(now, then)) == bool(settings_difference(then, now))
    if not settings_difference(now, then):
        require_same_settings(now, then, "m.toml", "--accept")
        return
    with pytest.raises(LrmError, match="the servos are not set as in") as caught:
        require_same_settings(now, then, "m.toml", "--accept")
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_settings_go_from_the_data_into_the_model(tmp_path: Path) -> None:
    data = tmp_path / "data.csv"
    data.write_text(EXAMPLE.read_text())
    data.with_suffix(".toml").write_text(EXAMPLE.with_suffix(".toml").read_text() + "\n[servos.joint2]\np = 16\n")
    measured = lrm.load(data)
    Study.of(measured, "compliance").fit().save(tmp_path / "model.toml")
    assert settings_of_model(tmp_path / "model.toml") == {"joint2": JointServoSettings(p=16)}


class LeRobotBus:
    """Registers of a LeRobot bus, by its names."""

    model_ctrl_table = {"sts3215": dict.fromkeys(["P_Coefficient", "Return_Delay_Time", "Firmware_Major_Version"])}
    motors = {"shoulder_pan": type("Motor", (), {"model": "sts3215"})}

    def read(self, register: str, motor: str, normalize: bool = True) -> int:
        assert not normalize
        assert motor in self.motors
        return {"P_Coefficient": 16, "Return_Delay_Time": 250}[register]


def test_lerobots_registers_are_the_same_settings() -> None:
    assert settings_of(LeRobotBus(), ["shoulder_pan"]) == {
        "shoulder_pan": JointServoSettings(p=16, return_delay_us=500)
    }
    assert settings_of(object(), ["shoulder_pan"]) == {}
