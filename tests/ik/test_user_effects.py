"""Effects that the kernel does not know: a user's laws on joints and on other slots, without C."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pytest

from lrm_math.arm.arm import Arm
from lrm_math.effects import Description, Effect, LoadedJointEffect, Parameter, effects_at
from lrm_math.effects.base import Amounts
from lrm_math.ik.answer import Solved, Unsolved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import Method
from lrm_math.ik.goal import IkQuery, point, point_along
from lrm_math.ik.methods import Cube, Direct
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.kinematics.scalar_or_array import cos, magnitude, sin
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.ik.test_ik_calibrated import EXACT, goal_of, reachable, table_b2

PAYLOAD = 0.04


class CableBundle(Effect):
    """The example of docs/effects.md: a joint turned by two others."""

    id, about = "sway", Description("a cable bundle", "δq3 = a sin(q1 + q4) + b cos(q1 + q4)", "docs/effects.md")
    targets = ("joint3.theta",)
    parameters = (Parameter("a_rad", "sine", 0.02), Parameter("b_rad", "cosine", 0.02))

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return ("joint3",)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        angle = poses.angle(0) + poses.angle(3)
        return (p[0] * sin(angle) + p[1] * cos(angle),)


class LoadDependentPlay(LoadedJointEffect):
    """A law of the load and of the side of arrival."""

    id, about = "sticky", Description("grease", "δq = d side |τ|", "test")
    parameters = (Parameter("d_rad_per_Nm", "stickiness", 0.02),)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        return (p[0] * poses.approach(self.joint) * magnitude(tau[0]),)


class StiffeningLink(Effect):
    """A link that bends more the more it is loaded, and with the command: no spring."""

    id, about = "buckle", Description("thin walls", "δx = c M (1 + 5 |M|) + a sin q2", "test")
    parameters = (Parameter("c_rad_per_Nm", "bending", 0.05), Parameter("a_rad", "twist", 0.01))
    targets = ("link2.x",)
    load_slots = ("link2.x",)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return ("link2",)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        return (p[0] * tau[0] * (1.0 + 5.0 * magnitude(tau[0])) + p[1] * sin(poses.angle(1)),)


class CommandedLength(Effect):
    """A length that grows with the command."""

    id, about = "creep", Description("a loose screw", "δd = a q2", "test")
    parameters = (Parameter("a_mm", "play", 0.002),)
    targets = ("joint3.d",)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return ("joint3",)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        return (p[0] * poses.angle(1),)


@lru_cache
def solver(name: str) -> CalibratedSolver:
    """The thesis's model with one user's effect."""
    thesis = table_b2()
    effect = {"sway": CableBundle, "sticky": LoadDependentPlay, "buckle": StiffeningLink, "creep": CommandedLength}[
        name
    ]
    mine = effect(thesis.arm, effect.places(thesis.arm)[0] if name != "sticky" else "joint2")
    known = dict(zip(thesis.keys, thesis.values.tolist(), strict=True))
    own = {key: p.typical for key, p in zip(mine.keys, mine.parameters, strict=True)}
    return CalibratedSolver.of(model_of(thesis.arm, (*thesis.effects, mine), known | own))


NAMES = ("sway", "sticky", "buckle", "creep")


def off(model: Model, q: Sequence[float], direction: Sequence[int], position: Sequence[float]) -> float:
    """m, by the model's own equilibrium."""
    poses = Poses(np.array([q]), np.array([PAYLOAD]), np.array([direction], dtype=float))
    return float(np.linalg.norm(solve_equilibrium(model, poses, tolerance=1e-12).true_tcp[0] - position))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("method", [Direct(), Cube(points=5)], ids=["direct", "cube"])
def test_goals_are_solved_and_every_branch_is_exact(name: str, method: Method) -> None:
    model = solver(name).arm.model
    assert not solver(name).arm.complete
    q, tools = reachable(model, 12 if method.name == "direct" else 3, 40, PAYLOAD)
    missed = 0
    for own, tool in zip(q, tools, strict=True):
        reply = solver(name).solve(goal_of(tool), PAYLOAD, method=method)
        assert isinstance(reply, Solved), str(reply)
        assert reply.predicted_error <= EXACT
        assert all(off(model, b.q, reply.direction, tool[:3, 3]) <= EXACT for b in reply.branches)
        missed += min(float(np.abs(np.array(b.q) - own).max()) for b in reply.branches) > 1e-6
    assert missed <= 1


@pytest.mark.parametrize("name", NAMES)
def test_positions_directions_and_sides(name: str) -> None:
    model, rng = solver(name).arm.model, np.random.default_rng(41)
    q, tools = reachable(model, 3, 41, PAYLOAD)
    for own, tool in zip(q, tools, strict=True):
        near = own + rng.normal(0, 0.05, 6)
        for goal in (goal_of(tool), point(tool[:3, 3]), point_along(tool[:3, 3], tool[:3, 2])):
            reply = solver(name).solve(goal, PAYLOAD, near, Direct())
            assert isinstance(reply, Solved), str(reply)
            assert off(model, reply.q, reply.direction, tool[:3, 3]) <= EXACT
            side = np.sign(np.array(reply.q) - near)
            assert [i + 1 for i in np.flatnonzero(side != reply.direction)] == list(reply.detours)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_out_of_reach_says_how_near_the_whole_model_comes(name: str) -> None:
    reply = solver(name).solve(point((0.9, 0.0, 0.3)), PAYLOAD, method=Direct())
    assert isinstance(reply, Unsolved)
    model = solver(name).arm.model
    equilibrium = solve_equilibrium(model, poses_of([reply.nearest.q], PAYLOAD))
    assert np.linalg.norm(equilibrium.true_tcp[0] - (0.9, 0.0, 0.3)) == pytest.approx(reply.nearest.distance, abs=1e-7)


def test_effects_of_the_catalogue_alone_are_left_to_the_kernel() -> None:
    assert not solver("sway").arm.complete
    arm = table_b2().arm
    springs = model_of(arm, effects_at(arm, "compliance") + effects_at(arm, "servo_gain"))
    assert CalibratedSolver.of(springs).arm.complete


@pytest.mark.parametrize("name", NAMES)
def test_an_answer_does_not_hang_on_the_last_bit_of_its_goal(name: str) -> None:
    """Goals that leave motion free too: what is free follows from the search, not from round-off."""
    arm, direct = solver(name).arm, Direct()
    for tool in reachable(arm.model, 3, 5, 0.0)[1]:
        position, way = tool[:3, 3], np.array([1.0, -1.0, 1.0])
        for goal in (point, lambda at, along=tool[:3, 2]: point_along(at, along)):
            once, again = (direct.find(arm, IkQuery(goal(at))) for at in (position, position + 2e-16 * way))
            np.testing.assert_allclose([c.q for c in again.commands], [c.q for c in once.commands], atol=1e-9)
