"""Derivatives of the tool's attitude and of the joints' feedback through the equilibrium, by central differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.sensed import Sensed, encoder_angles, tool_rotation
from tests.support.random_arms import random_arm

NAMES = (
    "offsets",
    "compliance",
    "servo_droop",
    "lateral_compliance",
    "servo_gain@joint2",
    "payload",
    "measurement_frame",
)


def soft_model(seed: int) -> Model:
    arm = random_arm(seed, 4)
    model = model_of(arm, [effect for name in NAMES for effect in effects_at(arm, name)])
    size = np.random.default_rng(seed).uniform(0.1, 0.4, len(model.keys))
    return model.with_values([p.default or s * p.typical for p, s in zip(model.parameters, size, strict=True)])


def seen(model: Model, q: Array, origin: Array) -> Array:
    equilibrium = solve_equilibrium(model, poses_of(q, 0.05), tolerance=1e-14)
    turned = Rotation.from_matrix(tool_rotation(equilibrium) @ origin.transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([equilibrium.tcp, turned, encoder_angles(equilibrium)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_attitude_and_feedback(seed: int) -> None:
    model = soft_model(seed)
    q = np.random.default_rng(seed).uniform(-1.2, 1.2, (6, 4))
    equilibrium = solve_equilibrium(model, poses_of(q, 0.05), tolerance=1e-14)
    origin = tool_rotation(equilibrium)
    J = parameter_jacobian(equilibrium, sensed=Sensed(attitude=True, feedback=True))
    assert J.shape == (6, 10, len(model.keys))
    np.testing.assert_array_equal(J[:, :3], parameter_jacobian(equilibrium))
    for j, parameter in enumerate(model.parameters):
        h = 1e-4 * (parameter.fixed or parameter.typical)
        step = h * (np.arange(len(model.keys)) == j)
        plus, minus = (seen(model.with_values(model.values + s * step), q, origin) for s in (1, -1))
        difference = (plus - minus) / (2 * h)
        allowed = 1e-6 * np.abs(difference).max() + 3e-15 / h
        assert np.abs(J[:, :, j] - difference).max() <= allowed, model.keys[j]


def test_droop_is_a_compliance_that_the_encoder_reads() -> None:
    arm = random_arm(5, 3)
    droop = model_of(arm, effects_at(arm, "servo_droop@joint2"), {"servo_droop.joint2.k_rad_per_Nm": 0.08})
    flex = model_of(arm, effects_at(arm, "compliance@joint2"), {"compliance.joint2.k_rad_per_Nm": 0.08})
    poses = poses_of(np.random.default_rng(0).uniform(-1, 1, (8, 3)))
    one, other = solve_equilibrium(droop, poses), solve_equilibrium(flex, poses)
    np.testing.assert_allclose(one.tcp, other.tcp, atol=1e-12)
    np.testing.assert_allclose((encoder_angles(one) - poses.q)[:, 1], 0.08 * one.tau[0], atol=1e-15)
    np.testing.assert_array_equal(encoder_angles(other), poses.q)
