"""A tracked tip and a log of commands, by two clocks, show the link that swings; the oracle is a program of its own."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

from lrm_ident.measuring.motion import motion_picture
from lrm_ident.measuring.motion.motion_files import MotionSource, write_motion
from lrm_ident.measuring.motion.motion_report import comparison_document, motion_document
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.tip_joint import servo_angle
from lrm_ident.measuring.motion.tip_moves import TipMoves, tip_moves
from lrm_ident.measuring.recordings.command_log import CommandLog
from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, UnknownName
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.model.model import model_of
from lrm_math.motion.effects import RestOffset, ServoResponse, Swing
from lrm_math.motion.motion_model import load_motion
from lrmd.sim.swing import inertia
from tests.support.commands import stderr_of

ARM = load_arm("lrm-rover")
CLOCK_S, NOISE, SPEED, SERVO_S = 321.7, 2e-4, 0.5, 0.04
POSTURE = np.array([0.0, 0.3, -0.5, 0.4, 0.3, 0.0])
HZ, RATIO = 4.0, 0.05
"""Of the swing of joint 1 at this posture."""


@cache
def recorded() -> tuple[CommandLog, TipTrack]:
    """50 s in which joint 1 goes here and there, its servo with first-order lag, its link on a spring."""
    rng, h = np.random.default_rng(1), 0.001
    told, q = [], 0.0
    while len(told) * h < 50.0:
        goal = rng.uniform(-0.9, 0.9)
        way = np.arange(1, int(abs(goal - q) / SPEED / h) + 2) * SPEED * h
        told += [*(q + np.sign(goal - q) * np.minimum(way, abs(goal - q))), *([goal] * int(rng.uniform(0.8, 1.4) / h))]
        q = goal
    u = np.array(told)
    servo, link = np.empty_like(u), np.empty_like(u)
    s = y = v = 0.0
    omega = 2.0 * np.pi * HZ
    for k, goal in enumerate(u):
        before, s = s, s + h / SERVO_S * (goal - s)
        v += h * (omega**2 * (s - y) + 2.0 * RATIO * omega * ((s - before) / h - v))
        y += h * v
        servo[k], link[k] = s, y
    t = 100.0 + h * np.arange(len(u))
    return CommandLog(Path("log.csv"), ARM, t[::20], posed(u[::20])), tracked(t[::16], link[::16], rng)


def posed(joint1: Array) -> Array:
    q = np.tile(POSTURE, (len(joint1), 1))
    q[:, 0] = joint1
    return q


def tracked(t: Array, joint1: Array, rng: np.random.Generator) -> TipTrack:
    """The tip in a room of its own, 30 mm from the tool's frame."""
    chain, q = chain_of(ARM), posed(joint1)
    tool = chain_geometry(chain, chain.values(list(q.T)), len(q)).tool
    at = (tool[3] + 0.03 * tool[0]).T
    turn, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return TipTrack(
        Path("tip.csv"), t + CLOCK_S, at @ turn.T + [1.0, 2.0, 0.5] + rng.normal(scale=NOISE, size=at.shape)
    )


@cache
def study() -> MotionStudy:
    moves = tip_moves(*recorded(), model_of(ARM, ()))
    return MotionStudy.of(moves, (ServoResponse, RestOffset, Swing)).fit()


@cache
def with_swing() -> MotionStudy:
    return study().add("swing@joint1")


def mean_hz() -> float:
    """Frequency at the mean of all postures of what swings with `HZ` at this one."""
    chain, rng = chain_of(ARM), np.random.default_rng(8)
    lower, upper = (np.array([getattr(joint, side) for joint in ARM.joints]) for side in ("lower", "upper"))
    mean = np.mean([inertia(chain, rng.uniform(lower, upper), 0.0)[0, 0] for _ in range(400)])
    return float(HZ * np.sqrt(inertia(chain, POSTURE, 0.0)[0, 0] / mean))


@pytest.mark.long
def test_the_link_that_swings_is_found_and_the_error_falls_to_the_noise() -> None:
    start, own = study(), with_swing()
    assert isinstance(own.moves, TipMoves)
    assert own.moves.noise[0] == pytest.approx(NOISE, rel=0.15)
    assert own.held_out_rms < 0.5 * start.held_out_rms
    assert own.held_out_rms < NOISE, "the tip between two frames of the tracker has less"
    assert own.model.values["swing.joint1.frequency_Hz"] == pytest.approx(mean_hz(), rel=0.06)  # of 64 postures
    assert own.model.values["swing.joint1.damping_ratio"] == pytest.approx(RATIO * mean_hz() / HZ, rel=0.1)
    for document in (motion_document(own, "x"), comparison_document(own)):
        assert "mm" in document.text()
        assert document.json()


def test_a_joint_of_unknown_reading_stands_at_its_command_whatever_its_offset() -> None:
    effects = ServoResponse(ARM, "joint2"), RestOffset(ARM, "joint2")
    stands = tip_moves(*recorded(), model_of(ARM, ())).drive(1)
    moved = servo_angle(effects, np.array([[4.0, 0.7, 0.3]]), stands)
    np.testing.assert_allclose(moved, POSTURE[1] + 0.3, atol=1e-12)


def test_moves_that_begin_in_motion_are_told_of() -> None:
    t = 100.0 + 0.02 * np.arange(2500)
    waves = 0.6 * np.sin(1.3 * (t - 100.0))
    track = tracked(t, waves, np.random.default_rng(2))
    notices = tip_moves(CommandLog(Path("log.csv"), ARM, t, posed(waves)), track, model_of(ARM, ())).notices
    assert re.search(r"(\d+) of \1 moves begin while the arm moves", notices[-1])
    assert len(tip_moves(*recorded(), model_of(ARM, ())).notices) == 1


@pytest.mark.long
def test_the_picture_of_a_tip_names_what_was_tracked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []

    def note(axes: Axes, *words: str) -> None:
        said.extend([*words, *axes.get_legend_handles_labels()[1]])
        curves = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
        if "tracked tip" in curves:
            apart = [np.std(curves[name] - curves["tracked tip"]) for name in ("predicted before", "predicted after")]
            assert apart[1] < 0.5 * apart[0], "mm, of the tip along one axis"

    monkeypatch.setattr(motion_picture, "finish", note)
    motion_picture.draw_motion(study(), with_swing(), tmp_path / "move.png")
    assert (tmp_path / "move.png").stat().st_size > 0
    assert "tracked tip" in said
    assert "reading − prediction, mm" in said
    assert not any("encoder" in one or "deg" in one for one in said)


@pytest.mark.long
def test_the_model_comes_back_from_its_file(tmp_path: Path) -> None:
    write_motion(study(), "lrm-rover", tmp_path / "motion.toml")
    file, _ = load_motion(tmp_path / "motion.toml")
    assert file.history[0].held_out_mm == pytest.approx(1e3 * study().held_out_rms, rel=1e-6)


def test_another_motion_is_refused_in_one_line() -> None:
    log, track = recorded()
    other = replace(track, position=track.position[::-1].copy())
    with pytest.raises(FileError, match="does not follow that of the commands"):
        tip_moves(log, other, model_of(ARM, ()))


@pytest.mark.long
def test_one_mcap_file_has_commands_and_tip(tmp_path: Path, example_model: Path) -> None:
    log, track = recorded()
    path = tmp_path / "drive.mcap"
    write_mcap(path, log, track)
    moves = MotionSource(path).moves(ARM)
    assert isinstance(moves, TipMoves)
    same = tip_moves(log, track, model_of(ARM, ()))
    assert len(moves) == len(same)
    assert moves.installation.late == pytest.approx(same.installation.late, abs=1e-3)
    np.testing.assert_allclose(moves.tip[moves.counted].std(axis=0), same.tip[same.counted].std(axis=0), rtol=1e-2)
    with pytest.raises(FileError, match=r"no joint states in /arm: /joint_states"):
        MotionSource(path, topic="/arm").moves(ARM)
    command = ("motion", "fit", path, "--arm", "lrm-rover", "-o", tmp_path / "motion.toml")
    assert "no joint states in /arm" in stderr_of(*command, "--topic", "/arm")
    assert "is a model of lrm-lab" in stderr_of(*command, "--rest", example_model)
    with pytest.raises(UnknownName, match="hand"):
        MotionSource(path, tool="hand").moves(ARM)


@pytest.mark.long
def test_one_mcap_file_has_commands_and_what_the_encoders_read(tmp_path: Path) -> None:
    log, _ = recorded()
    path, late = tmp_path / "drive.mcap", 0.1
    t = np.arange(log.t[0] + 1.0, log.t[-1], 0.02)
    t = t[(t < 120.0) | (t > 120.5)]
    t = t + np.random.default_rng(3).uniform(-2e-3, 2e-3, len(t))
    with path.open("wb") as file:
        writer = pytest.importorskip("mcap.writer", reason="extra mcap").Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "jsonschema", b"{}")
        for topic, times, angles in (("/told", log.t, log.q), ("/read", t, log.at(t - late))):
            channel = writer.register_channel(topic, "json", schema)
            for at, q in zip(times.tolist(), angles.tolist(), strict=True):
                stamp = {"sec": int(at), "nsec": round((at - int(at)) * 1e9)}
                write(writer, channel, at, {"header": {"stamp": stamp}, "name": [], "position": q})
        writer.finish()
    moves = MotionSource(path, topic="/told", encoders="/read").moves(ARM)
    assert len(np.unique(moves.episode)) == 2
    assert moves.dt == pytest.approx(0.02, rel=0.02)
    behind = moves.command[:, :-5, 0] - moves.reading[:, 5:, 0]
    assert np.abs(behind[moves.counted[:, 5:]]).max() < SPEED * 0.025, "rad: a command stays until the next"
    fit = ("motion", "fit", path, "--arm", "lrm-rover", "-o", tmp_path / "motion.toml", "--topic", "/told")
    assert "leave --tip out" in stderr_of(*fit, "--encoders", "/read", "--tip", path)
    assert "no joint states in /seen" in stderr_of(*fit, "--encoders", "/seen")
    with pytest.raises(FileError, match="no times in common"):
        log.beside(t + 1e4, log.at(t))


def write_mcap(path: Path, log: CommandLog, track: TipTrack) -> None:
    """Foxglove's JSON: joint states without names, and transforms of the tool."""
    writer_of = pytest.importorskip("mcap.writer", reason="extra mcap").Writer
    with path.open("wb") as file:
        writer = writer_of(file)
        writer.start()
        states, tools = (
            writer.register_channel(topic, "json", writer.register_schema(kind, "jsonschema", b"{}"))
            for topic, kind in (("/joint_states", "sensor_msgs/JointState"), ("/tool", "foxglove.FrameTransform"))
        )
        for t, q in zip(log.t.tolist(), log.q.tolist(), strict=True):
            stamp = {"sec": int(t), "nsec": round((t - int(t)) * 1e9)}
            write(writer, states, t, {"header": {"stamp": stamp}, "name": [], "position": q})
        for t, tip in zip(track.t.tolist(), track.position.tolist(), strict=True):
            stamp = {"sec": int(t), "nsec": round((t - int(t)) * 1e9)}
            turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
            place = {"translation": dict(zip("xyz", tip, strict=True)), "rotation": turn}
            write(writer, tools, t, {"timestamp": stamp, "parent_frame_id": "room", "child_frame_id": "tool", **place})
        writer.finish()


def write(writer: Any, channel: int, t: float, content: dict[str, Any]) -> None:
    writer.add_message(channel, round(t * 1e9), json.dumps(content).encode(), round(t * 1e9))


@pytest.mark.parametrize(
    ("rows", "match"),
    [
        ("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0\n", "t_s"),
        ("t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0,0\n9,0,0,0,0,0,0\n", "without a row"),
        (
            "t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n5,0,0,0,0,0,0\n5.02,0,0,0,0,0,0\n0.04,0,0,0,0,0,0\n",
            "row 3: its time is not after that of the row before",
        ),
    ],
)
def test_a_log_that_cannot_serve_is_refused_in_one_line(tmp_path: Path, rows: str, match: str) -> None:
    log, tip = tmp_path / "log.csv", tmp_path / "tip.csv"
    log.write_text(rows)
    tip.write_text("t_s,x_mm,y_mm,z_mm\n0,0,0,0\n")
    with pytest.raises(FileError, match=match):
        MotionSource(log, tip).moves(ARM)
    with pytest.raises(FileError, match=match):
        MotionSource(log).moves(ARM)
    with pytest.raises(FileError, match=r"read beside a log"):
        MotionSource(tmp_path, tip).moves(ARM)


def test_a_log_without_encoders_needs_a_tip(tmp_path: Path) -> None:
    head = ",".join(["t_s", *(f"q{number}_deg" for number in range(1, 7))])
    rows = "\n".join(f"{0.02 * row:.2f},{0.1 * row:.1f},0,0,0,0,0" for row in range(200))
    (tmp_path / "log.csv").write_text(f"{head}\n{rows}\n")
    with pytest.raises(FileError, match="--tip"):
        MotionSource(tmp_path / "log.csv").moves(ARM)
