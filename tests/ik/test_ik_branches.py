"""Completeness of the branches of a pose, above all where two of them are about to merge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.ik.branches import every_branch
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.direct import Direct
from lrm_math.ik.goal import Goal
from lrm_math.ik.newton import WEIGHTS
from lrm_math.ik.solver_context import CommandBatch, IkQuery
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.ik.test_ik_calibrated import EXACT, MODELS, Array, goal_of, reachable, solver
from tests.support.random_arms import arms

PAYLOAD = 0.04
NEAR_A_FOLD = 1.5e-3
"""m/rad: speed of the tool with some motion of the joints below which a fold is near."""


def commands_beside_folds(name: str, count: int) -> tuple[Array, Array]:
    """Commands (N, n) whose poses (N, 4, 4) have a second solution nearby, and those poses."""
    context = solver(name).context
    linkage = context.joint_laws.linkage
    q, tools = reachable(context.model, count, 31, PAYLOAD)
    rest = context.at_rest(IkQuery(Goal((0.0, 0.0, 0.0)), PAYLOAD), q, 0)
    J = linkage.jacobian(linkage.forward(rest.reached.amounts))[:, :, linkage.joints]
    near = np.linalg.svd(WEIGHTS * J)[1][:, -1] < NEAR_A_FOLD
    return q[near], tools[near]


def is_among(q: Array, found: CommandBatch | None, name: str) -> bool:
    """Whether a command (n,) is among those found within the limits."""
    if found is None:
        return False
    return bool((np.abs(found.q[solver(name).context.within_limits(found)] - q).max(axis=1) < 1e-4).any())


def missed(name: str, q: Array, found: list[CommandBatch | None]) -> int:
    """Number of commands (N, n) that the answers lack."""
    return sum(not is_among(own, some, name) for own, some in zip(q, found, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_both_solutions_beside_a_fold_are_found(name: str) -> None:
    """The command that a goal was made from is known independently of the solver."""
    q, tools = commands_beside_folds(name, 1200)
    assert len(q) >= 100
    context, queries = solver(name).context, [IkQuery(goal_of(tool), PAYLOAD) for tool in tools]
    every = [every_branch(context, query) for query in queries]
    few = missed(name, q, every)
    assert few <= 0.05 * len(q)
    assert few < 0.6 * missed(name, q, [Direct().find(context, query) for query in queries])


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_branches_are_nearly_complete_and_all_reach_the_goal(name: str) -> None:
    context = solver(name).context
    q, tools = reachable(context.model, 300, 32, PAYLOAD)
    every = [every_branch(context, IkQuery(goal_of(tool), PAYLOAD)) for tool in tools]
    assert missed(name, q, every) <= 0.02 * len(q)
    owner = [i for i, found in enumerate(every) if found is not None for _ in found.q]
    commands = np.concatenate([found.q for found in every if found is not None])
    use = context.bounds.contains(commands, 0.0)
    rest = solve_equilibrium(context.model, poses_of(commands[use], PAYLOAD), tolerance=1e-12)
    off = frames(context.model.chain, rest.slots, int(use.sum()))[:, -1] - tools[np.array(owner)[use]]
    assert np.abs(off[:, :3, 3]).max() <= EXACT
    assert np.abs(off[:, :3, :3]).max() <= 1e-8


def test_position_goals_get_the_branches_of_the_direct_method() -> None:
    """They have infinitely many solutions."""
    context = solver("table_b2").context
    _, tools = reachable(context.model, 1, 33, PAYLOAD)
    query = IkQuery(Goal(tuple(tools[0, :3, 3].tolist())), PAYLOAD)
    found, alone = every_branch(context, query), Direct().find(context, query)
    assert found is not None
    assert alone is not None
    np.testing.assert_array_equal(found.q, alone.q)


def test_unreachable_goals_have_no_branches() -> None:
    context = solver("table_b2").context
    assert (
        every_branch(
            context, IkQuery(Goal((5.0, 0.0, 0.0), rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))))
        )
        is None
    )


@pytest.mark.slow
@settings(max_examples=4)
@given(arm=arms.filter(lambda arm: arm.dof >= 4))
def test_extended_search_keeps_the_branches_of_the_direct_method(arm: Arm) -> None:
    """With and without a closed form."""
    model = model_of(arm, effects_at(arm, "compliance"), {})
    context = CalibratedSolver.of(model).context
    _, tools = reachable(model, 3, 34, PAYLOAD)
    for tool in tools:
        query = IkQuery(goal_of(tool), PAYLOAD)
        direct, every = Direct().find(context, query), every_branch(context, query)
        assert (direct is None) == (every is None)
        if direct is not None and every is not None:
            assert len(every.q) >= len(direct.q)
            np.testing.assert_array_equal(every.q[: len(direct.q)], direct.q)
            assert bool(every.reached.converged.all())
