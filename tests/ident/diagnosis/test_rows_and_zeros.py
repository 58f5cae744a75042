"""Rows that carry a neighbour's position cost no false name; what lies at zero is none; unknown noise is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.candidate_trial import wald_p_value
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.diagnosis.shifted_rows import ShiftedRows, shifted_rows
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_ident.residual.thresholds import MAX_WALD_P
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.effects.backlash import Backlash
from lrm_math.effects.compliance import LateralCompliance
from lrm_math.effects.servo_errors import Eccentricity, ServoGain
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.sweep import examples
from validation.hidden_effects.data import ARM_FILE
from validation.synthetic import GroundTruth, load_arm, measure, random_poses
from validation.synthetic import base_displacement_to_deviations as as_deviations
from validation.synthetic.generate import directions, even_schedule

pytestmark = pytest.mark.usefixtures("one_step_folds")

NOISE, KINDS = 3e-4, (Backlash, ServoGain, Eccentricity, LateralCompliance)


def measured(seed: int, count: int = 200, noise_sd: float | None = NOISE) -> Measurements:
    """An arm without hidden effects."""
    described = load_arm(ARM_FILE)
    truth = as_deviations(described, GroundTruth.random(described, seed, ()))
    q, number = random_poses(described, count, seed, floor_m=0.1), np.arange(1, count + 1)
    plan, load = even_schedule(*q.shape), np.random.default_rng(seed).choice([0.0, 0.0663], count)
    tcp = measure(described, truth, q, load, NOISE, seed, plan)
    poses = Poses(q, load, directions(q, np.zeros(6)), plan.time_s)
    return Measurements(poses, number, tcp, None, noise_sd, number, Path("synthetic.csv"), "")


def base_fit(arm: Arm, data: Measurements) -> Model:
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    return fit_identifiable(model, data, model.keys).fit.model


@given(
    st.integers(0, 10_000),
    st.integers(2, 12),
    st.sampled_from([1, -1]),
    st.integers(1, 30),
)
def test_a_block_that_carries_its_neighbours_positions_is_found_and_no_other(
    seed: int, length: int, shift: int, first: int
) -> None:
    rng = np.random.default_rng(seed)
    predicted = rng.uniform(-0.3, 0.3, (60, 3))
    measured = predicted + rng.normal(0.0, NOISE, (60, 3))
    rows = np.arange(first, first + length)
    measured[rows] = predicted[rows - shift] + rng.normal(0.0, NOISE, (length, 3))
    found = shifted_rows(np.arange(1, 61), measured, predicted, 20 * NOISE)
    assert found == (ShiftedRows(first + 1, first + length, shift),)


@pytest.mark.slow
def test_shifted_rows_are_said_and_no_name_takes_what_came_free_without_them(lab: Arm) -> None:
    """Before: a link that bends by 0 ± 0, from 8.69 to 0.55 mm, since 27 parameters came free with it."""
    data = measured(3)
    tcp, rows = data.tcp.copy(), np.arange(99, 114)
    tcp[rows] = data.tcp[rows - 1]
    slipped = replace(data, tcp=tcp)
    found = diagnose(base_fit(lab, slipped), slipped, KINDS)
    report = build_report(found)
    assert report.first is None
    assert found.fit.sigma < 1.1 * NOISE
    assert found.shifted == (ShiftedRows(100, 114, 1),)
    assert "Poses 100 to 114 look shifted by one row" in str(diagnosis_document(report).blocks)


@pytest.mark.long
@examples(2, 5)
@given(st.integers(0, 1000))
def test_a_model_whose_parameters_all_lie_at_bounds_is_diagnosed(lab: Arm, seed: int) -> None:
    """An arm that rises under its load, as far as a fit to shifted rows can tell: springs cannot be negative."""
    springs = model_of(lab, effects_at(lab, "compliance"))
    rng, data = np.random.default_rng(seed), measured(seed, 60)
    bent = springs.with_values(rng.uniform(0.01, 0.05, len(springs.keys)))
    rigid, sagged = (solve_equilibrium(each, data.poses).tcp for each in (springs, bent))
    risen = replace(data, tcp=2.0 * rigid - sagged)
    found = diagnose(fit(springs.with_free(springs.keys), risen).model, risen, KINDS)
    assert set(found.fit.at_bound) == set(found.fit.model.free)
    np.testing.assert_allclose(found.fit.residual, risen.tcp - rigid, atol=1e-9)
    assert found.scored


@pytest.mark.long
@examples(2, 5)
@given(st.integers(0, 1000))
def test_the_probability_of_zero_is_that_of_the_students_deviations(lab: Arm, seed: int) -> None:
    """One parameter: two deviations are the limit. Of none: certain."""
    model = model_of(lab, effects_at(lab, "offsets"))
    fitted = fit_identifiable(model, measured(seed, 80), model.keys).fit
    for key, error in zip(fitted.model.free, fitted.standard_error, strict=True):
        deviations = abs(fitted.model.value(key)) / error
        assert (wald_p_value(fitted, [key]) > MAX_WALD_P) == (deviations < 2.0) or deviations == (
            pytest.approx(2.0, abs=1e-3)
        )
    assert wald_p_value(fitted, ()) == 1.0


@pytest.mark.slow
def test_without_a_known_noise_nothing_missing_is_never_said(lab: Arm) -> None:
    data = measured(4)
    model = base_fit(lab, data)
    assert build_report(diagnose(model, data, KINDS)).verdict == "nothing_missing"
    blind = replace(data, noise_sd=None)
    report = build_report(diagnose(model, blind, KINDS))
    assert report.verdict == "noise_unknown"
    assert "noise at most" in str(diagnosis_document(report).blocks)
