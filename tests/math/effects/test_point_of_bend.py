"""The point at which a link bends: a hinge anywhere along it, the derivative by it, files that do not state it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.effects.compliance import LateralCompliance
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.conftest import EXAMPLE
from validation.hidden_effects.data import ARM_FILE
from validation.synthetic import GroundTruth, HingedLink, load_arm, measure

K_X, K_Y = 0.02, 0.01
LENGTH_M = {2: 0.1036, 4: 0.1078}
"""By link of the lab's arm."""


def some_poses(arm: Arm, count: int = 12) -> Poses:
    return poses_of(np.random.default_rng(1).uniform(-1.5, 1.5, (count, arm.dof)), 0.05)


def bending(arm: Arm, link: int, s: float) -> Model:
    return model_of(arm, effects_at(arm, f"lateral_compliance@link{link}")).with_values([K_X, K_Y, s])


@pytest.mark.long
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([2, 4]), st.floats(0.0, 1.0))
def test_it_moves_the_tip_as_one_hinge_of_the_independent_generator(lab: Arm, link: int, s: float) -> None:
    """To first order: what differs is at most 1 % of what it moves."""
    poses = some_poses(lab)
    ours = solve_equilibrium(bending(lab, link, s), poses).tcp - solve_equilibrium(model_of(lab, ()), poses).tcp
    described = load_arm(ARM_FILE)
    rigid = GroundTruth.nominal(described)
    hinge = HingedLink(link, (1.0 - s) * LENGTH_M[link], (K_X, K_Y))
    bent = GroundTruth(rigid.deviations, rigid.displacements, 0.0, rigid.joint_compliance_rad_per_nm, (hinge,))
    theirs = measure(described, bent, poses.q, 0.05) - measure(described, rigid, poses.q, 0.05)
    assert np.abs(theirs).max() > 3e-4
    np.testing.assert_allclose(ours, theirs, atol=0.01 * np.abs(theirs).max())


@pytest.mark.parametrize("s", [0.0, 0.25, 0.5, 0.8, 1.0])
def test_the_derivative_by_the_point_is_that_of_the_equilibrium(lab: Arm, s: float) -> None:
    poses, h = some_poses(lab), 1e-4
    J = parameter_jacobian(solve_equilibrium(bending(lab, 2, s), poses, tolerance=1e-14))
    up, down = (solve_equilibrium(bending(lab, 2, s + side), poses, tolerance=1e-14).tcp for side in (h, -h))
    slope = (up - down) / (2.0 * h)
    assert np.abs(slope).max() > 1e-4
    np.testing.assert_allclose(J[:, :, 2], slope, atol=1e-5 * np.abs(slope).max())


def test_at_the_middle_only_the_middle_moves(lab: Arm) -> None:
    effect = LateralCompliance(lab, "link2")
    assert effect.compliances((K_X, K_Y, 0.5)) == (K_X, K_Y, 0.0, 0.0, 0.0, 0.0)
    assert effect.compliances((K_X, K_Y, 0.0)) == (0.0, 0.0, K_X, K_Y, 0.0, 0.0)
    assert effect.compliances((K_X, K_Y, 1.0)) == (0.0, 0.0, 0.0, 0.0, K_X, K_Y)


@pytest.mark.long
def test_a_file_from_before_bends_at_the_middle(tmp_path: Path) -> None:
    """Its parameters, and those in its history, do not state the point."""
    data = lrm.load(EXAMPLE)
    study = lrm.Study.of(data).fit().add("lateral_compliance@link2")
    now, before = tmp_path / "now.toml", tmp_path / "before.toml"
    study.save(now)
    lines = now.read_text().splitlines(keepends=True)
    stated = [line for line in lines if "link2.s_ratio" in line]
    assert len(stated) >= 2, "in the parameters and in the history"
    before.write_text("".join(line for line in lines if line not in stated))
    old = lrm.load_model(before)
    key = "lateral_compliance.link2.s_ratio"
    assert old.value(key) == 0.5
    at_middle = lrm.load_model(now).with_values_of([key], [0.5])
    expected, found = (solve_equilibrium(model, data.poses).tcp for model in (at_middle, old))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert lrm.read_study(before, EXAMPLE).model.value(key) == 0.5
