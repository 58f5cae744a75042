"""Total derivatives through the equilibrium, against central differences of the equilibrium itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.effects.base import Effect, Parameter
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.random_arms import arms

TIGHT = 1e-14
RELATIVE = 1e-6
SMOOTH = [kind for kind in CATALOGUE if kind.id != "quantisation"]  # a staircase has no derivative


def full_model(arm: Arm, seed: int) -> Model:
    """Every effect of the catalogue at every place, with sizes that are typical of printed arms."""
    effects = [effect for kind in SMOOTH for effect in effects_at(arm, kind.id)]
    model = model_of(arm, effects)
    size = np.random.default_rng(seed).uniform(0.1, 0.5, len(model.keys))
    values = [p.default or s * p.typical for p, s in zip(model.parameters, size, strict=True)]
    return model.with_values(values)


def some_poses(arm: Arm, seed: int, count: int) -> Poses:
    rng = np.random.default_rng(seed)
    return poses_of(rng.uniform(-1.7, 1.7, (count, arm.dof)), rng.choice([0.0, 0.0663], count))


def assert_parameter_derivatives(model: Model, poses: Poses, first: int = 0, every: int = 1) -> None:
    """Of all parameters, or of every n-th after the `first` one."""
    rest = equilibrium(model, poses, tolerance=TIGHT)
    J = parameter_jacobian(rest)
    for j in range(first % every, len(model.keys), every):
        parameter = model.parameters[j]
        h = 1e-4 * (parameter.fixed or parameter.typical)
        step = h * (np.arange(len(model.keys)) == j)
        plus = equilibrium(model.with_values(model.values + step), poses, rest, TIGHT).tcp
        minus = equilibrium(model.with_values(model.values - step), poses, rest, TIGHT).tcp
        difference = (plus - minus) / (2 * h)
        round_off = 1e-15 / h
        allowed = RELATIVE * np.abs(difference).max() + round_off
        assert np.abs(J[:, :, j] - difference).max() <= allowed, model.keys[j]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_parameters_of_the_lab_arm(lab: Arm, seed: int) -> None:
    assert_parameter_derivatives(full_model(lab, seed), some_poses(lab, seed, 20), seed, 2)


@pytest.mark.slow
@settings(max_examples=6)
@given(arms, st.integers(0, 100))
def test_parameters_of_any_arm(arm: Arm, seed: int) -> None:
    model = full_model(arm, seed)
    calm = [e for e in model.effects if e.id != "backlash"]
    smaller = model_of(arm, calm, {k: 0.2 * model.value(k) for k in model.keys if not k.startswith("backlash")})
    assert_parameter_derivatives(smaller, some_poses(arm, seed, 4), seed, 8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_joint_angles(lab: Arm, seed: int) -> None:
    model, poses = full_model(lab, seed), some_poses(lab, seed, 40)
    J = joint_jacobian(equilibrium(model, poses, tolerance=TIGHT))
    h = 1e-6
    for joint in range(6):
        plus = equilibrium(model, poses.perturbed(joint, h), tolerance=TIGHT).tcp
        minus = equilibrium(model, poses.perturbed(joint, -h), tolerance=TIGHT).tcp
        difference = (plus - minus) / (2 * h)
        assert np.abs(J[:, :, joint] - difference).max() <= RELATIVE * np.abs(difference).max()


class Wobble(Effect):
    """A user's effect without derivatives of its own that depends on two joints and a load."""

    id = "wobble"
    cause = "For this test."
    formula = "δq3 = a sin(q1 + q4) + b τ3³"
    source = "none"
    parameters = (Parameter("a_rad", "size", 0.02), Parameter("b_rad_per_Nm", "stiffening", 0.05))  # type: ignore[assignment]
    moves = ("joint3.theta",)  # type: ignore[assignment]
    feels = ("joint3.theta",)  # type: ignore[assignment]

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return ("joint3",)

    def motion(self, poses: Poses, tau: tuple[Number, ...], p: list[float]) -> tuple[Number, ...]:  # type: ignore[override]
        return (p[0] * np.sin(poses.angle(0) + poses.angle(3)) + p[1] * tau[0] ** 3,)


def test_an_effect_without_derivatives_of_its_own(lab: Arm) -> None:
    effects = (*effects_at(lab, "compliance"), Wobble(lab, "joint3"))
    values = {"wobble.joint3.a_rad": 0.02, "wobble.joint3.b_rad_per_Nm": 0.1, "compliance.joint3.k_rad_per_Nm": 0.08}
    model, poses = model_of(lab, effects, values), some_poses(lab, 5, 20)
    assert_parameter_derivatives(model, poses)
    J = joint_jacobian(equilibrium(model, poses, tolerance=TIGHT))
    for joint in range(6):
        plus, minus = (equilibrium(model, poses.perturbed(joint, h), tolerance=TIGHT).tcp for h in (1e-6, -1e-6))
        np.testing.assert_allclose(J[:, :, joint], (plus - minus) / 2e-6, atol=2e-8)


@pytest.mark.parametrize("kind", SMOOTH, ids=lambda kind: kind.id)
def test_effects_give_the_derivatives_of_their_own_motion(lab: Arm, kind: type[Effect]) -> None:
    poses = some_poses(lab, 7, 30)
    rng = np.random.default_rng(7)
    for effect in effects_at(lab, kind.id):
        tau = tuple(rng.normal(0, 0.3, 30) for _ in effect.feels)
        p = [parameter.fixed or 0.4 * parameter.typical for parameter in effect.parameters]
        for name in ("d_parameters", "d_tau", "d_q"):
            given_rows = getattr(effect, name)(poses, tau, p)
            numeric_rows = getattr(Effect, name)(effect, poses, tau, p)
            for ours, numeric in zip(given_rows, numeric_rows, strict=True):
                for a, b in zip(ours, numeric, strict=True):
                    np.testing.assert_allclose(np.broadcast_to(a, 30), np.broadcast_to(b, 30), rtol=1e-6, atol=1e-9)
