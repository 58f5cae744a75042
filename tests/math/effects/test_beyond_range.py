"""Effects beyond the range that they were fitted on: the class that its contract states, for all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ALL_EFFECTS, FREE_FORMS, Effect, Extrapolation, effects_at
from lrm_math.effects.base import LinearEffect
from lrm_math.effects.derivatives import amounts_within
from lrm_math.effects.measured_range import FADE, MeasuredRange, held
from lrm_math.effects.memory.creep import CreepSpectrum
from lrm_math.effects.session_errors import SecondChangePoint
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.effect_binding import distortion
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.sweep import examples

LAB = load_arm("lrm-lab")
COUNT = 200
by_class = {each: [kind for kind in ALL_EFFECTS if kind.extrapolation is each] for each in Extrapolation}


class Driven:
    """Random values of everything that an effect may follow, within a random range."""

    def __init__(self, effect: Effect, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.rng, self.effect, n = rng, effect, effect.arm.dof
        self.lower, self.upper = np.sort(rng.uniform(-1.2, 1.2, (2, n)), axis=0)
        self.load = np.sort(rng.normal(0.0, 0.5, (2, len(effect.load_slots))), axis=0)
        self.within = MeasuredRange(
            tuple(zip(self.lower.tolist(), self.upper.tolist(), strict=True)), (0.0, 0.1),
            dict(zip(effect.load_slots, zip(*self.load.tolist(), strict=True), strict=True)), (0.0, 3e3), (0.0, 1e3),
        )  # fmt: skip
        self.p = [q.fixed or float(rng.normal()) * q.typical for q in effect.parameters]
        self.side = rng.integers(-1, 2, (COUNT, n)).astype(float)
        self.session = rng.integers(1, 4, COUNT).astype(float)

    def at(self, share: Array, factor: float = 1.0) -> Array:
        """(N, targets), amounts at shares (N,) of the range, 0 … 1 within it; `factor`: of all values."""

        def along(lower: Array, upper: Array) -> Array:
            return np.asarray(factor * (lower + share[:, None] * (upper - lower)))

        q, load, time = along(self.lower, self.upper), along(*self.load), along(np.zeros(1), np.ones(1))[:, 0]
        poses = Poses(
            q, np.full(COUNT, 0.05), self.side, 3e3 * time, self.session, running=1e3 * time, warmed=10 * time,
            temperature=20 + 10 * time, number=np.arange(1, COUNT + 1),
        )  # fmt: skip
        amounts = amounts_within(self.effect, poses, tuple(load.T), self.p, self.within)
        return np.stack([np.broadcast_to(amount, COUNT) for amount in amounts], axis=1)


def every_place(kind: type[Effect]) -> list[Effect]:
    return [kind(LAB, place) for place in dict.fromkeys([kind.places(LAB)[0], kind.places(LAB)[-1]])]


@pytest.mark.parametrize("kind", by_class[Extrapolation.HELD], ids=lambda kind: kind.id)
@examples(7, 15)
@given(seed=st.integers(0, 10_000))
def test_a_held_form_is_at_twice_its_range_what_it_is_at_the_edge(kind: type[Effect], seed: int) -> None:
    for effect in every_place(kind):
        driven = Driven(effect, seed)
        for edge, twice in ((0.0, -1.0), (1.0, 2.0)):
            at_edge, beyond = driven.at(np.full(COUNT, edge)), driven.at(np.full(COUNT, twice))
            np.testing.assert_allclose(beyond, at_edge, rtol=1e-7, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("kind", by_class[Extrapolation.PROPORTIONAL], ids=lambda kind: kind.id)
@examples(7, 15)
@given(seed=st.integers(0, 10_000))
def test_a_law_grows_no_faster_than_in_proportion(kind: type[Effect], seed: int) -> None:
    """Each of its parameters is taken by itself."""
    share = np.linspace(0.0, 1.0, COUNT)
    for effect in every_place(kind):
        driven = Driven(effect, seed)
        whole = list(zip(driven.p, effect.parameters, strict=True))
        for j, parameter in enumerate(effect.parameters):
            driven.p = [p if k == j or each.fixed else 0.0 for k, (p, each) in enumerate(whole)]
            within, twice = (np.abs(driven.at(share, factor)).max(axis=0) for factor in (1.0, 2.0))
            assert (twice <= 2.0 * within + 1e-12).all(), parameter.name


@pytest.mark.parametrize("kind", by_class[Extrapolation.PERIODIC], ids=lambda kind: kind.id)
def test_a_periodic_law_is_the_same_after_a_turn(kind: type[Effect]) -> None:
    for effect in every_place(kind):
        p, q = [parameter.typical for parameter in effect.parameters], np.random.default_rng(1).uniform(-3, 3, (9, 6))
        one, next_turn = (effect.amounts(Poses(at, np.zeros(9)), (), p) for at in (q, q + 2 * np.pi))
        np.testing.assert_allclose(one, next_turn, atol=1e-12)


SHAPED = (SecondChangePoint, CreepSpectrum)
"""Forms with a moment or time constants that are searched: linear in all else."""


def test_every_other_form_is_held_or_a_spring() -> None:
    """A free function is known where it was measured; what is linear in a load is a law."""
    assert {kind.id for kind in FREE_FORMS if kind.extrapolation is not Extrapolation.HELD} == {
        "bending_ends",
        "creep_spectrum",
    }
    assert all(issubclass(kind, LinearEffect) for kind in FREE_FORMS if kind not in SHAPED)


@given(st.floats(-2.0, 1.0), st.floats(0.01, 3.0), st.floats(-8.0, 8.0))
def test_held_values_are_exact_within_and_smooth_at_the_ends(lower: float, width: float, x: float) -> None:
    upper = lower + width
    value = float(held(x, lower, upper))
    assert lower - 0.43 * FADE * width - 1e-8 <= value <= upper + 0.43 * FADE * width + 1e-8
    if lower <= x <= upper:
        assert value == x
    h = 1e-4 * width
    for end in (lower, upper):
        slopes = [(float(held(end + h * (k + 1), lower, upper)) - float(held(end + h * k, lower, upper))) / h
                  for k in (-1, 0)]  # fmt: skip
        assert slopes == pytest.approx([1.0, 1.0], abs=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["angle_curve@joint2", "coupling_curve@joint3<-joint2", "cable_curve@joint2+joint3", "torque_curve@joint2",
             "nonlinear_stiffness@joint2", "base_curve@base", "frame_curve@frame",
             "drift@frame", "common_gain@servos"],
)  # fmt: skip
def test_derivatives_beyond_the_range(lab: Arm, name: str) -> None:
    """By parameters and by commands, through the equilibrium, on the way to the held value and beyond it."""
    effects = (*effects_at(lab, "compliance"), *effects_at(lab, name))
    rng = np.random.default_rng(2)
    values = [0.3 * p.typical * (1 if p.lower == 0 else rng.choice([-1, 1])) for e in effects for p in e.parameters]
    load = {key: (-0.05, 0.05) for effect in effects for key in effect.load_slots}
    model = model_of(lab, effects).with_values(values)
    model = replace(model, within=MeasuredRange(((-0.5, 0.5),) * 6, (0.0, 0.1), load, tcp=((-0.1, 0.25),) * 3))
    q = rng.uniform(-1.2, 1.2, (12, 6))
    q[:6] = rng.uniform(0.5, 0.55, (6, 6))
    equilibrium = solve_equilibrium(model, Poses(q, np.full(12, 0.05)), tolerance=1e-14)
    J, h = joint_jacobian(equilibrium), 1e-6
    for j in range(6):
        up, down = (solve_equilibrium(model, equilibrium.poses.perturbed(j, s), tolerance=1e-14).tcp for s in (h, -h))
        np.testing.assert_allclose(J[:, :, j], (up - down) / (2 * h), atol=2e-6)
    by_p = parameter_jacobian(equilibrium)
    for k, parameter in enumerate(model.parameters):
        step = 1e-4 * parameter.typical * (np.arange(len(model.keys)) == k)
        up, down = (solve_equilibrium(model.with_values(model.values + s), equilibrium.poses, tolerance=1e-14).tcp
                    for s in (step, -step))  # fmt: skip
        np.testing.assert_allclose(by_p[:, :, k], (up - down) / (2e-4 * parameter.typical), atol=1e-6)


@examples(12, 25)
@given(seed=st.integers(0, 10_000))
def test_a_distorted_space_stays_beyond_what_was_measured_as_at_its_edge(seed: int) -> None:
    rng = np.random.default_rng(seed)
    effects = effects_at(LAB, "frame_curve@frame")
    model = model_of(LAB, effects).with_values([p.typical * float(rng.normal()) for p in effects[0].parameters])
    lower, upper = np.sort(rng.uniform(-0.4, 0.4, (2, 3)), axis=0)
    ends = tuple(zip(lower.tolist(), upper.tolist(), strict=True))
    model = replace(model, within=MeasuredRange(((-0.5, 0.5),) * 6, (0.0, 0.1), tcp=ends))
    (bound,) = model.binding.distorting
    position = rng.uniform(-2.0, 2.0, (3, 50))
    excess = position - np.clip(position, lower[:, None], upper[:, None])
    far = position + np.sign(excess) * (4 * FADE * (upper - lower)[:, None] + 1e-6)
    nearest = np.clip(far, lower[:, None], upper[:, None])
    amounts = bound.at(Poses(np.zeros((1, 6)), np.zeros(1)))
    np.testing.assert_allclose(*(np.stack(distortion(bound, amounts, list(at))) for at in (far, nearest)), atol=1e-7)


def test_a_pose_within_the_range_is_predicted_by_the_formula(lab: Arm) -> None:
    effects = (*effects_at(lab, "compliance"), *effects_at(lab, "angle_curve@joint2"))
    model = model_of(lab, effects)
    model = model.with_values([0.2 * p.typical for p in model.parameters])
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (5, 6))
    within = replace(model, within=MeasuredRange(((-0.5, 0.5),) * 6, (0.0, 0.0)))
    assert np.array_equal(*(solve_equilibrium(one, Poses(q, np.zeros(5))).tcp for one in (model, within)))
    assert within.within.joints_outside(np.array([0.0, 0.6, 0.5, -0.5, -0.51, 0.0])) == (2, 5)
    assert within.within.sentence(q) == ""
    assert "1 of 1 poses" in within.within.sentence(q[:1] + 1.0)
