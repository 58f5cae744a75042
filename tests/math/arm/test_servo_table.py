"""Level 1: servo tables and the PWM clock."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_table import PwmClock, ServoTable, rounding
from lrm_math.errors import LrmError

steps = st.lists(st.floats(0.05, 1.0), min_size=2, max_size=9)


@st.composite
def tables(draw: st.DrawFn) -> ServoTable:
    angle_steps = draw(steps)
    pulse_steps = draw(st.lists(st.floats(50e-6, 500e-6), min_size=len(angle_steps), max_size=len(angle_steps)))
    sign = draw(st.sampled_from([1.0, -1.0]))
    angles = np.cumsum([-1.5, *angle_steps])
    pulses = 1.5e-3 + sign * (np.cumsum([0.0, *pulse_steps]) - sum(pulse_steps) / 2)
    return ServoTable(tuple(angles.tolist()), tuple(pulses.tolist()))


@pytest.mark.slow
@given(tables(), st.floats(-3.0, 8.0))
def test_angle_to_pulse_and_back(table: ServoTable, angle: float) -> None:
    assert float(table.angle_of(table.pulse_of(angle))) == pytest.approx(angle, abs=1e-9)


@pytest.mark.slow
@given(tables())
def test_table_hits_its_own_points(table: ServoTable) -> None:
    np.testing.assert_allclose(table.pulse_of(table.angle), table.pulse, rtol=1e-12)
    np.testing.assert_allclose(table.angle_of(table.pulse), table.angle, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(tables(), st.floats(-3.0, 8.0), st.floats(-3.0, 8.0))
def test_tables_are_monotone(table: ServoTable, a: float, b: float) -> None:
    rises = table.pulse[-1] > table.pulse[0]
    if a < b - 1e-9:
        assert (table.pulse_of(a) < table.pulse_of(b)) == rises


@given(st.floats(24.0, 1500.0), st.floats(23e6, 27e6), st.integers(0, 4095))
def test_counts_to_pulse_and_back(frequency: float, oscillator: float, counts: int) -> None:
    try:
        clock = PwmClock(frequency, oscillator)
    except LrmError:
        return
    assert int(clock.counts_of(clock.pulse_of(counts))) == counts


@pytest.mark.slow
@given(st.floats(24.0, 400.0), st.floats(23e6, 27e6), st.floats(0.0, 2e-3))
def test_rounding_is_at_most_half_a_count(frequency: float, oscillator: float, pulse: float) -> None:
    try:
        clock = PwmClock(frequency, oscillator)
    except LrmError:
        return
    left = float(clock.pulse_of(clock.counts_of(pulse))) - pulse
    assert abs(left) <= clock.count_s / 2 * (1 + 1e-9)


@pytest.mark.parametrize(("frequency", "prescale", "count_us"), [(50, 121, 4.88), (150, 40, 1.64), (330, 17, 0.72)])
def test_chip_as_its_data_sheet_says(frequency: float, prescale: int, count_us: float) -> None:
    clock = PwmClock(frequency)
    assert clock.prescale == prescale
    assert clock.count_s * 1e6 == pytest.approx(count_us, abs=0.005)


def test_data_sheet_example() -> None:
    # NXP PCA9685 rev. 4, section 7.3.5: 200 Hz with 25 MHz gives prescale 30 = 1Eh
    assert PwmClock(200.0).prescale == 30


@pytest.mark.parametrize(("frequency", "oscillator"), [(10.0, 25e6), (3000.0, 25e6), (0.0, 25e6), (50.0, -1.0)])
def test_clock_out_of_the_chips_reach_is_an_error(frequency: float, oscillator: float) -> None:
    with pytest.raises(LrmError):
        PwmClock(frequency, oscillator)


def test_pulse_longer_than_the_period_is_an_error() -> None:
    with pytest.raises(LrmError, match="period"):
        PwmClock(330.0).counts_of(3.5e-3)


def test_joint_1_of_table_3_1(rover: Arm) -> None:
    servo = rover.joints[0].servo
    np.testing.assert_allclose(servo.pulse_of(np.radians([-100, 0, 50, 100])) * 1e6, [620, 1540, 2000, 2460])


def test_rounding_at_50_hz_is_a_quarter_of_a_degree(rover: Arm) -> None:
    servo = rover.joints[0].servo
    assert servo is not None
    error = np.degrees(rounding(servo, PwmClock(50.0), np.radians(np.linspace(-100, 100, 4001))))
    assert 0.25 < np.abs(error).max() < 0.28
    assert np.degrees(np.abs(rounding(servo, PwmClock(330.0), np.radians(np.linspace(-100, 100, 4001))))).max() < 0.041


@pytest.mark.parametrize(
    ("angle", "pulse", "word"),
    [
        ((0.0,), (1e-3,), "pairs"),
        ((0.0, 1.0), (1e-3, 2e-3, 3e-3), "pairs"),
        ((0.0, 0.0), (1e-3, 2e-3), "angles"),
        ((0.0, 1.0, 2.0), (1e-3, 2e-3, 1.5e-3), "pulses"),
    ],
)
def test_wrong_tables(angle: tuple[float, ...], pulse: tuple[float, ...], word: str) -> None:
    with pytest.raises(LrmError, match=word):
        ServoTable(angle, pulse)
