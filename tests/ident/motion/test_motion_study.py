"""A model of motion finds what a joint hides, says so, and claims nothing where nothing is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.measuring.motion import motion_picture
from lrm_ident.measuring.motion.motion_files import write_motion
from lrm_ident.measuring.motion.motion_report import (
    auto_document,
    comparison_document,
    diagnosis_document,
    estimate,
    motion_document,
)
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import Moves, moves_of
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import FileError, LrmError
from lrm_math.motion.effects import (
    MOTION_EFFECTS,
    AccelerationLimit,
    CoulombFriction,
    DeadTime,
    Drag,
    MotionPlay,
    RestOffset,
    ServoResponse,
    SpeedLimit,
    Swing,
)
from lrm_math.motion.motion_model import load_motion
from tests.ident.motion.arm_in_motion import FPS, JOINT, recording

pytestmark = pytest.mark.long

ARM = load_arm("so101")
FEW = (ServoResponse, RestOffset, DeadTime, SpeedLimit, CoulombFriction, MotionPlay)


def moves(**hidden: float) -> Moves:
    """Moves of a recording with something hidden in joint 2."""
    return moves_of(recording(**hidden), ARM, Path("recording"))  # type: ignore[arg-type]


@cache
def study(what: str) -> MotionStudy:
    """A fitted study, by what hides."""
    hidden = {"nothing": {}, "friction": {"friction": 0.02}, "dead time": {"late": 2}}[what]
    return MotionStudy.of(moves(**hidden), FEW).fit()


def test_moves_are_whole_and_their_lead_does_not_count() -> None:
    found = study("nothing").moves
    assert found.counted[:, : round(0.5 * FPS)].sum() == 0
    assert found.counted.any(axis=1).all()
    assert len({(e, f) for e, f in zip(found.episode.tolist(), found.fold.tolist(), strict=True)}) == 6  # never split
    assert np.degrees(found.noise[JOINT]) == pytest.approx(0.043, rel=0.15)


def test_noise_is_what_does_not_follow_of_a_trembling_command() -> None:
    rng = np.random.default_rng(0)
    frames = recording()
    tremor = np.radians(0.03) * rng.normal(size=frames.command.shape)
    follows = 1.5 * tremor + np.pad(tremor[:-2], ((2, 0), (0, 0)))
    read = frames.feedback + follows + np.radians(0.02) * rng.normal(size=tremor.shape)
    found = moves_of(replace(frames, command=frames.command + tremor, feedback=read), ARM, Path("x")).noise
    plain = moves_of(frames, ARM, Path("x")).noise
    np.testing.assert_allclose(found, np.hypot(plain, np.radians(0.02)), rtol=0.15)


def test_a_set_point_that_lags_when_a_move_begins_is_where_it_was_when_its_readings_count() -> None:
    own = MotionStudy.of(moves(speed=0.35), FEW).fit().add("speed_limit@joint2")
    assert own.model.values["speed_limit.joint2.v_rad_per_s"] == pytest.approx(0.35, rel=1e-3)
    assert np.sqrt(own.fits[JOINT].held_out.max()) < 1.5 * own.moves.noise[JOINT]


def test_what_moves_do_not_determine_is_said_in_words() -> None:
    frequency, damping, mass = Swing.parameters
    unknown = "not determined by these moves"
    assert estimate(frequency, 14.0, 48.0) == unknown
    assert estimate(frequency, 5.0, 6.0) == unknown
    assert estimate(damping, 0.05, 0.0) == unknown
    assert estimate(mass, 2.0, 4.0) == unknown
    assert estimate(frequency, 5.0, 0.1) == "5.00 ± 0.10 Hz"
    assert estimate(mass, 0.0, 0.1) == "0.00 ± 0.10"


def test_a_sound_servo_is_identified_and_nothing_is_missing() -> None:
    own = study("nothing")
    values, sigma = own.model.values, own.model.sigma
    for key, true in (("frequency_Hz", 4.0), ("damping_ratio", 0.8)):
        name = f"servo_response.joint2.{key}"
        assert abs(values[name] - true) < 4.0 * sigma[name] + 0.004
    assert own.fits[JOINT].held_out_rms < 1.1 * own.moves.noise[JOINT]
    screened = own.screen()
    assert all(one.first is None for one in screened)
    words = diagnosis_document(own, screened).text()
    assert "No missing effect found" in words


def test_hidden_friction_is_found_or_its_class_is_named() -> None:
    own = study("friction").auto()
    judged = own.judged()
    assert {one.effect.place for one in judged} == {"joint2"}
    assert "coulomb_friction@joint2" in {name for one in judged for name in (one.effect.name, *one.rivals)}
    assert own.model.values["coulomb_friction.joint2.c_rad"] == pytest.approx(0.02, rel=0.05)
    assert own.fits[JOINT].held_out_rms < 1.2 * own.moves.noise[JOINT]


def test_hidden_dead_time_is_found_and_every_step_is_held_out() -> None:
    start = study("dead time")
    found = start.screen([JOINT])[0]
    assert found.first is not None
    assert found.first.effect.name == "dead_time@joint2"
    own = start.add("dead_time@joint2")
    assert own.model.values["dead_time.joint2.t_s"] == pytest.approx(2 / FPS, abs=0.002)
    assert own.held_out_rms < 0.5 * start.held_out_rms
    assert [step for step, _ in own.history] == ["fit", "add dead_time@joint2"]
    assert "dead_time@joint2" in diagnosis_document(start, [found]).text(200)
    for document in (comparison_document(own), motion_document(own, "x"), auto_document(own, own.judged(), "m")):
        assert document.json()
        assert document.text()


def test_a_cause_that_a_term_without_a_name_outdoes_is_not_identified() -> None:
    own = MotionStudy.of(moves(drag=0.03), (ServoResponse, RestOffset, AccelerationLimit, Drag)).fit()
    found = own.screen([JOINT])
    assert [one.effect.id for one in found[0].candidates] == ["drag", "acceleration_limit"]
    assert "No cause identified. The best empirical term" in diagnosis_document(own, found).text(200)
    auto = own.auto()
    assert [(one.effect.id, one.kind, one.identified) for one in auto.judged()] == [("drag", "description", False)]
    assert auto.model.values["drag.joint2.n_ratio"] == pytest.approx(2.0, abs=0.1)
    assert auto.fits[JOINT].held_out_rms < 1.3 * auto.moves.noise[JOINT]


def test_a_model_comes_back_from_its_file(tmp_path: Path) -> None:
    own, path = study("friction").add("coulomb_friction@joint2"), tmp_path / "motion.toml"
    write_motion(own, "so101", path)
    file, model = load_motion(path)
    assert [effect.name for effect in model.effects] == [effect.name for effect in own.model.effects]
    for key, value in own.model.values.items():
        assert model.values[key] == pytest.approx(value, rel=1e-6, abs=1e-9)
    assert [step.step for step in file.history] == ["fit", "add coulomb_friction@joint2"]
    path.write_text(path.read_text().replace("coulomb_friction@joint2", "friktion@joint2"))
    with pytest.raises(FileError, match=r"friktion.*one of|friktion"):
        load_motion(path)


def test_a_file_names_its_arm_from_its_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Written from another folder than it is read in."""
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "mine.toml").write_text(shipped_arms()["so101"].read_text())
    monkeypatch.chdir(tmp_path)
    write_motion(study("nothing"), "models/mine.toml", Path("models/motion.toml"))
    monkeypatch.chdir(tmp_path / "models")
    assert load_motion(Path("motion.toml"))[0].arm == "mine.toml"


def test_what_cannot_be_told_is_refused_with_its_reason() -> None:
    own = replace(study("nothing"), catalogue=MOTION_EFFECTS)
    with pytest.raises(LrmError, match="act alike"):
        own.add("sensor_delay@joint2")
    with pytest.raises(LrmError, match="hardly varies"):
        own.add("gravity_sag@joint1")
    with pytest.raises(LrmError, match="dead_time"):
        own.add("dead_tim@joint2")


def test_a_hand_that_never_rests_is_told_of() -> None:
    frames = recording()
    assert moves_of(frames, ARM, Path("x")).notices == frames.notices
    q = np.zeros_like(frames.command)
    q[:, 0], q[:, 1] = 0.6 * np.sin(1.3 * frames.t), 0.6 * np.cos(1.3 * frames.t)
    notices = moves_of(replace(frames, feedback=q + 1e-4, command=q), ARM, Path("x")).notices
    assert "moves begin while the arm moves: let it stand" in notices[-1]


def test_a_recording_that_cannot_serve_is_refused_in_one_line() -> None:
    frames = recording(seconds=12.0)
    with pytest.raises(FileError, match="about a minute of motion"):
        moves_of(frames, ARM, Path("short"))
    late = frames.t.copy()
    late[5:] += 0.2
    with pytest.raises(FileError, match="evenly apart"):
        moves_of(replace(frames, t=late), ARM, Path("gaps"))
    gone = frames.feedback.copy()
    gone[7, 2] = np.nan
    with pytest.raises(FileError, match="1 frames lack a number"):
        moves_of(replace(frames, feedback=gone), ARM, Path("holes"))


def test_a_picture_draws_one_prediction_where_nothing_was_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(
        motion_picture, "finish", lambda axes, *words: said.extend([*words, *axes.get_legend_handles_labels()[1]])
    )
    plain = study("nothing")
    motion_picture.draw_motion(plain, plain, tmp_path / "move.png")
    assert [one for one in said if one.startswith("predicted")] == ["predicted (nothing was added)"]
    assert not any("before" in one or "after" in one for one in said)
