"""The step that adds a residual field: only where it predicts better, never as a cause, and honest of its error."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.field.fit import fit_with_field
from lrm_ident.fitting.field.regression import MOST_NUMBERS, field_posterior
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.report.effects import WHAT_A_FIELD_IS
from lrm_ident.study import field_step
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_ident.study.inputs import read_study
from lrm_ident.study.notices import Notice, NoticeKind
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.covariance import to_covariance
from lrm_math.model.deployed_model import field_of, named_part
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_model
from lrm_math.model.step_name import ADD
from lrm_math.model.uncertainty import position_covariance
from tests.support.commands import run_command, stdout_of
from tests.support.nameless_arm import ARM, NOISE, measured
from tests.support.sweep import examples, seeds


@pytest.mark.long
def test_held_out_and_at_new_poses_it_predicts_better(fitted: Study, with_field: Study) -> None:
    before, after = fitted.held_out.error, with_field.held_out.error
    assert after.rms < 0.7 * before.rms
    new = measured(2, 3e-3)
    errors = [error_stats(new.position_error(solve_equilibrium(s.model, new.poses))).rms for s in (fitted, with_field)]
    assert errors[1] < 0.7 * errors[0]
    assert after.rms == pytest.approx(errors[1], rel=0.25), "the held-out error is the error at new poses"


@pytest.mark.long
def test_its_deviation_is_that_of_its_error(with_field: Study) -> None:
    """Noise-free displacements at new poses lie within two predicted deviations about as often as they should."""
    poses = poses_of(np.random.default_rng(5).uniform(-1.1, 1.1, (200, ARM.dof)))
    file, clean = with_field.file, measured(2, 3e-3)
    assert file.covariance is not None
    known = to_covariance(file.covariance, file.sigma, with_field.model)
    predicted = solve_equilibrium(with_field.model, clean.poses)
    variance = np.einsum("nii->ni", position_covariance(predicted, known)) + NOISE**2
    z = clean.position_error(predicted) / np.sqrt(variance)
    assert 0.85 < float((np.abs(z) < 2.0).mean()) <= 1.0
    far = poses_of(poses.q[:1] + 1.5)
    assert (
        np.trace(position_covariance(solve_equilibrium(with_field.model, far), known)[0])
        > 2.0 * variance.sum(axis=1).mean()
    )


@pytest.mark.long
def test_its_file_holds_no_more_than_a_hundred_numbers_of_it(with_field: Study, tmp_path: Path) -> None:
    own = [key for key in with_field.file.parameters if key.startswith("residual_field")]
    assert 3 < len(own) <= MOST_NUMBERS
    assert str(with_field.file.history[-1].name) == "add residual_field@tool"
    with_field.save(tmp_path / "model.toml")
    assert "residual_field" in (tmp_path / "model.toml").read_text()


@pytest.mark.long
def test_the_causes_keep_their_values_and_diagnosis_does_not_see_it(fitted: Study, with_field: Study) -> None:
    causes = named_part(with_field.model)
    np.testing.assert_allclose(causes.values, fitted.model.values, atol=1e-6)
    seen = with_field.identifiable()
    assert field_of(seen.model) is None
    assert Notice(NoticeKind.FIELD_LEFT_OUT) in seen.notices
    assert [one.name for one in seen.screen().scored] == [one.name for one in fitted.screen().scored]
    assert with_field.undo().model.free == fitted.model.free


@pytest.mark.long
def test_added_twice_it_is_fitted_anew() -> None:
    once = Study.of(world(1, 3e-3, 70)).fit().add_field()
    again = once.add_field()
    assert [effect.name for effect in again.model.effects] == [effect.name for effect in once.model.effects]
    assert again.taken.fit.sigma == pytest.approx(once.taken.fit.sigma, rel=0.01)


@pytest.mark.long
def test_least_squares_refuses_it(with_field: Study) -> None:
    with pytest.raises(LrmError, match="fitted last"):
        fit(with_field.model, with_field.data)


@pytest.mark.long
def test_poses_without_a_position_are_refused(fitted: Study) -> None:
    tcp = fitted.data.tcp.copy()
    tcp[3] = np.nan
    with pytest.raises(LrmError, match="1 poses have no measured position"):
        replace(fitted, data=fitted.data.with_tcp(tcp)).add_field()


@pytest.mark.long
def test_half_of_the_joint_space_says_nothing_of_the_other(fitted: Study) -> None:
    """Learned where joint 1 is negative, it leaves the poses far on the other side as they are."""
    data, left = fitted.data, fitted.data.position_error(solve_equilibrium(fitted.model, fitted.data.poses))
    known, far = data.poses.q[:, 0] < 0.0, data.poses.q[:, 0] > 0.4
    q = data.poses.q[known]
    ends = zip(q.min(axis=0).tolist(), q.max(axis=0).tolist(), strict=True)
    field = ResidualField(ARM, "tool").over(MeasuredRange(tuple(ends), (0.0, 0.0)))
    values = field_posterior(field, data.poses.take(known), left[known]).values.tolist()
    assert np.abs(field.amounts(data.poses.take(far), (), values)).max() < 1e-12


@pytest.mark.long
def test_a_file_predicts_as_the_study_that_wrote_it(with_field: Study, tmp_path: Path) -> None:
    with_field.save(tmp_path / "model.toml")
    poses = with_field.data.poses
    tips = [solve_equilibrium(one, poses).tcp for one in (load_model(tmp_path / "model.toml"), with_field.model)]
    np.testing.assert_allclose(*tips, atol=1e-13)


@pytest.fixture(scope="module")
def by_command(real: Measurements, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A model of the real arm with a field that the command added, and what it printed."""
    folder = tmp_path_factory.mktemp("real")
    Study.of(replace(real, source=replace(real.source, arm_name="lrm-lab"))).fit("option1").save(folder / "plain.toml")
    words = ("add", folder / "plain.toml", real.source.path, "residual_field", "-o", folder / "field.toml")
    return folder / "field.toml", " ".join(stdout_of(*words, "--all").split())


@pytest.mark.soak
@pytest.mark.long
def test_the_real_arm_is_predicted_better(real: Measurements, by_command: tuple[Path, str]) -> None:
    read = read_study(by_command[0], real.source.path)
    before, after = (entry.held_out_rms_mm for entry in read.file.history[-2:])
    assert after < 0.5 * before
    assert read.held_out.error.rms * 1e3 == pytest.approx(after, rel=1e-3)


@pytest.mark.soak
@pytest.mark.long
def test_the_command_says_that_it_is_no_cause(real: Measurements, by_command: tuple[Path, str]) -> None:
    file, out = by_command
    assert WHAT_A_FIELD_IS in out
    assert "numbers of a residual field, which are not causes" in out
    assert "residual_field.tool" not in out, "no coefficient means anything alone"
    _, _, told = run_command("diagnose", file, real.source.path)
    assert "the residual field is left out here" in " ".join(told.split())


@pytest.mark.long
def test_a_diagnosis_of_it_goes_between_processes(with_field: Study) -> None:
    """The workbench sends it: the blocks of the held-out error are made anew without what made them."""
    blocks = with_field.held_out.blocks
    again = pickle.loads(pickle.dumps(blocks))
    for one, other in zip(blocks, again, strict=True):
        np.testing.assert_array_equal(other.train_residual, one.train_residual)


Patch = pytest.MonkeyPatch


def residual(rms: float) -> Array:
    """(N, 3), of this RMS, with a scatter that is small beside it."""
    return np.outer(rms * (1.0 + 0.01 * (-1.0) ** np.arange(200)), [1.0, 0.0, 0.0])


def taken(patch: Patch, arm: Arm, among: float, beside: float) -> Step:
    """The step of a field that leaves so much of an error of 1 mm among the poses (random folds), and beside them."""
    data: Any = SimpleNamespace(poses=SimpleNamespace(q=None), repeat_of=None)
    after = {"random": residual(among), "blocks": residual(beside)}
    patch.setattr(field_step, "check_positions", lambda _: None)
    patch.setattr(field_step, "random_folds", lambda *_: "random")
    patch.setattr(field_step, "held_out_blocks", lambda *_, fold, **__: (fold or "blocks", residual(1.0)))
    patch.setattr(field_step, "blocks_with_field", lambda _, __, without: (without[0], after[without[0]]))
    patch.setattr(field_step, "held_out_residual", lambda blocks: blocks[1])
    patch.setattr(field_step, "fit", lambda *_, **__: None)
    patch.setattr(field_step, "fit_with_field", lambda *_: SimpleNamespace(model=None))
    patch.setattr(field_step.HeldOutResidual, "of", lambda *_: None)
    model: Any = SimpleNamespace(arm=arm)
    return field_step.field_step(model, data, None, None, lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("among", "beside"), [(0.93, 1.0), (0.93, 1.015), (0.5, 0.5)])
def test_a_field_is_added_where_it_helps(lab: Arm, monkeypatch: Patch, among: float, beside: float) -> None:
    assert taken(monkeypatch, lab, among, beside).name == (ADD, "residual_field@tool")


def test_none_is_added_where_it_saves_little_among_the_poses(lab: Arm, monkeypatch: Patch) -> None:
    with pytest.raises(NoBetterPrediction, match="does not surely predict better"):
        taken(monkeypatch, lab, 0.97, 1.0)


def test_none_is_added_where_it_does_harm_beside_the_poses(lab: Arm, monkeypatch: Patch) -> None:
    with pytest.raises(NoBetterPrediction, match="beside the poses it predicts worse"):
        taken(monkeypatch, lab, 0.5, 1.05)


SMALL, NOISE_M, COUNT, WIDEST = load_arm("two-joint"), 3e-4, 70, 1.4


def world(seed: int, size: float, poses: int) -> Measurements:
    """Measurements, at poses of that number, of an arm that a wave of two angles displaces by up to `size` (m)."""
    wave, place = np.random.default_rng(seed), np.random.default_rng([seed, poses])
    frequency, phase = wave.uniform(0.5, 2.5, (3, SMALL.dof)), wave.uniform(0.0, 2.0 * np.pi, 3)
    axis, q = wave.normal(size=(3, 3)), place.uniform(-WIDEST, WIDEST, (poses, SMALL.dof))
    waves = np.sin(q @ frequency.T + phase) @ (axis / np.linalg.norm(axis))
    data = Measurements.of_tcp(poses_of(q), np.zeros((poses, 3)), NOISE_M, source=Source(arm=SMALL))
    tcp = solve_equilibrium(Study.of(data).model, data.poses).tcp + size * waves
    return replace(data, source=Source(sha256=f"{seed}-{poses}", arm=SMALL)).with_tcp(
        tcp + place.normal(0.0, NOISE_M, tcp.shape)
    )


@cache
def errors(seed: int, size: float) -> tuple[str, float, float]:
    """Why a field was not added, empty if it was, and the error (RMS, m) at new poses without one and with one."""
    study, new = Study.of(world(seed, size, COUNT)).fit(), world(seed, size, 5 * COUNT)
    refused = ""
    try:
        study.add_field()
    except NoBetterPrediction as why:
        refused = str(why)
    models = study.model, fit_with_field(study.taken.fit, study.data).model
    without, with_one = (_rms(new.position_error(solve_equilibrium(model, new.poses))) for model in models)
    return refused, without, with_one


def _rms(error: Array) -> float:
    return error_stats(error).rms


@pytest.mark.long
@examples(2, 20)
@given(st.integers(0, 10_000), st.floats(0.0, 3e-3))
def test_a_field_is_added_where_it_predicts_better_and_nowhere_else(seed: int, size: float) -> None:
    """Added, it does not predict new poses worse; where it takes a third of the error, it is seen to predict better.

    Then it is added, unless it does harm in blocks of joint space, as where few poses leave wide gaps.
    """
    refused, without, with_one = errors(seed, size)
    assert refused or with_one < 1.01 * without
    assert "not surely predict better" not in refused or with_one > without / 1.5


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 4))
def test_where_nothing_is_left_none_is_added(seed: int) -> None:
    assert "not surely predict better" in errors(seed, 0.0)[0]
