"""Units of LeRobot's joints, by stand-ins for its robots."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from lerobot_robot_lrm.units import radians_per_unit
from lrm_math.errors import LrmError


def robot(mode: str, drive_mode: int = 0, swept: tuple[int, int] = (1024, 3072)) -> SimpleNamespace:
    """A robot with one motor of 4096 steps, as LeRobot's `SerialMotorsBus` describes it."""
    motor = SimpleNamespace(norm_mode=SimpleNamespace(value=mode), model="sts3215")
    calibration = {"pan": SimpleNamespace(range_min=swept[0], range_max=swept[1], drive_mode=drive_mode)}
    table = {"sts3215": 4096}
    bus = SimpleNamespace(
        motors={"pan": motor}, calibration=calibration, model_resolution_table=table, apply_drive_mode=True
    )
    return SimpleNamespace(bus=bus)


def test_degrees_and_the_swept_range() -> None:
    assert radians_per_unit(robot("degrees"), ["pan"])[0] == math.radians(1.0)
    half = 1024 * 2.0 * math.pi / 4095
    assert radians_per_unit(robot("range_m100_100"), ["pan"])[0] == pytest.approx(half / 100.0)
    assert radians_per_unit(robot("range_m100_100", drive_mode=1), ["pan"])[0] == pytest.approx(-half / 100.0)
    assert radians_per_unit(SimpleNamespace(), ["pan"])[0] == math.radians(1.0)


@pytest.mark.parametrize(
    ("made", "name", "said"),
    [
        (robot("degrees"), "lift", "no motor 'lift'; it has pan"),
        (robot("range_0_100"), "pan", "range_0_100; a joint should be in degrees or range_m100_100"),
        (robot("range_m100_100", swept=(5, 5)), "pan", "calibrate the robot first"),
    ],
)
def test_what_is_no_joint_is_one_clear_line(made: SimpleNamespace, name: str, said: str) -> None:
    with pytest.raises(LrmError, match=said) as raised:
        radians_per_unit(made, [name])
    assert "\n" not in str(raised.value)
