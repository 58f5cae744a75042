"""Level 1: a scripted person at the protractor, and the arm file that comes of it."""

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
from lrm_math.arm.servo_table import ServoTable
from lrm_math.errors import LrmError
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
def test_any_number_of_angles_and_nudges_of_the_same_size_shift_every_pulse(
    tmp_path_factory: pytest.TempPathFactory, n: int, shift: float
) -> None:
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
    ("arm", "servo"),
    [(a, s) for a in SHIPPED for s in (*(f"joint{i}" for i in range(1, 7)), "gripper")],
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
