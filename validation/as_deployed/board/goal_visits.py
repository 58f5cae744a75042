"""Goals that each model answers from the same poses, on the simulated board, seen by the simulated tracker.

A goal of the tip leaves three joints free, and the inverse takes the command nearest to where the arm comes from. From
where it happens to stand, each model goes through the goals by poses of its own, which decide more than the model: it
differs from itself by tenths of a millimetre RMS. So all models answer each goal from the same random pose.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from examples.demo.pose_files import LOAD_G, clear_poses
from examples.demo.simulated_tracker import BASE, TOOL
from examples.demo.steps import DWELL_S, SETTLE_S
from examples.demo.world import ARM, ROBOT, World
from lrm_ident.measuring.campaign.real_clock import RealClock
from lrm_ident.measuring.campaign.run import PoseTiming
from lrm_ident.measuring.campaign.session import by_daemon, connected
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_ident.measuring.verification.goal_commands import GoalCommand, GoalSolver
from lrm_ident.measuring.verification.goal_run import GoalRun
from lrm_ident.measuring.verification.goals import PlacedGoal, draw_goals
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.goal import Goal
from lrmd.client import Rover

TRIES = 6
"""Of measuring, which goes on, and of a visit: the simulated board of a busy computer does not answer in time."""
Tried = TypeVar("Tried")


@dataclass(frozen=True)
class FixedStartSolver:
    """A solver that answers each goal from a pose of its own (rad), wherever the arm stands."""

    solver: GoalSolver
    start: dict[tuple[float, ...], tuple[float, ...]]

    @property
    def model(self) -> str:
        """Model of the solver."""
        return self.solver.model

    @property
    def model_sha256(self) -> str:
        """Hash of the model of the solver."""
        return self.solver.model_sha256

    def solve(self, goal: Goal, near: Sequence[float], payload: float) -> GoalCommand | str:
        return self.solver.solve(goal, self.start[goal.position], payload)


@dataclass(frozen=True)
class GoalVisits:
    """The goals (m) of a seed, and the poses that they are answered from (rad)."""

    goals: Array
    starts: Array

    @classmethod
    def of(cls, count: int, seed: int) -> GoalVisits:
        """Goals as `verify` draws them; poses that keep clear of everything."""
        arm = load_arm(ARM)
        rng = np.random.default_rng([seed, 8])
        return cls(draw_goals(arm, count, seed), clear_poses(arm, count, rng))

    def visit(self, world: World, slower: float) -> Array:
        """(goals,), squared distances of the tip from the goals (m²); NaN where one was not reached.

        `slower`: how many times longer the arm rests.
        """
        arm, targets = load_arm(ARM), TargetNumbers(TOOL, BASE)
        timing = PoseTiming(0.0, slower * SETTLE_S, slower * DWELL_S)
        goals = [tuple(goal) for goal in self.goals.tolist()]
        start = {goal: tuple(q) for goal, q in zip(goals, self.starts.tolist(), strict=True)}
        with (
            Rover(ROBOT, [world.endpoint]) as rover,
            connected(rover, f"dtrack:{world.tracker_port}", targets) as tracker,
            by_daemon(rover, arm, False, "lrm-ident verify", clock := RealClock(), lambda _: None) as driven,
        ):
            solver = FixedStartSolver(driven.solver(None), start)
            run = GoalRun(driven.arm, solver, arm, tracker, targets, clock, timing, LOAD_G * GRAM)
            found = run.visit([PlacedGoal(goal) for goal in goals], lambda *_: None)
        squares = np.full(len(goals), np.nan)
        for one in found.attained:
            squares[one.number - 1] = one.error**2
        return squares


def tried(piece: Callable[[], Tried]) -> Tried:
    """The result of a piece of the loop, which is begun anew where it fails. Raises `LrmError` after `TRIES`."""
    for _ in range(TRIES - 1):
        try:
            return piece()
        except LrmError as error:
            print(f"once more: {error}", file=sys.stderr, flush=True)
    return piece()
