"""`lrm` as a person types it, against a daemon in memory: what it does, what it prints, and how it refuses."""

from __future__ import annotations

import contextlib
import io
import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.measuring.recordings.command_log import read_command_log
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.model.reading import Reading
from lrmd.cli import app, record
from lrmd.cli import text as cli_text
from lrmd.cli.parsing import parse_angle, parse_angles
from lrmd.client import MotionInterrupted, RequestRefused, Rover
from lrmd.config import load_config
from lrmd.control.state import ControllerEvent
from lrmd.control.state_machine import Mode
from lrmd.messages.codec import ErrorReply, MessageError
from lrmd.messages.control import Event, FaultEntry, FaultsState, MoveRequest, ThermalState
from lrmd.messages.kinematics import PlanRequest
from lrmd.ramp.shared_memory import BUCKETS
from tests.conftest import ROOT
from tests.support.broken_output import full_disk_file
from tests.support.daemon.armed_daemon import take
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon
from tests.support.full_disk import full_disk

ZERO = "0,0,0,0,0,0"
NOBODY = "tcp/127.0.0.1:1"


@pytest.fixture
def daemon() -> Iterator[InMemoryDaemon]:
    sim = SimulatedDaemon(load_config(CONFIG))
    sim.run(30)
    daemon = InMemoryDaemon(sim)
    with daemon.reachable():
        yield daemon


Typed = Callable[..., tuple[int, str, str]]


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Typed:
    """Exit code, stdout and stderr of `lrm WORDS`."""

    def run(*words: str) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            code = app.main(list(words))
        except SystemExit as end:
            code = int(end.code or 0)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def does(typed: Typed) -> Callable[..., str]:
    def run(*words: str) -> str:
        code, out, err = typed(*words)
        assert (code, err) == (0, "")
        return out

    return run


@pytest.fixture
def refuses(typed: Typed) -> Callable[..., str]:
    """The one line of a command that is refused."""

    def run(*words: str) -> str:
        code, out, err = typed(*words)
        assert code == 2, (out, err)
        assert out == ""
        assert len(err.splitlines()) == 1, err
        assert err.startswith("lrm: ")
        return err

    return run


# ---- angles


@pytest.mark.long
@given(value=st.floats(-1000, 1000), unit=st.sampled_from(["", "deg", "°", " deg", "DEG"]), pad=st.sampled_from("  "))
def test_degrees_are_understood_with_and_without_their_name(value: float, unit: str, pad: str) -> None:
    assert parse_angle(f"{pad}{value!r}{unit}{pad}") == math.radians(value)


@pytest.mark.long
@given(value=st.floats(-20, 20))
def test_radians_keep_every_digit(value: float) -> None:
    assert parse_angle(f"{value!r}rad") == value


@given(values=st.lists(st.floats(-180, 180), min_size=1, max_size=9))
def test_several_angles_stand_between_commas(values: list[float]) -> None:
    assert parse_angles(",".join(f"{v!r}" for v in values)) == [math.radians(v) for v in values]


@pytest.mark.slow
@given(text=st.text(max_size=12))
def test_a_word_is_a_finite_angle_or_an_error_that_shows_how(text: str) -> None:
    try:
        angle = parse_angle(text)
    except LrmError as error:
        said = str(error)
    else:
        assert math.isfinite(angle)
        return
    assert "30deg" in said


@pytest.mark.parametrize(
    "text", ["", "deg", "nan", "inf", "1e999", "-1e999rad", "3,5", "0x10", "1_0", "30 grad", "--3"]
)
def test_what_is_no_angle_is_refused(text: str) -> None:
    with pytest.raises(LrmError, match="should be like 30deg"):
        parse_angle(text)


# ---- a day with an arm


def test_arm_move_look_and_disarm(daemon: InMemoryDaemon, does: Callable[..., str]) -> None:
    assert does("state").startswith("disarmed (started)\n")
    assert does("arm", "--q", ZERO) == "armed: joint1, joint2, joint3, joint4, joint5, joint6\n"
    assert does("move", "--joint", "2", "10deg", "--joint", "3", "-10deg", "--speed", "0.9").startswith("there, after ")
    core = daemon.sim.core
    assert core.angles(core.position)[1:3] == pytest.approx([math.radians(10), math.radians(-10)], abs=1e-5)
    looked = does("state", "--metrics")
    assert "armed (arrived)" in looked
    assert "servos that are off" not in looked
    rows = {row.split()[0]: row.split()[1:] for row in looked.splitlines()[3:12]}
    assert rows["joint2"][:2] == ["10.00", "10.00"]
    assert "on" in rows["joint2"]
    assert rows["pan"][0] == "unknown", "a servo that never had a pulse has no known angle"
    assert "ordinary scheduling" in looked
    does("move", "--q", "0,-0.1rad,0,0,0,-2.5")
    assert core.angles(core.position)[5] == pytest.approx(math.radians(-2.5), abs=1e-5)
    assert does("hold") == "holding\n"
    assert core.mode is Mode.HOLDING
    assert does("relax", "joint6") == "relaxed\n"
    daemon.run(6)
    assert daemon.sim.report.outputs == 0b011111
    assert "servos that are off are the last commanded ones" in does("state")
    assert does("disarm") == "disarmed\n"
    daemon.run(6)
    assert not daemon.sim.report.outputs
    log = does("logs")
    assert "holding -> disarmed: disarmed" in log
    assert log.index("arming -> armed") < log.index("moving -> armed: arrived")
    first, second, third = does("info").splitlines()[:3]
    assert first == "rover: arm lrm-rover, lrm-arm 0.1.0, tick 6.5 ms, model nominal"
    assert "at most 1 us per tick" in second
    assert third.endswith("counts of 4.88 us (50 Hz), so in steps of at most 4.88 us")
    assert daemon.sim.core.lease is None, "every command gave its lease back"


@pytest.mark.usefixtures("daemon")
def test_output_to_a_full_disk_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Before: a traceback."""
    with os.fdopen(full_disk_file(), "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert app.main(["state"]) == 2
    assert capsys.readouterr().err == "lrm: No space left on device\n"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(2, "No such file or directory", "x.toml"), "x.toml: No such file or directory"),
        (TimeoutError(), "TimeoutError"),
        (OSError("the line is gone"), "the line is gone"),
    ],
    ids=["of a file", "without words", "in words"],
)
def test_what_was_printed_before_an_error_of_the_system_stays(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], error: OSError, words: str
) -> None:
    """Before: nothing of it was written, nor what the process printed later; and no words behind the colon."""

    def printed_then_failed(_: object) -> None:
        print("the result")
        raise error

    options = SimpleNamespace(options_of=lambda _: SimpleNamespace(run=printed_then_failed))
    monkeypatch.setattr(app, "parser", lambda: options)
    path = tmp_path / "result.txt"
    with path.open("w", encoding="utf-8") as file:
        monkeypatch.setattr(sys, "stdout", file)
        assert app.main([]) == 2
        print("what comes later")
    assert capsys.readouterr().err == f"lrm: {words}\n"
    assert path.read_text(encoding="utf-8").splitlines() == ["the result", "what comes later"]
    with contextlib.redirect_stdout(io.StringIO()) as text:  # before: it has no descriptor, so another error
        assert app.main([]) == 2
    assert text.getvalue() == "the result\n"


def test_an_unchecked_move_says_that_it_is(daemon: InMemoryDaemon, does: Callable[..., str]) -> None:
    does("arm", "--q", ZERO)
    assert "checked" not in does("move", "--joint", "2", "10deg")
    daemon.sim.core.motion_check.guard = None
    said = does("move", "--joint", "2", "0deg")
    assert said.endswith("s; not checked for collisions: lrm-rover has no collision shapes\n")
    with Rover() as rover, rover.control("test"):
        rover.move({"joint2": 0.1}, wait=False)
        assert rover.unchecked == "lrm-rover has no collision shapes"


def test_metrics_show_how_late_the_ticks_were(daemon: InMemoryDaemon, does: Callable[..., str]) -> None:
    assert does("state", "--metrics").splitlines()[-1].strip() == "us", "no ticks, no bars"
    for us, ticks in {12: 60, 97: 30, 103: 9, 40_000: 1}.items():
        daemon.shared.lateness[min(us // 5, BUCKETS - 1)] = ticks
    lines = [line.split() for line in does("state", "--metrics").splitlines()]
    bars = lines[lines.index(["us"]) + 1 :]
    assert bars[0] == ["10", "..", "15", "60", "60.0000%", "#" * 6]
    assert bars[-1] == ["2555", "or", "more", "1", "1.0000%", "#"]
    assert [bar[0] for bar in bars] == sorted((bar[0] for bar in bars), key=float)
    assert {bar[0]: bar[3] for bar in bars if bar[0] in ("60", "80", "100")} == {"60": "0", "80": "30", "100": "9"}


def test_a_skill(daemon: InMemoryDaemon, typed: Typed) -> None:
    typed("arm", "--at", "gripper", "0")
    assert "lrm: drop: the gripper carries nothing" in typed("skill", "drop", "--gripper", "10")[2]
    code, said, _ = typed("skill", "grasp", "--gripper", "-5", "--payload-g", "20")
    assert (code, said) == (0, "grasp: reached: carries 20 g\n")
    code, said, _ = typed("skill", "drop", "--gripper", "500")
    assert code == 1
    assert said.startswith("drop: refused: gripper: 500.0 deg is outside its limits")
    assert daemon.sim.core.payload == 0.02
    assert "payload_kg is missing" in typed("skill", "grasp", "--gripper", "3")[2]
    assert (
        "'x' should be a number of mm"
        in typed("skill", "touch_down", "--goal", "1", "2", "3", "--touch", "a", "b", "x")[2]
    )


def test_gripper_pan_and_tilt(daemon: InMemoryDaemon, does: Callable[..., str]) -> None:
    does("arm", "--at", "gripper", "0", "--at", "pan", "0", "--at", "tilt", "-.1rad")
    does("gripper", "-5")
    does("pan-tilt", "3", "-4deg", "--each")
    core = daemon.sim.core
    angles = dict(zip(core.config.names, core.angles(core.position), strict=True))
    wanted = {"gripper": -5, "pan": 3, "tilt": -4}
    assert {n: math.degrees(angles[n]) for n in wanted} == pytest.approx(wanted, abs=1e-2)


def test_estop_and_reset(daemon: InMemoryDaemon, does: Callable[..., str], refuses: Callable[..., str]) -> None:
    does("arm", "--q", ZERO)
    assert does("estop", "--why", "smoke " * 40 + "\033[31m") == "stopped: the pulses are off\n"
    daemon.run(6)
    assert not daemon.sim.report.outputs, "an emergency stop stops, whatever the note says"
    looked = does("state")
    assert looked.startswith("estop (")
    assert "fault estop: emergency stop: smoke" in looked
    assert "not allowed while estop" in refuses("move", "--joint", "1", "3")
    assert does("reset") == "disarmed\n"


@pytest.mark.parametrize("words", [("plan", "--q", "10,0,0,0,0,0", "--go"), ("goto", "200", "0", "200")])
def test_a_stop_while_a_way_is_planned_is_not_followed_by_the_motion(
    daemon: InMemoryDaemon, does: Callable[..., str], typed: Typed, words: tuple[str, ...]
) -> None:
    """Planning takes seconds, and the lease is asked for after it."""
    does("arm", "--q", ZERO)

    def plan(_: Rover, request: PlanRequest) -> SimpleNamespace:
        with Rover("rover") as other:
            other.hold()
        return SimpleNamespace(found=True, waypoints_rad=[request.from_rad, request.to_rad], text="")

    answer = SimpleNamespace(q_rad=[0.2] + [0.0] * 5, rounded_q_rad=None)
    pulses = daemon.sim._pulses()
    with (
        mock.patch.object(Rover, "plan", plan),
        mock.patch("lrmd.cli.motion._solve_goal", return_value=answer),
        mock.patch("lrmd.cli.text.ik_text", return_value=""),
    ):
        code, _, said = typed(*words)
    assert (code, "stopped since" in said) == (2, True), said
    daemon.run(60)
    assert daemon.sim._pulses() == pulses


def test_arming_without_a_pose_says_what_is_needed(daemon: InMemoryDaemon, does, refuses) -> None:
    assert "(no pose is stored)" in refuses("arm")
    does("arm", "--q", "0,5,0,0,0,0")
    does("disarm")
    daemon.run(6)
    daemon.sim.core.stored = daemon.sim.core.saved(10**18)
    line = refuses("arm")
    assert "where each servo that is off stands" in line
    assert "joint2 5.0" in line
    does("arm", "--stored", "--servo", "joint2")
    assert daemon.sim.report.outputs == 0b10


@pytest.mark.usefixtures("daemon")
def test_a_refusal_without_a_stored_pose_in_it_says_nothing_of_one(refuses) -> None:
    """Before: *joint1 is not where it was … (no pose is stored)*, beside a table with the pose."""
    fell = ErrorReply(code="pose_needed", msg="joint1 is not where it was", retryable=False, detail={})
    with mock.patch.object(Rover, "arm", side_effect=RequestRefused(fell)):
        assert refuses("arm", "--stored") == "lrm: joint1 is not where it was\n"


def test_ctrl_c_holds(daemon: InMemoryDaemon, typed: Typed, does: Callable[..., str]) -> None:
    does("arm", "--q", ZERO)
    with mock.patch.object(Rover, "_wait", side_effect=KeyboardInterrupt):
        code, _, err = typed("move", "--joint", "1", "40deg")
    assert (code, err) == (1, "held\n")
    assert daemon.sim.core.mode is Mode.HOLDING


def test_a_motion_that_ends_early_exits_with_1(daemon: InMemoryDaemon, typed: Typed, does: Callable[..., str]) -> None:
    does("arm", "--q", ZERO)

    def brown_out(_: InMemoryDaemon, tail: str, before=InMemoryDaemon.state) -> object:
        if tail == "state/mode":
            daemon.sim.brown_out()
        return before(daemon, tail)

    with mock.patch.object(InMemoryDaemon, "state", brown_out):
        code, out, err = typed("move", "--joint", "1", "40deg")
    assert (code, out) == (1, "")
    assert err == "lrm: the motion ended before its goal: fault (the board lost its power; the arm is limp)\n"


def test_a_replaced_motion_does_not_arrive(daemon: InMemoryDaemon, typed: Typed, does: Callable[..., str]) -> None:
    """The other one takes the lease, and moves, between two looks at the mode."""
    does("arm", "--q", ZERO)
    rival: list[str] = []

    def taken(_: InMemoryDaemon, tail: str, before=InMemoryDaemon.state) -> object:
        if tail == "state/mode" and not rival and daemon.sim.core.mode is Mode.MOVING:
            rival.append(take(daemon.sim))
            daemon.sim.settle()
            daemon.sim.core.handle(MoveRequest(lease=rival[0], waypoints=[{"joint1": -0.1}]), daemon.sim.now)
        return before(daemon, tail)

    with mock.patch.object(InMemoryDaemon, "state", taken):
        code, out, err = typed("move", "--joint", "1", "40deg")
    assert rival
    assert (code, out) == (1, "")
    assert "another motion took its place: joint1 is not where it was sent" in err


@pytest.mark.usefixtures("daemon")
def test_somebody_else_has_the_lease(refuses, does) -> None:
    with Rover("rover") as other, other.control("the other one"):
        refused = refuses("arm", "--q", ZERO)
        assert "the other one holds the lease" in refused
        assert "take it over (--take;" in refused
        does("--take", "arm", "--q", ZERO)
        with pytest.raises(LrmError, match="lease"):
            other.move({"joint1": 0.1})


@pytest.mark.usefixtures("daemon")
def test_commands_are_recorded_until_the_daemon_is_silent(
    does: Callable[..., str], refuses: Callable[..., str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    assert "first lrm arm" in refuses("record", "-o", str(path))
    does("arm", "--q", ZERO)
    monkeypatch.setattr(record, "SILENT_S", 0.01)
    monkeypatch.setattr(Rover, "watch", lambda self, *of: [of[-1](self.joints()) for _ in range(5)])
    assert "5 rows written" in does("record", "-o", str(path))
    head, *rows = path.read_text().splitlines()
    assert head == "t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
    assert len(rows) == 5
    log = read_command_log(path, load_arm("lrm-rover"), Reading())
    assert (np.diff(log.t) > 0.0).all()
    assert log.count_s == pytest.approx(4.88e-6)
    assert np.abs(log.at(log.t)).max() < math.radians(0.3)
    assert "is there already" in refuses("record", "-o", str(path))
    assert "ends in .csv" in refuses("record", "-o", str(tmp_path / "log.txt"))
    assert "more than 0" in refuses("record", "-o", str(tmp_path / "other.csv"), "--seconds", "0")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["log.csv", "log.toml"]


@pytest.mark.usefixtures("daemon")
def test_a_record_spares_the_file_beside_it(
    does: Callable[..., str], refuses: Callable[..., str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Before: an arm, a model or metadata of that name was overwritten."""
    monkeypatch.setattr(record, "SILENT_S", 0.01)
    does("arm", "--q", ZERO)
    mine = tmp_path / "run.toml"
    mine.write_text("mine = true\n")
    assert f"{mine} is there already" in refuses("record", "-o", str(tmp_path / "run.csv"))
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("run.toml", "mine = true\n")]


@pytest.mark.usefixtures("daemon")
def test_a_disk_that_fills_while_commands_are_recorded_is_one_line(
    does: Callable[..., str], typed: Typed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Before: a traceback. The rows until then stay."""
    monkeypatch.setattr(record, "SILENT_S", 0.01)
    monkeypatch.setattr(Rover, "watch", lambda self, *of: [of[-1](self.joints()) for _ in range(200)])
    does("arm", "--q", ZERO)
    with full_disk(tmp_path / "disk", size=3 * 4096, room=2 * 4096):
        code, _, said = typed("record", "-o", str(tmp_path / "disk" / "log.csv"))
    assert code == 2
    assert said.startswith(f"lrm: {tmp_path / 'disk' / 'log.csv'}: cannot be written (")
    assert len(said.splitlines()) == 1


@pytest.mark.usefixtures("daemon")
def test_a_record_that_cannot_say_that_it_runs_leaves_no_file(
    does: Callable[..., str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Before: the file was named as not written, and the empty ones refused the next try."""
    monkeypatch.setattr(record, "SILENT_S", 0.01)
    does("arm", "--q", ZERO)
    with os.fdopen(full_disk_file(), "w") as full, monkeypatch.context() as printing:
        printing.setattr(sys, "stdout", full)
        assert app.main(["record", "-o", str(tmp_path / "log.csv")]) == 2
    assert capsys.readouterr().err == "lrm: No space left on device\n"
    assert not [*tmp_path.iterdir()]


# ---- what is refused


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ([], "COMMAND"),
        (["fly"], "unknown 'fly'"),
        (["move", "--joint", "2"], "--joint"),
        (["move", "--speed", "fast", "--joint", "1", "2"], "invalid float value: 'fast'"),
        (["arm", "--q", ZERO, "--stored"], "not allowed with"),
        (["level1", "joint1"], "--arm"),
        (["level1", "joint1", "--arm", "lrm-rover"], "-o FILE is missing"),
        (["level1", "joint1", "--clock", "-o", "x.toml"], "or --clock alone"),
        (["--robot", "ro/ver", "state"], "letters, digits"),
        (["--robot", "*", "state"], "letters, digits"),
        (["--robot", "", "state"], "letters, digits"),
        (["--connect", "nonsense", "state"], "nonsense"),
        (["--zenoh-config", "/none.json5", "state"], "no such file"),
    ],
)
def test_words_that_are_wrong_without_a_daemon(refuses: Callable[..., str], words: list[str], match: str) -> None:
    assert match in refuses(*words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "match"),
    [
        (["move"], "nothing to move"),
        (["move", "--q", "1,2"], "--q has 2 angles; lrm-rover has 6 joints"),
        (["move", "--joint", "7", "3"], "unknown servo 'joint7'; valid: joint1"),
        (["move", "--servo", "griper", "3"], "did you mean gripper?"),
        (["move", "--joint", "1", "3grad"], "should be like 30deg"),
        (["move", "--joint", "1", "1e999"], "should be like 30deg"),
        (["move", "--joint", "1", "3000"], "waypoints.0.joint1: input should be less than or equal to 20"),
        (["move", "--joint", "1", "101"], "joint1: 101.0 deg is outside its limits -100 to 100 deg"),
        (["move", "--joint", "1", "3", "--speed", "0"], "--speed 0: should be more than 0"),
        (["move", "--joint", "1", "3", "--speed", "nan"], "--speed nan"),
        (["move", "--joint", "1", "3", "--payload-g", "5000"], "--payload-g 5000: should be 0 to 2000 g"),
        (["move", "--joint", "1", "3", "--payload-g", "nan"], "--payload-g nan"),
        (["gripper", "3"], "gripper has no pulses; arm it first"),
        (["pan-tilt", "3", "500"], "pan has no pulses"),
        (["arm", "--q", ZERO, "--servo", "joint1"], 'servos: goes with "where": "stored"'),
        (["arm", "--at", "joint9", "3"], "unknown servo 'joint9'"),
        (["relax", "wing"], "unknown servo 'wing'"),
        (["reset"], "reset_fault with pulses on is not allowed while armed (all servos are on); it is while fault"),
        (["ik", "1e9", "0", "0"], "X Y Z 1e+09 0 0: should be three places in mm"),
        (["ik", "nan", "0", "0"], "X Y Z nan"),
        (["ik", "1", "0", "0", "--rpy", "1,2"], "--rpy has 2 numbers"),
        (["ik", "1", "0", "0", "--approach", "a,b,c"], "--approach"),
        (["plan", "--q", "1"], "--q has 1 angles"),
        (["plan", "--q", ZERO, "--seed", "-1"], "seed"),
        (["fk", "--payload-g", "1e9"], "--payload-g 1e+09"),
        (["level1", "wing", "--arm", "lrm-rover", "-o", "x.toml"], "unknown servo 'wing'"),
        (["level1", "wing", "--clock"], "unknown servo 'wing'"),
        (["level1", "joint1", "--arm", "no-arm", "-o", "x.toml"], "no-arm"),
        (["level1", "joint1", "--arm", "lrm-rover", "-o", "none/x.toml"], "no such folder"),
        (["level1", "joint1", "--arm", "lrm-rover", "-o", "x.toml", "--angles", "a"], "should be like 30deg"),
        (["--robot", "moon", "state"], "no answer from lrm/moon/info"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(
    daemon: InMemoryDaemon, does, refuses, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: list[str], match: str
) -> None:
    monkeypatch.chdir(tmp_path)
    does("arm", "--q", ZERO)
    before = daemon.sim.core.position
    assert match in refuses(*words)
    daemon.run(50)
    assert daemon.sim.core.position == before
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [["state"], ["hold"], ["estop"], ["move", "--joint", "1", "3"], ["logs"]])
def test_no_daemon_is_a_clear_line(refuses: Callable[..., str], words: list[str]) -> None:
    line = refuses("--connect", NOBODY, *words)
    assert line.startswith(f"lrm: no connection to {NOBODY} (")
    assert line.endswith("; is lrmd running, and allowed?\n")


# ---- a program of one's own


@pytest.mark.usefixtures("daemon")
def test_a_program_is_told_which_field_is_wrong_before_anything_is_sent() -> None:
    with Rover("rover") as rover:
        with pytest.raises(LrmError, match=r"rover\.control"):
            rover.move({"joint1": 0.1})
        with rover.control("me"):
            for wrong in (lambda: rover.move({"joint1": math.nan}), lambda: rover.jog({"joint1": math.inf})):
                with pytest.raises(MessageError, match="joint1: input should be a finite number"):
                    wrong()
        with pytest.raises(MessageError, match="holder"), rover.control("x" * 65):
            pass


@pytest.mark.usefixtures("daemon")
def test_waiting_ends_when_the_goal_cannot_be_reached_any_more() -> None:
    with Rover("rover") as rover, rover.control("me"):
        rover.arm("given", {"joint1": 0.0})
        rover.move({"joint1": 0.5}, wait=False)
        rover.hold()
        with pytest.raises(MotionInterrupted, match="holding"):
            rover._wait(("armed",), ("moving",), 1.0)


# ---- texts


HEADER = {"boot_id": "b", "seq": 1, "t_mono_ns": 1, "t_wall_ns": 1_700_000_000_123_456_789}
EVENT = Event(**HEADER, code="servo_hot", level="error", text="joint4 is hot")


class Terminal:
    """A stdout that is a terminal."""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        """Nothing is kept."""


def test_colour_is_for_terminals_only(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = cli_text.event_line(EVENT)
    assert "\033" not in plain
    monkeypatch.delenv("NO_COLOR", raising=False)
    with mock.patch.object(sys, "stdout", Terminal()):
        coloured = cli_text.event_line(EVENT)
        monkeypatch.setenv("NO_COLOR", "1")
        assert cli_text.event_line(EVENT) == plain
    assert coloured == f"\033[31m{plain}\033[0m"


@pytest.mark.usefixtures("daemon")
def test_no_command_prints_colour_into_a_pipe(does: Callable[..., str]) -> None:
    for words in (["arm", "--q", ZERO], ["state"], ["state", "--metrics"], ["info"], ["logs"]):
        assert "\033" not in does(*words)


def test_an_event_shows_its_time_to_the_millisecond() -> None:
    line = cli_text.event_line(EVENT)
    assert ".123 error   servo_hot" in line
    assert line.endswith("joint4 is hot")


def test_heat_is_told_with_the_time_that_is_left(daemon: InMemoryDaemon) -> None:
    publisher = daemon._publisher
    joints = publisher.states["state/joints"]()
    n = len(joints.names)
    heat = ThermalState(
        **HEADER, names=joints.names, temperature_c=[72.0] * n, tau_nm=[0.3] * n, level=["warm"] * n,
        hot_in_s=[600.0, None, *[0.0] * (n - 2)],
    )  # fmt: skip
    rows = cli_text.joints_table(joints, heat).splitlines()[2:]
    assert rows[0].endswith("72.0 warm, hot in 10 min")
    assert rows[1].endswith("72.0 warm")
    assert rows[2].endswith("72.0 warm")


def test_a_fault_shows_what_it_is_and_since_when() -> None:
    entry = FaultEntry(code="link_lost", text="the board does not answer", since_mono_ns=0)
    text = cli_text.faults_text(FaultsState(**HEADER, faults=[entry]))
    assert text.startswith("fault link_lost: the board does not answer (")
    assert text.endswith(" s ago)")


def test_the_examples_of_the_help_text_are_commands() -> None:
    lines = [line[2:].split("  ")[0].split() for line in app.DESCRIPTION.splitlines() if line.startswith("  lrm ")]
    assert len(lines) >= 5
    for words in lines:
        app.parser().parse_args(words[1:])


@pytest.mark.long
@pytest.mark.parametrize("program", ["lrm", "lrmd", "lrmd-board", "lrm-ros2"])
def test_help_fits_eighty_columns(program: str) -> None:
    entry = next(iter(entry_points(group="console_scripts", name=program)))
    code = f"import sys; from {entry.module} import {entry.attr} as main; sys.argv = ['{program}', '--help']; main()"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {"COLUMNS": "80"}
    )
    assert said.returncode == 0
    assert max(map(len, said.stdout.splitlines())) <= 80


def test_a_word_that_a_command_does_not_know_leads_to_its_own_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.main(["ik", "200", "0", "100", "--colour", "red"]) == 2
    assert capsys.readouterr().err == "lrm: unrecognized arguments: --colour red; see lrm ik --help\n"


def test_documents_use_commands_that_exist() -> None:
    seen = 0
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        for line in path.read_text(encoding="utf-8").splitlines():
            words = line.strip().split("#")[0].split()
            if line.startswith("    lrm ") and "|" not in words and "…" not in line:
                app.parser().parse_args(words[1:])
                seen += 1
    assert seen


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize("command", ["state", "info"])
def test_a_gone_reader_is_ok(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    reads, writes = os.pipe()
    os.close(reads)
    with open(writes, "w", encoding="utf-8") as nobody:
        monkeypatch.setattr(sys, "stdout", nobody)
        assert app.main([command]) == 1
    assert capsys.readouterr().err == ""


def test_hostile_texts_are_printed_without_escapes(daemon: InMemoryDaemon, does: Callable[..., str]) -> None:
    hostile = "held\x1b]0;own\x07\x1b[2J\u202eevil\u2066\r\nlrm: armed"
    daemon.sim.core.events.append(ControllerEvent("refused", "warning", hostile, {"why": hostile}))
    daemon._flush()
    said = does("logs")
    assert "held" in said
    assert not set("\x1b\x07\u202e\u2066\r") & set(said)


TWICE = [
    ("move", "--joint", "1", "10", "--joint", "1", "20"),
    ("move", "--q", ZERO, "--joint", "1", "20"),
    ("move", "--servo", "joint1", "10", "--joint", "1", "20"),
    ("arm", "--at", "joint1", "0", "--at", "joint1", "20"),
]


@pytest.mark.parametrize("words", TWICE)
@pytest.mark.usefixtures("daemon")
def test_an_angle_that_is_given_twice_moves_nothing(
    does: Callable[..., str], refuses: Callable[..., str], words: tuple[str, ...]
) -> None:
    """Before: the last one was meant."""
    does("arm", "--q", ZERO)
    before = does("state")
    assert "joint1 is given twice" in refuses(*words)
    assert does("state") == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fk", "--q", ZERO, "--payload-g", "-5"), "--payload-g -5: should be 0 to 2000 g"),
        (("fk", "--q", ZERO, "--payload-g", "nan"), "--payload-g nan: should be"),
        (("goto", "300000", "5", "5"), "X Y Z 300000 5 5: should be three places in mm, none beyond 100000"),
        (("goto", "nan", "5", "5"), "X Y Z nan 5 5: should be three places in mm"),
        (("skill", "touch_down", "--goal", "nan", "5", "5"), "--goal nan 5 5: should be three places in mm"),
    ],
)
@pytest.mark.usefixtures("daemon")
def test_numbers_are_refused_by_the_name_and_unit_that_they_have_in_the_command(
    refuses: Callable[..., str], words: tuple[str, ...], said: str
) -> None:
    """Before: the field of the message, and its unit: payload_kg, position_m.0."""
    assert said in refuses(*words)


@pytest.mark.usefixtures("daemon")
def test_arming_tells_that_an_angle_of_a_servo_with_pulses_is_not_used(does: Callable[..., str]) -> None:
    does("arm", "--q", ZERO)
    assert "\n" not in does("arm", "--q", ZERO).strip()
    assert "joint2 had pulses already, for 0.0 deg: it stays there" in does("arm", "--q", "0,50,0,0,0,0")


@pytest.mark.usefixtures("daemon")
def test_a_log_that_cannot_be_written_is_refused_before_it_is_recorded(
    does: Callable[..., str], refuses: Callable[..., str], tmp_path: Path
) -> None:
    does("arm", "--q", ZERO)
    assert "cannot be written" in refuses("record", "-o", str(tmp_path / "none" / "log.csv"), "--seconds", "1")
