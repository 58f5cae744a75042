"""Total derivatives through the equilibrium, attitude and feedback too, against central differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, FREE_FORMS, Description, LoadedJointEffect, effects_at
from lrm_math.effects.base import Effect, Parameter
from lrm_math.effects.derivatives import STEP, by_angles, by_loads, by_parameters
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian, respond
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.sensed import encoder_angles
from tests.support.random_arms import arms, random_arm, some_poses
from tests.support.sweep import seeds

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


def assert_parameter_derivatives(model: Model, poses: Poses, first: int = 0, every: int = 1) -> None:
    """Checks all parameters, or of every n-th after the `first` one."""
    equilibrium = solve_equilibrium(model, poses, tolerance=TIGHT)
    J = parameter_jacobian(equilibrium)
    for j in range(first % every, len(model.keys), every):
        parameter = model.parameters[j]
        h = 1e-4 * (parameter.fixed or parameter.typical)
        step = h * (np.arange(len(model.keys)) == j)
        plus = solve_equilibrium(model.with_values(model.values + step), poses, equilibrium, TIGHT).tcp
        minus = solve_equilibrium(model.with_values(model.values - step), poses, equilibrium, TIGHT).tcp
        difference = (plus - minus) / (2 * h)
        round_off = 1e-15 / h
        allowed = RELATIVE * np.abs(difference).max() + round_off
        assert np.abs(J[:, :, j] - difference).max() <= allowed, model.keys[j]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1, 4))
def test_parameters_of_the_lab_arm(lab: Arm, seed: int) -> None:
    assert_parameter_derivatives(full_model(lab, seed), some_poses(lab, seed, 20), seed, 4)


@pytest.mark.slow
def test_parameters_of_an_arm_that_carries_a_load_aside(lab: Arm) -> None:
    poses = some_poses(lab, seed=4, count=3)
    assert poses.payload.any()
    assert_parameter_derivatives(full_model(lab.with_load_at((0.04, -0.03, 0.06)), seed=4), poses, every=8)


@pytest.mark.slow
@settings(max_examples=3)
@given(arms, st.integers(0, 100))
def test_parameters_of_any_arm(arm: Arm, seed: int) -> None:
    model = full_model(arm, seed)
    calm = [e for e in model.effects if e.id != "backlash"]
    smaller = model_of(arm, calm, {k: 0.2 * model.value(k) for k in model.keys if not k.startswith("backlash")})
    assert_parameter_derivatives(smaller, some_poses(arm, seed, 4), seed, 8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(2, 3))
def test_joint_angles(lab: Arm, seed: int) -> None:
    model, poses = full_model(lab, seed), some_poses(lab, seed, 40)
    J = joint_jacobian(solve_equilibrium(model, poses, tolerance=TIGHT))
    h = 1e-6
    for joint in range(6):
        plus = solve_equilibrium(model, poses.perturbed(joint, h), tolerance=TIGHT).tcp
        minus = solve_equilibrium(model, poses.perturbed(joint, -h), tolerance=TIGHT).tcp
        difference = (plus - minus) / (2 * h)
        assert np.abs(J[:, :, joint] - difference).max() <= RELATIVE * np.abs(difference).max()


class Wobble(Effect):
    """A user's effect without derivatives of its own that depends on two joints and a load."""

    id = "wobble"
    about = Description("For this test.", "δq3 = a sin(q1 + q4) + b τ3³", "none")
    parameters = (Parameter("a_rad", "size", 0.02), Parameter("b_rad_per_Nm", "stiffening", 0.05))  # type: ignore[assignment]
    targets = ("joint3.theta",)  # type: ignore[assignment]
    load_slots = ("joint3.theta",)  # type: ignore[assignment]

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return ("joint3",)

    def amounts(self, poses: Poses, tau: tuple[Number, ...], p: list[float]) -> tuple[Number, ...]:  # type: ignore[override]
        return (p[0] * np.sin(poses.angle(0) + poses.angle(3)) + p[1] * tau[0] ** 3,)


def test_an_effect_without_derivatives_of_its_own(lab: Arm) -> None:
    effects = (*effects_at(lab, "compliance"), Wobble(lab, "joint3"))
    values = {"wobble.joint3.a_rad": 0.02, "wobble.joint3.b_rad_per_Nm": 0.1, "compliance.joint3.k_rad_per_Nm": 0.08}
    model, poses = model_of(lab, effects, values), some_poses(lab, 5, 20)
    assert_parameter_derivatives(model, poses)
    J = joint_jacobian(solve_equilibrium(model, poses, tolerance=TIGHT))
    for joint in range(6):
        plus, minus = (solve_equilibrium(model, poses.perturbed(joint, h), tolerance=TIGHT).tcp for h in (1e-6, -1e-6))
        np.testing.assert_allclose(J[:, :, joint], (plus - minus) / 2e-6, atol=2e-8)


def assert_has_the_derivatives_of_its_amounts(
    effect: Effect, poses: Poses, tau: tuple[Array, ...], p: list[float], rtol: float
) -> None:
    """By parameters, loads and angles."""
    exact = (by(effect, poses, tau, p) for by in (by_parameters, by_loads, by_angles))
    for ours, theirs in zip(exact, differences(effect, poses, tau, p), strict=True):
        for rows, numeric in zip(ours, theirs, strict=True):
            for a, b in zip(rows, numeric, strict=True):
                np.testing.assert_allclose(np.broadcast_to(a, len(poses)), b, rtol=rtol, atol=1e-3 * rtol)


@pytest.mark.parametrize("kind", [*SMOOTH, *FREE_FORMS], ids=lambda kind: kind.id)
def test_effects_have_the_derivatives_of_their_own_amounts(lab: Arm, kind: type[Effect]) -> None:
    """Against central differences, whoever wrote the basis."""
    poses = some_poses(lab, 7, 30)
    rng = np.random.default_rng(7)
    for effect in effects_at(lab, kind.id)[:8]:
        tau = tuple(rng.normal(0, 0.3, 30) for _ in effect.load_slots)
        p = [parameter.fixed or 0.4 * parameter.typical for parameter in effect.parameters]
        assert_has_the_derivatives_of_its_amounts(effect, poses, tau, p, 1e-6)


def test_newtons_steps_end_in_the_same_equilibrium(lab: Arm) -> None:
    """Fewer of them, since the loads at an equilibrium nearby are known."""
    poses, model = some_poses(lab, 0, 20), full_model(lab, 0)
    near, moved = solve_equilibrium(model, poses), model.with_values(1.01 * model.values)
    plain = solve_equilibrium(moved, poses, near, 1e-12)
    newton = solve_equilibrium(moved, poses, near, 1e-12, respond(near).preconditioner)
    np.testing.assert_allclose(newton.tcp, plain.tcp, rtol=0.0, atol=1e-11)
    assert newton.iterations < plain.iterations


def differences(
    effect: Effect, poses: Poses, tau: tuple[Number, ...], p: Sequence[float]
) -> tuple[list[Array], list[Array], list[Array]]:
    """Central differences of the amounts by parameters, loads and angles: for each (targets, N)."""

    def slope(changed: Callable[[float], tuple[Number, ...]], h: float) -> Array:
        up, down = ([np.broadcast_to(a, len(poses)) for a in changed(s)] for s in (h, -h))
        return (np.array(up) - np.array(down)) / (2.0 * h)

    def by_p(j: int) -> Array:
        return slope(lambda h: effect.amounts(poses, tau, bumped(p, j, h)), STEP * effect.parameters[j].typical)  # type: ignore[arg-type]

    def by_tau(j: int) -> Array:
        return slope(lambda h: effect.amounts(poses, bumped(tau, j, h), p), STEP)

    def by_q(j: int) -> Array:
        return slope(lambda h: effect.amounts(poses.perturbed(j, h), tau, p), STEP)

    return [by_p(j) for j in range(len(p))], [by_tau(j) for j in range(len(tau))], [by_q(j) for j in range(6)]


def bumped(values: Sequence[Number], j: int, h: float) -> tuple[Number, ...]:
    return tuple(value + h if i == j else value for i, value in enumerate(values))


class Awkward(LoadedJointEffect):
    """Formulas that take duals in every way that a writer may use, or not at all."""

    id, about = "awkward", Description("For this test.", "many", "none")
    parameters = (Parameter("a_rad", "size", 0.02),)  # type: ignore[assignment]
    how: ClassVar[str] = ""

    def amounts(self, poses: Poses, tau: tuple[Number, ...], p: Sequence[float]) -> tuple[Number, ...]:
        q, load = poses.q[:, 0], tau[0]
        if self.how == "filled":
            out = np.zeros(len(poses))
            out[q > 0] = (p[0] * np.sin(q) * load)[q > 0]
            return (out,)
        if self.how == "table":
            return (p[0] * np.interp(q, [-2.0, 0.0, 2.0], [0.0, 1.0, 3.0]) + 0.1 * np.abs(load),)
        if self.how == "object":
            return (p[0] * np.array([math.sin(x) for x in q]) * np.asarray(load),)
        chosen = np.where(q > 0.0, p[0] * q, 3.0 * q**2)
        steep = np.maximum(load, 0.1) / np.hypot(q, 1.0) - np.arctan2(load, 1.0 + q * q) * np.sqrt(np.exp(q))
        return (chosen * np.abs(load) ** 1.5 + p[0] * np.log1p(q * q) * steep + 2.0 ** np.cos(q),)


@pytest.mark.parametrize("how", ["", "filled", "table", "object"])
def test_no_derivative_is_lost_however_the_formula_is_written(lab: Arm, how: str) -> None:
    effect, poses = Awkward(lab, "joint2"), some_poses(lab, 3, 20)
    tau, p = (np.random.default_rng(2).normal(0, 0.3, 20),), [0.02]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Awkward, "how", how)
        assert_has_the_derivatives_of_its_amounts(effect, poses, tau, p, 1e-5)


def test_droop_is_a_compliance_that_the_encoder_reads() -> None:
    arm = random_arm(5, 3)
    droop = model_of(arm, effects_at(arm, "servo_droop@joint2"), {"servo_droop.joint2.k_rad_per_Nm": 0.08})
    flex = model_of(arm, effects_at(arm, "compliance@joint2"), {"compliance.joint2.k_rad_per_Nm": 0.08})
    poses = poses_of(np.random.default_rng(0).uniform(-1, 1, (8, 3)))
    one, other = solve_equilibrium(droop, poses), solve_equilibrium(flex, poses)
    np.testing.assert_allclose(one.tcp, other.tcp, atol=1e-12)
    np.testing.assert_allclose((encoder_angles(one) - poses.q)[:, 1], 0.08 * one.tau[0], atol=1e-15)
    np.testing.assert_array_equal(encoder_angles(other), poses.q)
