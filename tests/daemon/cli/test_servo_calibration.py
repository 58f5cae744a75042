"""Level 1: a scripted person at the protractor, the board's clock, and the arm file that comes of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MICROSECOND, load_arm, read_arm
from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.errors import LrmError
from lrmd.cli.clock_calibration import ClockedServo, by_angles, by_instrument, calibrate_clock
from lrmd.cli.servo_calibration import CalibrationAborted, calibrate_servo, replace_table
from lrmd.messages.control import InfoState, JointsState
from tests.conftest import ROOT

SHIPPED = {name: ROOT / "config" / "arms" / f"{name}.toml" for name in ("lrm-rover", "lrm-lab")}
HEADER = {"boot_id": "b", "seq": 1, "t_mono_ns": 1, "t_wall_ns": 1}


class FakeRover:
    """One servo with a table, and its true angle: `true` says which pulse brings it where."""

    def __init__(self, name: str = "joint2", on: bool = True, limit: float = math.radians(120)) -> None:
        self.name, self.on, self.limit = name, on, limit
        self.table = ServoTable((math.radians(-100), 0.0, math.radians(100)), (620e-6, 1550e-6, 2450e-6))
        self.q = 0.0
        self.visited: list[float] = []

    def move(self, *waypoints: dict[str, float]) -> float:
        for waypoint in waypoints:
            assert set(waypoint) == {self.name}
            q = waypoint[self.name]
            if not abs(q) <= self.limit:
                raise LrmError(f"{self.name}: {math.degrees(q):.0f} deg is outside its limits")
            self.q = q
            self.visited.append(q)
        return 0.1

    @property
    def pulse_us(self) -> float:
        return float(self.table.pulse_of(self.q)) * 1e6

    def joints(self) -> JointsState:
        return JointsState(
            **HEADER, names=["joint1", self.name], q_rad=[0.0, self.q], target_rad=[0.0, self.q],
            pulse_us=[0.0, self.pulse_us], on=[False, self.on], moving=False, remaining_s=0.0,
        )  # fmt: skip

    def info(self) -> InfoState:
        table = [list(self.table.angle)], [[p * 1e6 for p in self.table.pulse]]
        return InfoState(
            **HEADER, robot="r", arm="a", version="1", names=["joint1", self.name], joints=2,
            limits_rad=[[-self.limit, self.limit]] * 2, rate_rad_per_s=[1.0, 1.0], tables_rad=table[0] * 2,
            tables_us=table[1] * 2,
            tick_ms=6.5, step_us=1.0, count_us=4.88, pwm_hz=50.0, oscillator_hz=25e6, lease_ms=400.0,
            command_ms=500.0, model=None, model_sha256="", stored_rad={}, stored_still=False,
        )  # fmt: skip


class ScriptedOperator:
    """Answers from a list, and reads what is said."""

    def __init__(self, *words: str) -> None:
        self._words: Iterator[str] = iter(words)
        self.asked: list[str] = []
        self.heard: list[str] = []

    def ask(self, question: str) -> str:
        self.asked.append(question)
        return next(self._words)

    def say(self, text: str) -> None:
        self.heard.append(text)


def walked(
    rover: FakeRover, output: Path, angles_deg: list[float], *words: str, arm: str = "lrm-rover"
) -> ScriptedOperator:
    person = ScriptedOperator(*words)
    angles = [math.radians(a) for a in angles_deg]
    calibrate_servo(rover, rover.name, arm, output, angles, person.ask, person.say)
    assert next(person._words, None) is None, "not every word was asked for"
    return person


def joint2(path: Path) -> ServoTable:
    table = read_arm(path).joints[1].servo
    assert table is not None
    return table


def test_taking_every_angle_as_it_is_measures_the_daemons_own_table(tmp_path: Path) -> None:
    rover, out = FakeRover(), tmp_path / "arm.toml"
    person = walked(rover, out, [100, -100, 0], "", "", "")
    assert [math.degrees(q) for q in rover.visited] == pytest.approx([-100, 0, 100]), "from the lowest to the highest"
    table = joint2(out)
    assert table.angle == pytest.approx(rover.table.angle)
    assert table.pulse == pytest.approx(rover.table.pulse)
    assert "3 places" in person.heard[0]
    assert str(out) in person.heard[-1]


@pytest.mark.slow
@given(n=st.integers(2, 9), shift=st.floats(-20, 20))
def test_equal_nudges_shift_every_pulse_alike(tmp_path_factory: pytest.TempPathFactory, n: int, shift: float) -> None:
    rover, out = FakeRover(), tmp_path_factory.mktemp("arm") / "arm.toml"
    angles = [-90 + 180 * i / (n - 1) for i in range(n)]
    walked(rover, out, angles, *[word for _ in angles for word in (f"{shift:+.3f}", "")])
    table = joint2(out)
    assert [math.degrees(a) for a in table.angle] == pytest.approx(angles, abs=1e-3)
    wanted = rover.table.pulse_of([math.radians(a) for a in angles]) * 1e6 + shift
    assert [p * 1e6 for p in table.pulse] == pytest.approx(wanted.tolist(), abs=2e-3)


def test_an_angle_that_is_read_off_is_taken_for_the_pulse_that_stands(tmp_path: Path) -> None:
    rover, out = FakeRover(), tmp_path / "arm.toml"
    walked(rover, out, [-90, 0, 90], "-92.5deg", "1.5", "1.6rad")
    table = joint2(out)
    assert [math.degrees(a) for a in table.angle] == pytest.approx([-92.5, 1.5, math.degrees(1.6)], abs=1e-3)
    wanted = rover.table.pulse_of([math.radians(a) for a in (-90, 0, 90)])
    assert table.pulse == pytest.approx(wanted.tolist(), abs=1e-9)


@pytest.mark.parametrize("word", ["what", "+", "+five", "12km", "+-3", "1,5", "-30d", "+1e9", "+nan", "++1"])
def test_a_wrong_word_is_explained_and_asked_again(tmp_path: Path, word: str) -> None:
    rover, out = FakeRover(), tmp_path / "arm.toml"
    person = walked(rover, out, [-90, 90], word, "-90deg", "")
    assert any("ENTER" in said for said in person.heard[1:]), "what is possible is said again"
    assert [math.degrees(a) for a in joint2(out).angle] == pytest.approx([-90, 90])


def test_q_stops_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(CalibrationAborted, match="nothing was written"):
        walked(FakeRover(), tmp_path / "arm.toml", [-90, 0, 90], "", "+3", "q")
    assert list(tmp_path.iterdir()) == []


def test_a_table_that_is_none_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(LrmError, match="angles must rise"):
        walked(FakeRover(), tmp_path / "arm.toml", [-90, 90], "10", "10")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("rover", "arm", "folder", "angles", "match"),
    [
        (FakeRover("joint2"), "lrm-rover", ".", [30.0], "two or more"),
        (FakeRover("joint2"), "lrm-rover", ".", [30.0, 30.0], "two or more"),
        (FakeRover("joint2", on=False), "lrm-rover", ".", [0.0, 90.0], "no pulses; arm it first"),
        (FakeRover("joint2"), "nowhere.toml", ".", [0.0, 90.0], "nowhere"),
        (FakeRover("joint2"), "lrm-rover", "none", [0.0, 90.0], "no such folder"),
        (FakeRover("wing"), "lrm-rover", ".", [0.0, 90.0], r"\[auxiliary_servo.wing\]"),
        (FakeRover("joint9"), "lrm-rover", ".", [0.0, 90.0], "no table for joint9"),
    ],
)
def test_what_cannot_end_well_is_said_before_the_arm_moves(
    tmp_path: Path, rover: FakeRover, arm: str, folder: str, angles: list[float], match: str
) -> None:
    with pytest.raises(LrmError, match=match):
        walked(rover, tmp_path / folder / "arm.toml", angles, arm=arm)
    assert rover.visited == []
    assert list(tmp_path.iterdir()) == []


def test_a_servo_that_the_daemon_does_not_have_is_refused(tmp_path: Path) -> None:
    operator = ScriptedOperator()
    with pytest.raises(LrmError, match="unknown servo 'joint7'; valid: joint1, joint2"):
        calibrate_servo(FakeRover(), "joint7", "lrm-rover", tmp_path / "arm.toml", [0.0, 1.0], operator.ask, print)


def expected(arm: Arm, servo: str, table: ServoTable) -> Arm:
    """The arm with one table replaced, without the file."""
    if servo in arm.joint_names:
        number = arm.joint_names.index(servo)
        joints = list(arm.joints)
        joints[number] = replace(joints[number], servo=table)
        return replace(arm, joints=tuple(joints))
    others = tuple((n, table if n == servo else t) for n, t in arm.auxiliary_servos)
    return replace(arm, auxiliary_servos=others)


@pytest.mark.parametrize(
    ("arm", "servo"), [(a, s) for a in SHIPPED for s in (*(f"joint{i}" for i in range(1, 7)), "gripper")]
)
def test_only_that_servos_table_changes(tmp_path: Path, arm: str, servo: str) -> None:
    before, text = load_arm(arm), SHIPPED[arm].read_text(encoding="utf-8")
    pulses = (640.0, 1500.0, 1900.5, 2400.0)
    table = ServoTable(
        tuple(math.radians(a) for a in (-101.25, -3.0, 44.5, 99.0)), tuple(p * MICROSECOND for p in pulses)
    )
    if servo == "gripper" and not dict(before.auxiliary_servos):
        with pytest.raises(LrmError, match=r"\[auxiliary_servo.gripper\] first"):
            replace_table(text, servo, table)
        return
    path = tmp_path / "arm.toml"
    path.write_text(replace_table(text, servo, table), encoding="utf-8")
    assert read_arm(path) == expected(before, servo, table)
    kept = [line for line in text.splitlines() if line.lstrip().startswith("#")]
    assert [line for line in path.read_text(encoding="utf-8").splitlines() if line.lstrip().startswith("#")] == kept
    again = replace_table(path.read_text(encoding="utf-8"), servo, table)
    assert again == path.read_text(encoding="utf-8"), "writing the same table twice changes nothing"


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
def test_two_angles_give_it_as_stated(true: float, configured: float, low: float, high: float, error: float) -> None:
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
