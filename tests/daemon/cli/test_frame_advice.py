"""`lrm deploy` and `lrm info` advise the frequency at which waits of `timed` moves hit the board's frames."""

from __future__ import annotations

import pytest

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arm.servo_table import PwmClock
from lrmd.cli.text import frame_advice, shaping_text
from tests.daemon.cli.test_servo_calibration import FakeRover


def told(pwm_hz: float, shaping: str) -> str:
    info = FakeRover().info()
    return shaping_text(info.model_copy(update={"pwm_hz": pwm_hz, "shaping": shaping, "motion_model": "motion.toml"}))


@pytest.mark.parametrize(("pwm_hz", "shaping", "advised"), [
    (50.0, "timed", "pwm_hz = 51.28"), (50.0, "off", "shaping = 'timed'\na frame"), (330.0, "off", "shaping = 'zv'"),
])  # fmt: skip
def test_it_advises_what_leaves_less_swing(pwm_hz: float, shaping: str, advised: str) -> None:
    assert advised in told(pwm_hz, shaping)


@pytest.mark.parametrize("oscillator_hz", [23e6, 25e6, 26.4e6])
def test_what_it_advises_is_advised_once(oscillator_hz: float) -> None:
    info = FakeRover().info()
    reached = 1.0 / (COUNTS_PER_PERIOD * PwmClock(51.28, oscillator_hz).count_s)
    assert frame_advice(info.model_copy(update={"pwm_hz": reached})) == ""


@pytest.mark.parametrize("pwm_hz", [60.0, 100.0, 200.0])
def test_a_far_frequency_is_not_advised(pwm_hz: float) -> None:
    assert frame_advice(FakeRover().info().model_copy(update={"pwm_hz": pwm_hz})) == ""
