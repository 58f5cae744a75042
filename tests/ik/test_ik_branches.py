"""Completeness of the branches of a pose, above all where two of them are about to merge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import IkSolutions
from lrm_math.ik.goal import CHAR_LENGTH, Goal, IkQuery
from lrm_math.ik.methods import Direct
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.ik.test_ik_calibrated import EXACT, MODELS, Array, goal_of, reachable, solver
from tests.support.random_arms import arms
from tests.support.sweep import examples

PAYLOAD = 0.04
NEAR_A_FOLD = 1.5e-3
"""m/rad: speed of the tool with some motion of the joints below which a fold is near."""


def commands_beside_folds(name: str, count: int) -> tuple[Array, Array]:
    """Commands (N, n) whose poses (N, 4, 4) have a second solution nearby, and those poses."""
    arm = solver(name).arm
    moving = arm.errors.moving
    q, tools = reachable(arm.model, count, 31, PAYLOAD)
    equilibrium = arm.equilibria(PAYLOAD, q)
    columns, h = [], 1e-6
    for v in moving.joints:
        step = h * (np.arange(equilibrium.slots.shape[1]) == v)
        up, down = (arm.kernel(PAYLOAD).forward(equilibrium.slots + way * step)[0] for way in (1, -1))
        spin = ((up - down)[:, :3, :3] / (2 * h)) @ tools[:, :3, :3].transpose(0, 2, 1)
        turn = CHAR_LENGTH * np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        columns.append(np.concatenate([(up - down)[:, :3, 3] / (2 * h), turn], axis=1))
    near = np.linalg.svd(np.stack(columns, axis=2))[1][:, -1] < NEAR_A_FOLD
    return q[near], tools[near]


def is_among(q: Array, found: IkSolutions | None) -> bool:
    """Whether a command (n,) is among those found within the limits."""
    if found is None:
        return False
    return any(np.abs(np.array(command.q) - q).max() < 1e-4 for command in found.within)


def missed(q: Array, found: list[IkSolutions | None]) -> int:
    """Number of commands (N, n) that the answers lack."""
    return sum(not is_among(own, some) for own, some in zip(q, found, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_both_solutions_beside_a_fold_are_found(name: str) -> None:
    """The command that a goal was made from is known independently of the solver."""
    q, tools = commands_beside_folds(name, 1200)
    assert len(q) >= 100
    arm, queries = solver(name).arm, [IkQuery(goal_of(tool), PAYLOAD) for tool in tools]
    assert missed(q, [Direct().find(arm, query) for query in queries]) <= 0.05 * len(q)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_branches_are_nearly_complete_and_all_reach_the_goal(name: str) -> None:
    arm = solver(name).arm
    q, tools = reachable(arm.model, 300, 32, PAYLOAD)
    every = [Direct().find(arm, IkQuery(goal_of(tool), PAYLOAD)) for tool in tools]
    assert missed(q, every) <= 0.02 * len(q)
    owner = [i for i, found in enumerate(every) if found is not None for _ in found.commands]
    found = [command for some in every if some is not None for command in some.commands]
    commands, use = np.array([c.q for c in found]), np.array([c.margin > 0.0 for c in found])
    equilibrium = solve_equilibrium(arm.model, poses_of(commands[use], PAYLOAD), tolerance=1e-12)
    off = frames(arm.model.chain, equilibrium.slots, int(use.sum()))[:, -1] - tools[np.array(owner)[use]]
    assert np.abs(off[:, :3, 3]).max() <= EXACT
    assert np.abs(off[:, :3, :3]).max() <= 1e-8


def test_unreachable_goals_have_no_branches() -> None:
    arm = solver("table_b2").arm
    assert (
        Direct().find(arm, IkQuery(Goal((5.0, 0.0, 0.0), rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))))
        is None
    )


@pytest.mark.slow
@examples(4, 8)
@given(arm=arms.filter(lambda arm: arm.dof >= 4))
def test_solutions_on_any_arm_reach_the_goal_and_are_distinct(arm: Arm) -> None:
    """Arms with and without a closed form, with fewer and more joints than six."""
    model = model_of(arm, effects_at(arm, "compliance"), {})
    calibrated = CalibratedSolver.of(model).arm
    _, tools = reachable(model, 3, 34, PAYLOAD)
    for tool in tools:
        found = Direct().find(calibrated, IkQuery(goal_of(tool), PAYLOAD))
        assert found is not None
        assert found.within
        q = np.array([command.q for command in found.commands])
        at, _ = calibrated.kernel(PAYLOAD).forward(np.array([command.slots for command in found.commands]))
        np.testing.assert_allclose(at, np.broadcast_to(tool, at.shape), atol=1e-9)
        assert all(np.abs(q[:k] - row).max(axis=1).min() > 1e-7 for k, row in enumerate(q) if k)
