"""A model that goes back to one without its empirical terms beyond a measured range: prediction and inverse."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.study.model_history import as_written
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.reversion import CORRELATED, Reversion
from lrm_math.errors import FileError
from lrm_math.ik.methods import Direct
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, parameter_tables, range_table, to_model
from lrm_math.model.uncertainty import open_covariance
from tests.ik.test_residual_field import answers_reach_goals

LAB = load_arm("lrm-lab")
LOWER, UPPER = (np.array([getattr(joint, end) for joint in LAB.joints]) for end in ("lower", "upper"))
TERMS = ("coupling_curve@joint3<-joint1", "base_curve@base")
EDGE = 0.2
"""rad: the lowest measured angle of joint 4."""


def model() -> Model:
    """Offsets, springs and play, with a curve of the arm and one of the base that hold above an angle of joint 4."""
    names = ("offsets", "compliance", "backlash@joint2", *TERMS)
    plain = model_of(LAB, [effect for name in names for effect in effects_at(LAB, name)])
    sizes = np.array([0.3 * p.typical for p in plain.parameters]) * np.random.default_rng(1).uniform(0.2, 1.0, 1)
    plain = plain.with_values(np.where([p.fixed is None for p in plain.parameters], sizes, plain.values))
    changes = {key: -plain.value(key) for effect in plain.effects if effect.name in TERMS for key in effect.keys}
    changes |= {"offsets.joint3.theta_rad": 0.004, "compliance.joint2.k_rad_per_Nm": 0.003}
    ends = ((-math.inf, math.inf),) * 3 + ((EDGE, math.inf),) + ((-math.inf, math.inf),) * (LAB.dof - 4)
    angle = tuple(zip(LOWER.tolist(), UPPER.tolist(), strict=True))
    within = MeasuredRange((*angle[:3], (EDGE, UPPER[3]), *angle[4:]), (0.0, 0.1))
    return replace(plain, within=replace(within, reversion=Reversion(TERMS, ends, changes)))


MODEL = model()
THERE = replace(MODEL, within=replace(MODEL.within, reversion=None))


def away() -> Model:
    """The model far beyond the range."""
    changes = MODEL.within.reversion.changes
    return THERE.with_values_of([*changes], [THERE.value(key) + change for key, change in changes.items()])


def at(joint4: Array | float, count: int = 20) -> Poses:
    q = np.random.default_rng(2).uniform(0.6 * LOWER, 0.6 * UPPER, (count, LAB.dof))
    q[:, 3] = joint4
    return poses_of(q)


def test_within_the_range_it_is_the_model_and_far_beyond_that_without_the_terms() -> None:
    inside = at(np.linspace(EDGE, UPPER[3], 20))
    np.testing.assert_array_equal(solve_equilibrium(MODEL, inside).tcp, solve_equilibrium(THERE, inside).tcp)
    assert not open_covariance(solve_equilibrium(MODEL, inside)).any()
    beyond = at(EDGE - 20 * CORRELATED)
    np.testing.assert_allclose(solve_equilibrium(MODEL, beyond).tcp, solve_equilibrium(away(), beyond).tcp, atol=1e-8)


def test_its_standard_error_grows_from_zero_to_the_difference_of_both_models() -> None:
    course = at(np.linspace(EDGE, EDGE - 20 * CORRELATED, 20))
    course = poses_of(np.where(np.arange(LAB.dof) == 3, course.q, course.q[0]))
    spread = np.sqrt(np.trace(open_covariance(solve_equilibrium(MODEL, course)), axis1=1, axis2=2))
    apart = np.linalg.norm(solve_equilibrium(THERE, course).tcp - solve_equilibrium(away(), course).tcp, axis=1)
    assert spread[0] == 0.0
    assert (spread[1:] > 0.0).all()
    assert spread[-1] == pytest.approx(apart[-1], rel=1e-6)


def test_derivatives_by_the_angles_are_those_of_the_prediction_and_continuous() -> None:
    for angle in (EDGE + 0.1, EDGE, EDGE - 1e-4, EDGE - 0.3):
        poses, h = at(angle, 3), 1e-6
        J = joint_jacobian(solve_equilibrium(MODEL, poses, tolerance=1e-14))
        sides = [solve_equilibrium(MODEL, poses.perturbed(3, step), tolerance=1e-14).tcp for step in (h, -h)]
        np.testing.assert_allclose(J[:, :, 3], (sides[0] - sides[1]) / (2 * h), atol=1e-6)


@pytest.mark.long
def test_answers_of_the_inverse_reach_their_goals_beyond_the_edge() -> None:
    goals = np.random.default_rng(5).uniform(0.8 * LOWER, 0.8 * UPPER, (10, LAB.dof))
    answers_reach_goals(MODEL, goals, 0.2 * UPPER, Direct())


def test_it_goes_into_the_file_and_back_and_a_wrong_one_is_refused() -> None:
    poses = at(np.linspace(LOWER[3], UPPER[3], 20))
    again = as_written(MODEL, "lrm-lab")
    np.testing.assert_allclose(solve_equilibrium(again, poses).tcp, solve_equilibrium(MODEL, poses).tcp, atol=1e-12)
    table = range_table(MODEL)
    assert table is not None
    for wrong in ({"terms": ["drift@joint1"]}, {"below_deg": {"joint9": 0.0}}, {"changes": {"mass.link1.m_g": 1.0}}):
        spoiled = table.model_copy(update={"reversion": table.reversion.model_copy(update=wrong)})  # type: ignore[union-attr]
        names = [effect.name for effect in MODEL.effects]
        file = ModelFile(
            schema="lrm/model/1", arm="lrm-lab", effects=names, parameters=parameter_tables(MODEL), range=spoiled
        )
        with pytest.raises(FileError, match=r"range\.reversion"):
            to_model(Path("m.toml"), file, LAB)


def test_without_one_of_its_terms_a_model_does_not_go_back() -> None:
    effects = [effect for effect in MODEL.effects if effect.name != TERMS[0]]
    less = replace(
        model_of(LAB, effects, {key: MODEL.value(key) for effect in effects for key in effect.keys}),
        within=MODEL.within,
    )
    beyond = at(EDGE - 1.0)
    np.testing.assert_array_equal(
        solve_equilibrium(less, beyond).tcp, solve_equilibrium(replace(less, within=THERE.within), beyond).tcp
    )
