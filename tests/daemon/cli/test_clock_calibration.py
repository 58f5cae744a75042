"""The board's clock: values of instruments and of a protractor, what is refused, and that nothing moves unasked."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.errors import LrmError
from lrmd.cli.clock_calibration import ClockedServo, by_angles, by_instrument, calibrate_clock
from lrmd.cli.servo_calibration import CalibrationAborted
from tests.daemon.cli.test_servo_calibration import FakeRover, ScriptedOperator

TABLE = ServoTable((math.radians(-100), 0.0, math.radians(100)), (620e-6, 1550e-6, 2450e-6))
oscillators = st.floats(23e6, 27e6)


def clocked(configured: float = 25e6, pwm_hz: float = 50.0, table: ServoTable = TABLE) -> ClockedServo:
    return ClockedServo("joint2", table, (-2.0, 2.0), configured, PwmClock(pwm_hz, configured).count_s)


@given(true=oscillators, configured=oscillators, pwm=st.sampled_from([50.0, 200.0, 330.0]))
def test_whatever_is_measured_at_the_pin_gives_the_true_oscillator(true: float, configured: float, pwm: float) -> None:
    servo = clocked(configured, pwm)
    pulse, period = servo.put_out(1500e-6), 4096 * servo.count_s
    longer = configured / true
    for text in (
        f"{pulse * longer * 1e6:.1f}us", f"{period * longer * 1e3:.3f} ms", f"{1 / (period * longer):.2f}Hz",
        f"{pulse * longer * 1e6 + 0.4:.1f}us +- 0.5",
    ):  # fmt: skip
        found = by_instrument(servo, pulse, text)
        assert found.hz == pytest.approx(true, abs=found.uncertainty_hz)
        assert found.uncertainty_hz < 0.001 * true


@given(true=oscillators, configured=oscillators, low=st.floats(-95, -40), high=st.floats(40, 95), error=st.floats(0, 1))
def test_two_angles_give_it_within_what_is_stated(
    true: float, configured: float, low: float, high: float, error: float
) -> None:
    servo = clocked(configured)
    pulses = tuple(servo.put_out(float(TABLE.pulse_of(math.radians(a)))) for a in (low, high))
    turn = abs(servo.angle_at(pulses[1], true) - servo.angle_at(pulses[0], true))
    wrong = math.radians(1.0)
    found = by_angles(servo, (pulses[0], pulses[1]), turn + math.radians(error), wrong)
    assert found.hz == pytest.approx(true, abs=found.uncertainty_hz)
    assert 0.02 <= found.uncertainty_hz / found.hz < 0.03


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("1500", "should be like 1389us"),
        ("18,52ms", "should be like 1389us"),
        ("-1500us", "should be like 1389us"),
        ("nanus", "should be like 1389us"),
        ("0us", "no pulse of this board"),
        ("18520us", "no pulse of this board"),
        ("1.5ms", "no period of this board; should be 16.66 to 24.99 ms"),
        ("333Hz", "no frequency of this board; should be 40.02 to 60.03 Hz"),
        ("0Hz", "no frequency of this board"),
        ("1500us +- 0", "the uncertainty should be more than 0"),
        ("1500us +- 100", "at most 4% of the value"),
        ("54.0Hz +- 1e9", "should be like 1389us"),
    ],
)
def test_a_senseless_value_is_one_line(text: str, match: str) -> None:
    servo = clocked()
    with pytest.raises(LrmError, match=match) as refused:
        by_instrument(servo, servo.put_out(1500e-6), text)
    assert "\n" not in str(refused.value)


def test_a_turn_that_no_oscillator_makes_is_one_line() -> None:
    servo = clocked()
    pulses = (servo.put_out(1000e-6), servo.put_out(2000e-6))
    for turn in (0.0, math.pi):
        with pytest.raises(LrmError, match=r"none of this servo.*were the angles read in degrees"):
            by_angles(servo, pulses, turn, math.radians(1.0))


def guided(rover: FakeRover, *words: str) -> tuple[ScriptedOperator, float]:
    person = ScriptedOperator(*words)
    found = calibrate_clock(rover, rover.name, person.ask, person.say)  # type: ignore[arg-type]
    assert next(person._words, None) is None, "not every word was asked for"
    return person, found.hz


def test_a_logic_probe_moves_nothing_and_gives_the_line_for_the_configuration() -> None:
    rover = FakeRover()
    pulse = clocked().put_out(1550e-6) * 25 / 27
    person, hz = guided(rover, "what", f"{pulse * 1e6:.1f}us")
    assert rover.visited == []
    assert hz == pytest.approx(27e6, rel=1e-4)
    assert f"oscillator_hz = {hz / 1e6:.4f}e6" in person.heard[-1]
    assert "7.4% too short" in person.heard[-1]
    assert "should be like" in person.heard[-2]


def test_a_clock_that_is_right_is_left_alone() -> None:
    person, _ = guided(FakeRover(), "50.0Hz")
    assert "leave oscillator_hz as it is" in person.heard[-1]
    assert "e6" not in person.heard[-1]


def test_the_protractor_moves_only_where_it_is_told_to() -> None:
    rover, true = FakeRover(), 23e6
    shown = [math.degrees(clocked().angle_at(clocked().put_out(float(TABLE.pulse_of(math.radians(a)))), true)) + 3.0
             for a in (-60, 60)]  # fmt: skip
    person, hz = guided(rover, "", "-60", f"{shown[0]:.0f}", "60", f"{shown[1]:.0f}")
    assert rover.visited == pytest.approx([math.radians(-60), math.radians(60)])
    assert hz == pytest.approx(true, rel=0.02)
    assert "to turn joint2 to" in person.asked[1]


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (["10", "10", "20", "20"], "10.0 deg apart: should be 30 or more"),
        (["-60", "-60", "60", "600"], "were the angles read in degrees"),
        (["far"], "should be like 30deg"),
        (["110"], "an oscillator that is off may turn it to 89 to 135 deg; its limits are -120 to 120 deg"),
        (["-60", "-60 +- 40"], "at most 10 deg"),
        (["-60", "-60 +- 0"], "more than 0"),
    ],
)
def test_a_senseless_angle_is_one_line_and_asked_again(words: list[str], match: str) -> None:
    person = ScriptedOperator("", *words, "q")
    with pytest.raises(CalibrationAborted, match="the clock was not measured"):
        calibrate_clock(FakeRover(), "joint2", person.ask, person.say)  # type: ignore[arg-type]
    assert match in person.heard[-1]
    assert "\n" not in person.heard[-1]


class LimpRover(FakeRover):
    def __init__(self) -> None:
        super().__init__(on=False)
        self.armed: list[dict[str, float]] = []

    def arm(self, where: str, q: dict[str, float]) -> None:
        assert where == "given"
        self.armed.append(q)
        self.on, self.q = True, q[self.name]


def test_a_limp_servo_gets_its_first_pulse_only_after_what_it_may_do_was_said() -> None:
    rover = LimpRover()
    limp = ScriptedOperator("here", "0", "yes", "q")
    with pytest.raises(CalibrationAborted):
        calibrate_clock(rover, "joint2", limp.ask, limp.say)  # type: ignore[arg-type]
    assert rover.armed == []
    assert "may jump by up to 15 deg at full speed" in limp.heard[-1]
    person, _ = guided(rover, "10", "", "50.00Hz")
    assert rover.armed == [{"joint2": pytest.approx(math.radians(10))}]
    assert "may jump" in person.heard[0]


def test_the_end_of_the_input_stops_it() -> None:
    def ended(_: str) -> str:
        raise EOFError

    with pytest.raises(CalibrationAborted):
        calibrate_clock(LimpRover(), "joint2", ended, print)  # type: ignore[arg-type]
