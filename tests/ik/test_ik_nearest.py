"""Nearest command to an unreachable goal: laws of distances, for any model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.calibrated_ik import SMOOTH, with_effects
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.ik.answer import IkVerdict, Nearest, Solved, Unsolved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import nearest
from lrm_math.ik.goal import CHAR_LENGTH, Goal, IkQuery, point, point_along, pose
from lrm_math.ik.methods import Direct
from lrm_math.ik.reach_ball import reach_ball
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from tests.conftest import TABLE_B2
from tests.support.random_arms import arms
from tests.support.sweep import examples

FORMS = ("point", "along", "pose")
MODELS = ("nominal", "thesis", "everything")
LOAD = 0.0663
SETTLED = 3e-5  # m, what is left open of the least error
lengths = st.floats(-1.0, 1.0)
positions = st.tuples(lengths, lengths, lengths)
turns = st.tuples(*[lengths] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)


@lru_cache
def solver(name: str) -> CalibratedSolver:
    """The solver of one of `MODELS`."""
    thesis = load_model(TABLE_B2)
    if name == "nominal":
        return CalibratedSolver.of(model_of(load_arm("lrm-lab"), ()))
    if name == "thesis":
        return CalibratedSolver.of(thesis)
    return CalibratedSolver.of(with_effects(thesis, SMOOTH, 0, 0.15))


def goal_of(form: str, position: tuple[float, ...], turn: tuple[float, ...]) -> Goal:
    """A goal of one of `FORMS`; the turn is a quaternion of any length."""
    R = Rotation.from_quat(turn).as_matrix()
    return {"pose": pose(position, R), "along": point_along(position, R[:, 2]), "point": point(position)}[form]


def tools(model: Model, q: Array, payload: float) -> Array:
    """(M, 4, 4), tool frames at those of the commands (N, n) where the arm settles."""
    equilibrium, rows = batch_equilibrium(model, Poses(q, np.full(len(q), payload)))
    return frames(model.chain, equilibrium.slots, len(rows))[:, -1]


def error(found: Nearest) -> float:
    """m, rotation weighed as in the least squares."""
    return math.hypot(found.distance, CHAR_LENGTH * found.angle)


def find(name: str, goal: Goal, starts: Sequence[tuple[float, ...]] = ()) -> Nearest:
    """The nearest with a payload."""
    return nearest(solver(name).arm, IkQuery(goal, LOAD), tuple(starts))


def errors(tools: Array, goal: Goal) -> Array:
    """(N,), m, of tool frames (N, 4, 4) from a goal."""
    return np.array([error(Nearest.at((), goal, tool)) for tool in tools])


@given(form=st.sampled_from(FORMS), position=positions, turn=turns, there=turns)
def test_nearest_has_distance_and_rotation_angle(
    form: str, position: tuple[float, ...], turn: tuple[float, ...], there: tuple[float, ...]
) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(there).as_matrix(), (0.1, 0.2, 0.3)
    goal = goal_of(form, position, turn)
    R = Rotation.from_quat(turn)
    angle = {
        "pose": (R * Rotation.from_quat(there).inv()).magnitude(),
        "along": math.acos(np.clip(T[:3, 2] @ R.as_matrix()[:, 2], -1.0, 1.0)),
        "point": 0.0,
    }[form]
    off = Nearest.at((), goal, T)
    assert off.angle == pytest.approx(angle, abs=1e-7)
    assert off.distance == pytest.approx(math.dist(position, T[:3, 3]), rel=1e-12)


@pytest.mark.long
@examples(20, 40)
@given(arm=arms, load=st.floats(0.0, 0.2), seed=st.integers(0, 1000), size=st.floats(0.0, 1.0))
def test_reach_ball_contains_every_tool_position(arm: Arm, load: float, seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    typical = np.array([p.typical for p in model.parameters])
    model = replace(model, values=model.values + size * rng.uniform(0.0, 1.0, len(typical)) * typical)
    q = rng.uniform(-math.pi, math.pi, (200, arm.dof))
    ball, at = reach_ball(model), tools(model, q, load)[:, :3, 3]
    assert all(ball.contains(position) for position in at.tolist())


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("form", FORMS)
@examples(4, 8)
@given(position=positions, turn=turns)
def test_nearest_beats_random_poses(name: str, form: str, position: tuple[float, ...], turn: tuple[float, ...]) -> None:
    arm, goal = solver(name).arm, goal_of(form, position, turn)
    found = find(name, goal)
    lower, upper = arm.limits.lower, arm.limits.upper
    assert all(low <= x <= high for low, x, high in zip(lower, found.q, upper, strict=True))
    assert errors(tools(arm.model, np.array([found.q]), LOAD), goal)[0] == pytest.approx(error(found), abs=1e-7)
    q = np.random.default_rng(1).uniform(lower, upper, (1000, len(lower)))
    q = np.concatenate([q, arm.library.q[np.argsort(errors(arm.library.tcp, goal))[:50]]])
    assert error(found) <= errors(tools(arm.model, q, LOAD), goal).min() + SETTLED


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@examples(5, 10)
@given(form=st.sampled_from(FORMS), position=positions, turn=turns)
def test_nearest_is_idempotent(name: str, form: str, position: tuple[float, ...], turn: tuple[float, ...]) -> None:
    found = find(name, goal_of(form, position, turn))
    assert error(find(name, found.goal, [found.q])) <= SETTLED


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@examples(5, 10)
@given(position=positions, share=st.floats(0.05, 0.95))
def test_distance_shrinks_linearly_to_the_nearest(name: str, position: tuple[float, ...], share: float) -> None:
    found = find(name, point(position))
    reached = np.array(found.goal.position)
    between = reached + share * (np.array(position) - reached)
    assert find(name, point(between), [found.q]).distance <= share * found.distance + SETTLED


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_goals_made_from_commands_are_solved(name: str) -> None:
    arm, rng = solver(name).arm, np.random.default_rng(7)
    limits = arm.limits
    q = np.concatenate([rng.uniform(limits.lower, limits.upper, (40, 6)), np.array(limits.lower)[None]])
    for tool in tools(arm.model, q, LOAD):
        for goal in (point(tool[:3, 3]), point_along(tool[:3, 3], tool[:3, 2]), pose(tool[:3, 3], tool[:3, :3])):
            assert isinstance(solver(name).solve(goal, LOAD, method=Direct()), Solved)


@pytest.mark.long
@pytest.mark.parametrize("name", MODELS)
@examples(5, 10)
@given(way=positions.filter(lambda v: math.hypot(*v) > 0.1), beyond=st.floats(0.01, 5.0))
def test_distance_of_goals_outside_the_reach_ball_is_bounded(name: str, way: tuple[float, ...], beyond: float) -> None:
    arm = solver(name).arm
    ball = arm.library.reach_ball
    outwards = np.array(way) / math.hypot(*way)
    at = [np.array(ball.centre) + (ball.radius + d) * outwards for d in (0.001, 0.001 + beyond)]
    replies = [solver(name).solve(point(position), LOAD, method=Direct()) for position in at]
    assert all(isinstance(r, Unsolved) and r.verdict is IkVerdict.OUT_OF_REACH for r in replies)
    first, second = (r.nearest.distance for r in replies if isinstance(r, Unsolved))
    assert first >= 0.001
    assert second <= first + beyond + SETTLED
    assert second >= 0.001 + beyond


def test_distance_of_the_nearest_command_is_that_of_the_move_from_where_the_arm_is() -> None:
    """Hysteresis leaves a joint on the side of its arrival, so that the tip rests elsewhere."""
    thesis = load_model(TABLE_B2)
    added = tuple(effects_at(thesis.arm, "hysteresis"))
    known = dict(zip(thesis.keys, thesis.values.tolist(), strict=True))
    model = model_of(thesis.arm, (*thesis.effects, *added), known)
    given = {key: p.typical for key, p in zip(model.keys, model.parameters, strict=True) if key not in known}
    asked = CalibratedSolver.of(model_of(thesis.arm, model.effects, known | given))
    limits = asked.arm.limits
    for begin in (limits.lower, limits.upper):
        reply = asked.solve(point((0.9, -0.2, 0.1)), LOAD, begin, method=Direct())
        assert isinstance(reply, Unsolved)
        there = asked.forward(reply.nearest.q, LOAD, begin)
        assert math.dist(there.tcp, (0.9, -0.2, 0.1)) == pytest.approx(reply.nearest.distance, abs=1e-8)
        elsewhere = asked.forward(reply.nearest.q, LOAD)
        assert math.dist(elsewhere.tcp, there.tcp) > 1e-5


def test_nominal_arm_stretches_to_its_full_length() -> None:
    ball = solver("nominal").arm.library.reach_ball
    for elevation in (0.6, 0.9, 1.2):
        for azimuth in (-0.8, 0.0, 0.8):
            way = (
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            )
            found = find("nominal", point(np.array(ball.centre) + 2.0 * ball.radius * np.array(way)))
            assert ball.radius <= found.distance <= ball.radius + 1e-3


@pytest.mark.parametrize("name", MODELS)
def test_more_starts_never_increase_the_error(name: str) -> None:
    arm, rng = solver(name).arm, np.random.default_rng(2)
    for _ in range(5):
        query = IkQuery(goal_of("pose", tuple(rng.uniform(-0.5, 0.5, 3)), tuple(rng.normal(size=4))), LOAD)
        starts = rng.uniform(-4.0, 4.0, (3, 6))
        given = error(nearest(arm, query, tuple(tuple(q) for q in starts.tolist())))
        assert given <= error(nearest(arm, query)) + 1e-9  # m, to which equilibria settle
