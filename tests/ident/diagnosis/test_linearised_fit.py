"""Screening and selection: a candidate's columns, and that taking them in turn is fitting them together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.diagnosis.claim import screened_estimates
from lrm_ident.diagnosis.screening.candidates import differentiate_candidates, unfitted_effects
from lrm_ident.diagnosis.screening.linearised_fit import PRIOR_SD, LinearisedFit, linearise
from lrm_ident.residual.better_prediction import squared_outlier_distance
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.sweep import examples

POSES, SIGMA = 40, 0.3
SIZES = st.lists(st.lists(st.integers(1, 4), min_size=1, max_size=3), max_size=4)


def some_fit(rng: np.random.Generator) -> tuple[LinearisedFit, Array, list[Array]]:
    A, r = rng.normal(size=(3 * POSES, 5)), rng.normal(size=3 * POSES)
    folds = [np.asarray(part) for part in np.array_split(rng.permutation(POSES), 5)]
    return linearise(A, r, folds, SIGMA), A, folds


def ridge(A: Array, C: Array, r: Array, rows: Array) -> Array:
    """(rows of A,), what a ridge on C beside A, estimated on some rows, leaves in all."""
    basis = np.linalg.qr(A[rows])[0]
    free_of = np.linalg.lstsq(A[rows], C[rows])[0]
    own = C - A @ free_of
    left = r - A @ np.linalg.lstsq(A[rows], r[rows])[0]
    assert np.abs(basis.T @ own[rows]).max(initial=0.0) < 1e-9
    normal = own[rows].T @ own[rows] + (SIGMA / PRIOR_SD) ** 2 * np.eye(C.shape[1])
    return np.asarray(left - own @ np.linalg.solve(normal, own[rows].T @ left[rows]))


@pytest.mark.long
@examples(20, 40)
@given(taken=SIZES, tried=st.lists(st.integers(1, 5), min_size=1, max_size=6), seed=st.integers(0, 10**6))
def test_what_is_taken_is_projected_out_for_good(taken: list[list[int]], tried: list[int], seed: int) -> None:
    """Whatever is taken in whatever groups, and whenever the tried columns are brought up to date."""
    rng = np.random.default_rng(seed)
    linear, A, folds = some_fit(rng)
    candidates = [rng.normal(size=(3 * POSES, m)) for m in tried]
    sets = linear.project_each(candidates, tried)
    fit, inside = linear, np.empty((3 * POSES, 0))
    for group in taken:
        columns = [rng.normal(size=(3 * POSES, m)) for m in group]
        fit = fit.beside(*(linear.project(C) for C in columns))
        inside = np.concatenate([inside, *columns], axis=1)
        if rng.uniform() < 0.5:
            sets = fit.up_to_date(sets)
    residual, every, squares_left = linear.residual, np.arange(3 * POSES), fit.residual_squares(candidates)
    for found, C, alone in zip(fit.explain_each(sets), candidates, squares_left.tolist(), strict=True):
        assert alone == pytest.approx(found.in_sample, rel=1e-9)
        both = np.concatenate([inside, C], axis=1)
        left = ridge(A, both, residual, every)
        assert found.in_sample == pytest.approx(float(left @ left), rel=1e-9)
        squares = np.empty(POSES)
        for poses in folds:
            rows = np.setdiff1d(every, (3 * poses[:, None] + np.arange(3)).reshape(-1))
            squares[poses] = (ridge(A, both, residual, rows).reshape(-1, 3) ** 2).sum(axis=1)[poses]
        astray = squares > np.maximum(squared_outlier_distance(squares), fit.baseline.held_out)
        np.testing.assert_allclose(found.held_out[~astray], squares[~astray], rtol=1e-7, atol=1e-12)
        assert (found.held_out[astray] < squares[astray]).all()
    assert fit.baseline.in_sample == pytest.approx(float((ridge(A, inside, residual, every) ** 2).sum()), rel=1e-9)


@given(seed=st.integers(0, 1000), lever=st.floats(10.0, 1e4))
def test_a_pose_to_which_a_line_leads_astray_counts_as_an_outlier_does(seed: int, lever: float) -> None:
    """A column that explains everything but one pose, where its slope is wrong."""
    rng = np.random.default_rng(seed)
    A, slope = rng.normal(size=(3 * POSES, 5)), rng.normal(size=3 * POSES)
    residual = 3.0 * slope + 0.1 * rng.normal(size=3 * POSES)
    slope[:3] *= lever
    folds = [np.asarray(part) for part in np.array_split(np.arange(POSES), 5)]
    linear = linearise(A, residual, folds, SIGMA)
    found = linear.explain(linear.project(slope[:, None]))
    at_most = np.maximum(linear.baseline.held_out, squared_outlier_distance(found.held_out))
    assert (found.held_out <= at_most * (1 + 1e-9)).all()


@given(st.integers(0, 1000))
def test_a_set_projected_late_is_the_set_projected_early(seed: int) -> None:
    rng = np.random.default_rng(seed)
    linear, _, _ = some_fit(rng)
    C, T = rng.normal(size=(3 * POSES, 3)), rng.normal(size=(3 * POSES, 2))
    fit = linear.beside(linear.project(T))
    early, late = fit.explain(linear.project(C)), fit.explain(fit.project(C))
    np.testing.assert_allclose(early.theta, late.theta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(early.held_out, late.held_out, rtol=1e-9)


@given(st.integers(0, 1000))
def test_a_column_that_is_taken_already_explains_nothing_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    linear, _, _ = some_fit(rng)
    T = linear.project(rng.normal(size=(3 * POSES, 2)) * 100.0)
    fit = linear.beside(T)
    assert fit.explain(T).rms == pytest.approx(fit.baseline.rms, rel=1e-6)


@examples(10, 20)
@given(taken=st.integers(0, 3), tried=st.integers(1, 4), known=st.integers(1, 5), seed=st.integers(0, 10**6))
def test_a_prior_is_measurements_that_every_fold_has(taken: int, tried: int, known: int, seed: int) -> None:
    """Rows of the prior are trained on in all folds, predicted in none, and no further column reaches them."""
    rng = np.random.default_rng(seed)
    A, r, B, s = (rng.normal(size=size) for size in ((3 * POSES, 5), 3 * POSES, (known, 5), known))
    folds = [np.asarray(part) for part in np.array_split(rng.permutation(POSES), 5)]
    linear = linearise(A, r, folds, SIGMA, (B, s))
    whole, residual = np.concatenate([A, B]), linear.residual
    inside, C = (np.concatenate([rng.normal(size=(3 * POSES, m)), np.zeros((known, m))]) for m in (taken, tried))
    fit = linear.beside(linear.project(inside[: 3 * POSES])) if taken else linear
    found = fit.explain(fit.project(C[: 3 * POSES]))
    both, every = np.concatenate([inside, C], axis=1), np.arange(len(whole))
    left = ridge(whole, both, residual, every)
    assert found.in_sample == pytest.approx(float(left @ left), rel=1e-9)
    assert fit.residual_squares([C[: 3 * POSES]])[0] == pytest.approx(found.in_sample, rel=1e-9)
    squares = np.empty(POSES)
    for poses in folds:
        rows = np.setdiff1d(every, (3 * poses[:, None] + np.arange(3)).reshape(-1))
        squares[poses] = (ridge(whole, both, residual, rows)[: 3 * POSES].reshape(-1, 3) ** 2).sum(axis=1)[poses]
    near = squares <= np.maximum(squared_outlier_distance(squares), fit.baseline.held_out)
    np.testing.assert_allclose(found.held_out[near], squares[near], rtol=1e-9)


@pytest.mark.long
def test_columns_are_those_of_the_total_jacobian_where_they_move_anything(lab: Arm) -> None:
    """Poses in a narrow range: most splines of the forms are zero at all of them."""
    model = model_of(lab, (*effects_at(lab, "offsets"), *effects_at(lab, "compliance")))
    poses = poses_of(np.random.default_rng(2).uniform(-0.3, 0.3, (15, lab.dof)), 0.05)
    response, found = differentiate_candidates(solve_equilibrium(model, poses), list(unfitted_effects(model)))
    settled, still = response.equilibrium, 0
    for one in found:
        shape = tuple(settled.model.value(key) for key in one.effect.keys)
        acting, moved = one.acting(shape)
        keys = [one.effect.keys[row] for row in one.rows]
        typical = [parameter.typical for parameter in one.parameters]
        expected = (parameter_jacobian(settled, keys) * typical).reshape(3 * len(poses), -1)
        np.testing.assert_allclose(one.columns(shape), expected, rtol=1e-9, atol=1e-15, err_msg=one.name)
        assert acting.rows == tuple(row for row, column in zip(one.rows, expected.T, strict=True) if column.any())
        np.testing.assert_array_equal(moved, one.columns(shape)[:, expected.any(axis=0)])
        still += len(one.rows) - len(acting.rows)
    assert still > len(found)


def test_screened_estimates_are_in_the_units_of_their_names() -> None:
    """By the screening they are in typical sizes, in SI."""
    of = [SimpleNamespace(name="b_mm", typical=2e-3, si=1e-3), SimpleNamespace(name="c_rad", typical=0.01, si=1.0)]
    alone = SimpleNamespace(theta=np.array([3.0, -2.0]), error=np.array([0.5, 1.0]))
    scored: Any = SimpleNamespace(candidate=SimpleNamespace(parameters=of), alone=alone)
    length, angle = screened_estimates(scored)
    assert length == ("b_mm", pytest.approx(6.0), pytest.approx(1.0))
    assert angle == ("c_rad", pytest.approx(-0.02), pytest.approx(0.01))
