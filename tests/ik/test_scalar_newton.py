"""Scalar Newton's method: the same kinematics, loads and solutions as the batch version."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import batch_equilibrium
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import pose
from lrm_math.ik.joint_laws import JointLaws
from lrm_math.ik.newton import EVERY_BRANCH, Target, newton_solve
from lrm_math.ik.scalar_linkage import ScalarLinkage, jacobian_rows, matrices
from lrm_math.ik.scalar_pose import SinglePose
from lrm_math.ik.solver_context import IkQuery, SolverContext
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from tests.conftest import TABLE_B2
from tests.support.random_arms import arms

FLEXIBLE_EFFECTS = ("offsets", "compliance", "base_compliance", "lateral_compliance")


def flexible_model(arm: Arm, seed: int, size: float = 0.3) -> Model:
    """An arm with compliances and offsets of random size."""
    model = model_of(arm, [effect for name in FLEXIBLE_EFFECTS for effect in effects_at(arm, name)])
    share = np.random.default_rng(seed).uniform(0.2, 1.0, len(model.keys))
    return model.with_values(size * share * [p.typical for p in model.parameters])


@lru_cache
def context(name: str) -> SolverContext:
    model = load_model(TABLE_B2) if name == "table_b2" else flexible_model(load_arm("lrm-lab"), 5)
    return CalibratedSolver.of(model).context


def tools(model: Model, count: int, seed: int, payload: float) -> Array:
    """(N, 4, 4), tool frames at commands all over the limits."""
    lower, upper = ([getattr(joint, end) for joint in model.arm.joints] for end in ("lower", "upper"))
    q = np.random.default_rng(seed).uniform(lower, upper, (count, model.arm.dof))
    rest, _ = batch_equilibrium(model, poses_of(q, payload), tolerance=1e-13)
    return frames(model.chain, rest.slots, len(rest.poses))[:, -1]


@settings(max_examples=25)
@given(arms, st.integers(0, 100), st.floats(0.0, 0.1))
def test_scalar_linkage_equals_batch_linkage(arm: Arm, seed: int, payload: float) -> None:
    model = flexible_model(arm, seed)
    linkage = JointLaws(model).linkage
    mass_moments = linkage.mass_moments(model.weights(payload))
    amounts = np.random.default_rng(seed).uniform(-1.7, 1.7, (1, len(linkage.slots)))
    many = linkage.forward(amounts)
    one = ScalarLinkage.of(linkage)
    assert one is not None
    bodies = one.scalar_moments(mass_moments)
    state = one.forward(amounts[0].tolist(), bodies)
    np.testing.assert_allclose(matrices([state.tcp]), many.tcp, atol=1e-12)
    every = jacobian_rows(state, range(len(linkage.slots)), 1.0)
    np.testing.assert_allclose(every.T[None], linkage.jacobian(many), atol=1e-12)
    np.testing.assert_allclose(state.tau, linkage.loads(many, mass_moments).tau[:, 0], atol=1e-12)


@pytest.mark.parametrize("name", ["lrm-rover", "lrm-lab"])
def test_load_derivatives_match_finite_differences(name: str) -> None:
    """On arms some of whose joints count bodies that they do not move."""
    model = flexible_model(load_arm(name), 1)
    assert chain_of(model.arm).counted != chain_of(model.arm).moved
    linkage = JointLaws(model).linkage
    mass_moments = linkage.mass_moments(model.weights(0.08))
    here, h = np.random.default_rng(2).uniform(-1.5, 1.5, (1, len(linkage.slots))), 1e-5
    state = linkage.forward(here)
    load_derivatives = linkage.load_derivatives(state, mass_moments, linkage.loads(state, mass_moments))[:, :, 0]
    for v in range(len(linkage.slots)):
        step = h * (np.arange(len(linkage.slots)) == v)
        up, down = (linkage.loads(linkage.forward(here + way * step), mass_moments).tau[:, 0] for way in (1, -1))
        np.testing.assert_allclose(load_derivatives[:, v], (up - down) / (2 * h), atol=2e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table_b2", "lab"])
def test_scalar_and_batch_newton_find_the_same_branches(name: str) -> None:
    """But for a few branches that nearly merge."""
    there, payload = context(name), 0.05
    assert there.scalar_newton is not None
    found = lost = 0
    for tool in tools(there.model, 150, 3, payload):
        query = IkQuery(pose(tool[:3, 3], tool[:3, :3]), payload)
        start = there.start_amounts(query, there.equivalent_arm.seeds(query.goal, None))
        one, _ = there.solve_from(query, start)
        poses = there.poses(query, start[:, there.joint_laws.linkage.joints])
        mass_moments = there.joint_laws.mass_moments(payload)
        all_at_once = newton_solve(
            there.joint_laws, Target.of(query.goal), mass_moments, poses, start, there.bounds, EVERY_BRANCH
        )
        many = there.commands(query, all_at_once.take(all_at_once.converged))
        mine, theirs = one.q[there.within_limits(one)], many.q[there.within_limits(many)]
        np.testing.assert_allclose(one.reached.tcp - tool, 0.0, atol=1e-9)
        for q in theirs:
            again = len(mine) > 0 and np.abs(mine - q).max(axis=1).min() < 1e-6
            found, lost = found + again, lost + (not again)
    assert found >= 150
    assert lost <= 0.05 * found


def test_single_pose_equals_poses_of_length_one() -> None:
    rng = np.random.default_rng(0)
    q, side = rng.uniform(-1.5, 1.5, (1, 6)), rng.choice([-1.0, 1.0], (1, 6))
    one, poses = SinglePose(q, np.array([0.05]), side), Poses(q, np.array([0.05]), side)
    assert [one.angle(i) for i in range(6)] == [poses.angle(i) for i in range(6)]
    assert [one.approach(i) for i in range(6)] == [poses.approach(i) for i in range(6)]
    assert SinglePose(q, np.array([0.05])).approach(3) == 0.0
    assert one.carried == poses.carried
    assert one.turned_to(np.zeros(6)).angle(2) == 0.0
    assert one.turned_to(np.zeros(6)).approach(2) == side[0, 2]
    assert (len(one.take(np.array([False]))), len(one.take([0, 0]))) == (0, 2)


def test_single_pose_rejects_two_rows() -> None:
    with pytest.raises(LrmError, match="one row"):
        SinglePose(np.zeros((2, 6)), np.zeros(2))


@pytest.mark.parametrize("name", ["table_b2", "lab"])
def test_retracted_seeds_reach_the_retracted_goal(name: str) -> None:
    """They lie between the goal and the arm's middle; none is one of those known."""
    equivalent_arm = context(name).equivalent_arm
    chain = chain_of(equivalent_arm.arm)
    for tool in tools(context(name).model, 30, 4, 0.0):
        goal = pose(tool[:3, 3], tool[:3, :3])
        known = equivalent_arm.seeds(goal, None).numbers[:1]
        seeds = equivalent_arm.retracted(goal, known)
        assert not set(known) & set(seeds.numbers)
        for q in seeds.q:
            at = frames(chain, chain.values(q.tolist()), 1)[0, -1]
            np.testing.assert_allclose(at[:3, :3], tool[:3, :3], atol=1e-8)
            way, retracted = equivalent_arm.middle - tool[:3, 3], at[:3, 3] - tool[:3, 3]
            np.testing.assert_allclose(np.cross(way, retracted), 0.0, atol=1e-8)
            assert -1e-8 <= way @ retracted <= 0.2 * (way @ way)
