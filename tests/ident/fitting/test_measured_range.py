"""Fits keep the range that they were made on, curves are smooth in it, and predictions say what lies beyond."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting.cross_validation import Split, one_step_fits
from lrm_ident.fitting.least_squares.smoothness import (
    LEAST,
    MOST,
    SETTLED,
    fellner_schall_weights,
    penalties_of,
    with_penalties,
)
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.priors import weak_prior
from lrm_ident.report.fit import comparison_document
from lrm_ident.residual.error_breakdown import compare
from lrm_ident.study.model_history import as_written
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.effects.curves import AngleCurve, CableCurve
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, RangeTable, parameter_tables, range_table, to_model
from tests.support.sweep import examples

CURVE = "angle_curve@joint2"


def wavy(arm: Arm, count: int = 70, upper: float = 0.1, seed: int = 1, size: float = 0.01) -> Measurements:
    """An arm without other errors whose second joint has waves, measured where that joint is below `upper` (rad)."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.4, 1.4, (count, arm.dof))
    q[:, 1] = rng.uniform(-1.4, upper, count)
    true = q + size * np.sin(5.0 * q) * (np.arange(arm.dof) == 1)
    tcp = solve_equilibrium(model_of(arm, ()), poses_of(true)).tcp + 2e-4 * rng.normal(size=(count, 3))
    return Measurements.of_tcp(poses_of(q), tcp, 2e-4, source=Source(arm=arm))


def curved(arm: Arm) -> Model:
    model = model_of(arm, (*effects_at(arm, "offsets@joint2"), *effects_at(arm, CURVE)))
    keys = (*effects_at(arm, CURVE)[0].keys, "offsets.joint2.theta_rad")
    return replace(model, free=tuple(key for key in model.keys if key in keys))


def test_a_curve_beyond_its_range_stays_as_at_the_edge(lab: Arm) -> None:
    """Every coefficient is fitted, those far beyond the data as well. Before: error grew without bound there."""
    data = wavy(lab)
    fitted = fit(curved(lab), data).model
    assert fitted.within.angle[1] == (data.poses.q[:, 1].min(), data.poses.q[:, 1].max())
    q = np.zeros((40, lab.dof))
    q[:, 1] = np.linspace(0.2, 1.5, 40)
    apart = solve_equilibrium(fitted, poses_of(q)).tcp - solve_equilibrium(model_of(lab, ()), poses_of(q)).tcp
    assert np.linalg.norm(apart, axis=1).max() < 0.02
    assert np.linalg.norm(fit(curved(lab), data).residual, axis=1).max() < 2e-3


def test_models_of_one_structure_keep_their_own_ranges(lab: Arm) -> None:
    """They share an effect's functions at the same poses, but not where these are held within another range."""
    held = fit(curved(lab), wavy(lab)).model
    free, q = replace(held, within=None), np.zeros((40, lab.dof))
    q[:, 1] = np.linspace(0.2, 1.5, 40)
    poses = poses_of(q)
    apart = [solve_equilibrium(model, poses).tcp for model in (held, free, held)]
    assert held.structure is free.structure
    assert np.abs(apart[0] - apart[1]).max() > 1e-3
    np.testing.assert_array_equal(apart[0], apart[2])


def test_coefficients_that_nothing_determines_follow_their_neighbours(lab: Arm) -> None:
    model = fit(curved(lab), wavy(lab)).model
    values = np.array([model.value(key) for key in effects_at(lab, CURVE)[0].keys])
    assert np.abs(np.diff(values, 2)).max() < 0.06
    assert np.abs(values).max() < 0.2


def test_penalties_are_of_forms_only(lab: Arm) -> None:
    plain = replace(curved(lab), free=("offsets.joint2.theta_rad",))
    assert penalties_of(plain) == ()
    prior = weak_prior(plain)
    assert with_penalties(prior, (), np.ones(0)) is prior
    known, curve = penalties_of(curved(lab)), AngleCurve(lab, "joint2")
    assert [penalty.keys for penalty in known] == [curve.keys] * 2
    line = 0.01 * np.arange(len(curve.keys))
    assert line @ known[1].S @ line == pytest.approx(0.0, abs=1e-12)
    both = with_penalties(weak_prior(curved(lab)), known, np.ones(2))
    assert set(both.keys) == set(curved(lab).free)
    assert (both.sd_of(curve.keys) <= curve.parameters[0].typical).all()
    assert [names[0][0] for names in CableCurve(lab, "joint2+joint3").curves] == ["s", "d"]


def test_a_curve_of_which_the_data_show_nothing_is_drawn_to_zero(lab: Arm) -> None:
    """And one of which they do is not: weights by the marginal likelihood."""
    there = wavy(lab, 150, 1.4)
    nothing = there.with_tcp(wavy(lab, 150, 1.4, size=0.0).tcp)
    keys = effects_at(lab, CURVE)[0].keys
    sizes = []
    for data in (there, nothing):
        found = fit(curved(lab), data)
        sizes.append(np.ptp([found.model.value(key) for key in keys]))
        now = fellner_schall_weights(penalties_of(found.model), np.ones(2), found.model, found.covariance)
        assert ((now >= LEAST) & (now <= MOST)).all()
    assert sizes[0] > 0.015
    assert sizes[1] < 5e-4


@examples(6, 12)
@given(st.integers(0, 10**6), st.floats(1e-4, 0.03))
def test_a_fit_ends_where_noise_and_penalties_follow_from_it(lab: Arm, seed: int, size: float) -> None:
    """Fixed point of the marginal likelihood, for waves of any size: weights change by what no longer matters, or are
    at a bound."""
    found = fit(curved(lab), wavy(lab, 90, 1.4, seed, size))
    known = penalties_of(found.model)
    order = [found.prior.keys.index(key) for key in known[0].keys]
    precision = np.linalg.inv(found.prior.covariance)[np.ix_(order, order)]
    stacked = np.stack([penalty.S.reshape(-1) for penalty in known], axis=1)
    weights = np.linalg.lstsq(stacked, precision.reshape(-1))[0]
    next_ones = fellner_schall_weights(known, weights, found.model, found.covariance)
    free = (weights > LEAST * 1.01) & (weights < MOST * 0.99)
    assert (np.abs(np.log(next_ones / weights))[free] < SETTLED + 0.05).all()


def test_the_range_goes_into_the_file_and_back(lab: Arm) -> None:
    model = fit(curved(lab), wavy(lab)).model
    again = as_written(model, "lrm-lab")
    np.testing.assert_allclose(again.within.angle, model.within.angle, rtol=1e-14)
    assert again.within.load == model.within.load
    poses = poses_of(np.random.default_rng(0).uniform(-1.5, 1.5, (8, lab.dof)))
    np.testing.assert_allclose(solve_equilibrium(again, poses).tcp, solve_equilibrium(model, poses).tcp, atol=1e-12)


def file_of(model: Model, table: RangeTable | None) -> ModelFile:
    return ModelFile(
        schema="lrm/model/1", arm="lrm-lab", effects=[CURVE], parameters=parameter_tables(model), range=table
    )


def test_a_file_without_a_range_is_read_as_before_and_a_wrong_one_is_refused(lab: Arm) -> None:
    model = model_of(lab, effects_at(lab, CURVE))
    assert to_model(Path("m.toml"), file_of(model, None), lab).within is None
    good = RangeTable(joints_deg=[[-90.0, 90.0]] * lab.dof, payload_g=[0.0, 0.0], loads={"joint2.theta_Nm": [0, 1]})
    assert to_model(Path("m.toml"), file_of(model, good), lab).within is not None
    for wrong in ({"joints_deg": [[0.0, 1.0]]}, {"payload_g": [1.0, 0.0]}, {"loads": {"joint9.theta_Nm": [0.0, 1.0]}}):
        with pytest.raises(FileError, match="range"):
            to_model(Path("m.toml"), file_of(model, good.model_copy(update=wrong)), lab)
    assert range_table(model) is None


def test_compare_says_how_many_poses_lie_outside(lab: Arm) -> None:
    """And gives their error apart. Before: nothing, or that the fit shrinks the arm."""
    model = fit(curved(lab), wavy(lab)).model
    document = comparison_document(compare(model, wavy(lab, 40, 1.4, seed=5)))
    said = next(str(block) for block in document.blocks if "outside the range" in str(block))
    outside = document.values["outside_range"]
    assert 0 < len(outside) < 40
    assert f"{len(outside)} of 40 poses" in said
    assert "(joint " in said
    assert "shrinks" not in str(document.blocks)


def test_a_step_of_a_fold_that_runs_away_is_fitted_instead(lab: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    data = wavy(lab)
    blocks = [np.arange(k, 70, 5) for k in range(5)]
    splits = [Split.of(rows, 70, 70) for rows in blocks]
    fitted = fit(curved(lab), data)
    steps = list(one_step_fits(fitted, data, splits))
    monkeypatch.setattr("lrm_ident.fitting.cross_validation._equilibrium_or_none", lambda *_: None)
    for rows, stepped, refitted in zip(blocks, steps, one_step_fits(fitted, data, splits), strict=True):
        errors = [np.linalg.norm(data.position_error(equilibrium)[rows]) for equilibrium in (stepped, refitted)]
        assert errors[0] == pytest.approx(errors[1], rel=0.3)
