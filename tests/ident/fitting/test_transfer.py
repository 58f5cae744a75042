"""Transfer of a calibrated arm: its part goes along with its covariance, its installation is found from few poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.design.installation import FEW, expected_errors, installation_poses
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.transfer import TransferredModel, transferred
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart, effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.covariance import Covariance
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import measured_range, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.session_state import StateAfterSession
from lrm_math.model.uncertainty import expected_tip_error
from tests.support.sweep import examples

LAB, ROVER = load_arm("lrm-lab"), load_arm("lrm-rover")
NOISE = 3e-4
SMALL = 0.01
"""Standard error of the arm's parameters, in typical sizes."""


def lab_model(seed: int, *more: str) -> tuple[Model, Covariance]:
    """A random arm on the rig, and a covariance of its parameters."""
    rng = np.random.default_rng(seed)
    effects = [one for name in ("offsets", "compliance", *more) for one in effects_at(LAB, name)]
    empty = model_of(LAB, effects)
    typical = np.array([p.typical for p in empty.parameters])
    plain = [k for k, p in enumerate(empty.parameters) if p.fixed is None]
    values = empty.values.copy()
    values[plain] = np.abs(0.3 * typical[plain] * rng.normal(size=len(plain)))
    mixed = SMALL * typical[plain, None] * rng.normal(size=(len(plain), len(plain))) / np.sqrt(len(plain))
    model = empty.with_values(values)
    q = rng.uniform(-1.2, 1.2, (40, LAB.dof))
    within = measured_range(solve_equilibrium(model, poses_of(q)))
    covariance = mixed @ mixed.T + (SMALL * np.diag(typical[plain])) ** 2
    return replace(model, within=within), Covariance(tuple(model.keys[k] for k in plain), covariance)


def measured(model: Model, q: Array, seed: int = 0) -> Measurements:
    """Measurements of a model's arm at commands (rad)."""
    tcp = solve_equilibrium(model, poses_of(q)).tcp
    noise = np.random.default_rng(seed).normal(0.0, NOISE, tcp.shape)
    return Measurements.of_tcp(poses_of(q), tcp + noise, NOISE, source=Source(arm=model.arm))


def on_the_rover(start: TransferredModel, seed: int) -> Model:
    """The true arm on the rover: installation and arm drawn from what is known of them."""
    keys, matrix = start.covariance
    shift = np.random.default_rng(seed).multivariate_normal(np.zeros(len(keys)), matrix)
    values = np.array([start.model.value(key) for key in keys]) + shift
    lower = np.array([start.model.parameter(key).lower for key in keys])
    return start.model.with_values_of(keys, np.maximum(values, lower))


@given(st.integers(0, 2**31))
@examples(2, 5)
def test_the_arms_part_goes_along_and_nothing_of_the_rig(seed: int) -> None:
    model, known = lab_model(seed, "backlash@joint2", "base_compliance", "base_curve")
    start = transferred(model, known, ROVER, NOISE)
    own = [key for effect in model.effects if effect.part is ModelPart.ARM for key in effect.keys]
    np.testing.assert_array_equal([start.model.value(key) for key in own], [model.value(key) for key in own])
    assert all(start.model.value(key) == 0.0 for key in start.installed)
    assert {"offsets.base.alpha_rad", "offsets.tool.z_mm", "gravity.base.x_rad"} < {*start.installed}
    assert "base_compliance.base.k_x_rad_per_Nm" in start.installed, "a bench that rocks: how much, here?"
    assert "base_curve@base" in start.left_behind, "few poses cannot tell another curve"
    free = [key for key in own if key in known.keys]
    assert [*start.prior.keys] == [*free, *start.installed]
    rows = [known.keys.index(key) for key in free]
    marginal = known.matrix[np.ix_(rows, rows)]
    np.testing.assert_allclose(start.prior.covariance_of(free), marginal, rtol=1e-6, atol=1e-18)
    assert not start.prior.covariance[: len(free), len(free) :].any(), "independent"
    assert start.model.arm == ROVER
    assert start.model.within is not None
    assert start.model.within.angle == model.within.angle if model.within else False


def test_effects_of_the_measurement_stay_behind_and_their_state_goes_along() -> None:
    model, known = lab_model(1, "drift@joint2", "measurement_frame")
    state = StateAfterSession({"drift@joint2": "last"}, {"offsets.joint2.theta_rad": 0.02, "offsets.base.x_mm": 0.001})
    start = transferred(model.with_state(state), known, ROVER, NOISE)
    assert start.model.value("offsets.joint2.theta_rad") == model.value("offsets.joint2.theta_rad") + 0.02
    assert start.model.value("offsets.base.x_mm") == 0.0, "the rig's"
    assert {"drift@joint2", "measurement_frame@frame"} < {*start.left_behind}
    assert not {"drift", "measurement_frame"} & {effect.id for effect in start.model.effects}
    assert start.state == "The deployed model keeps the last state of drift@joint2."


def test_another_arm_is_refused_with_the_value_that_differs() -> None:
    model, known = lab_model(1)
    longer = replace(ROVER.joints[2], d=0.05)
    other: Arm = replace(ROVER, joints=(*ROVER.joints[:2], longer, *ROVER.joints[3:]))
    with pytest.raises(LrmError, match=r"joint 3: d is 43\.0695 mm in lrm-lab, 50 mm in lrm-rover"):
        transferred(model, known, other, NOISE)


@pytest.mark.long
def test_few_poses_find_the_installation_and_the_error_is_as_expected() -> None:
    """Over arms that are as is known of them, the tip's error at 0, 3, 6, 12 poses is what was expected."""
    model, known = lab_model(2)
    start = transferred(model, known, ROVER, NOISE)
    expected = expected_errors(start)
    assert [*expected] == [0, 3, FEW, 12]
    assert sorted(expected.values(), reverse=True) == [*expected.values()]
    assert expected[FEW] < 0.05 * expected[0]
    fresh = poses_of(np.random.default_rng(5).uniform(-1.2, 1.2, (60, ROVER.dof)))
    q, squares = installation_poses(start, FEW).q, []
    for seed in range(8):
        truth = on_the_rover(start, seed)
        found = fit(start.model, measured(truth, q, seed), prior=start.prior).model
        apart = solve_equilibrium(found, fresh).tcp - solve_equilibrium(truth, fresh).tcp
        squares.append((apart**2).sum(axis=1).mean())
    assert 0.5 * expected[FEW] < np.sqrt(np.mean(squares)) < 2.0 * expected[FEW]


@pytest.mark.long
def test_poses_are_chosen_where_the_model_is_known() -> None:
    model, known = lab_model(2)
    start = transferred(model, known, ROVER, NOISE)
    assert not start.model.within.outside(installation_poses(start, FEW).q).any()


@pytest.mark.long
def test_a_fit_with_the_prior_of_an_earlier_one_keeps_its_noise_and_range() -> None:
    model, known = lab_model(3, "cable_curve@joint1+joint2")
    start = transferred(model, known, ROVER, NOISE)
    few = measured(on_the_rover(start, 1), installation_poses(start, 2).q)
    found = fit(start.model, few, prior=start.prior)
    assert found.model.within == start.model.within
    assert found.prior.keys == start.prior.keys, "no penalty is counted twice"
    assert np.all(np.diag(found.covariance) <= np.diag(start.prior.covariance) * (1.0 + 1e-6))


def test_expected_covariance_is_that_of_the_posterior_where_the_prior_is_the_truth() -> None:
    model, known = lab_model(4)
    start = replace(transferred(model, known, ROVER, NOISE), installed=())
    J = parameter_jacobian(solve_equilibrium(start.model, poses_of(np.eye(6))), start.covariance.keys)
    rows = J.reshape(-1, J.shape[2])
    typical = np.array([start.model.parameter(key).typical for key in start.covariance.keys])
    information = np.linalg.inv(start.covariance.matrix / np.outer(typical, typical))
    information += (rows * typical).T @ (rows * typical) / NOISE**2
    posterior = np.linalg.inv(information) * np.outer(typical, typical)
    after = start.informed(J)
    np.testing.assert_allclose(
        after.matrix / np.outer(typical, typical), posterior / np.outer(typical, typical), atol=1e-9
    )
    assert expected_tip_error(start.model, after) < expected_tip_error(start.model, start.covariance)
