"""`python -m validation.residual_field.demo_loop`: the loop of the demo, daemon and all, with a field and without.

As `make demo`, of an arm with two effects outside the catalogue, measured at more poses; `auto` names what it can, and
a field is added if the tool finds that it helps. The tip is sent to the same goals with both models, twice each. Every
visit has a board and a daemon of its own, so that a fault of one, as on a busy computer, costs that visit alone.

A goal of the tip leaves three joints free, and the inverse takes the command nearest to where the arm comes from. From
where it happens to stand, each model goes through the goals by poses of its own, which decide more than the model: it
differs from itself by tenths of a millimetre RMS. So both models answer each goal from the same random pose.
"""

from __future__ import annotations

import contextlib
import io
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from examples.demo.pose_files import LOAD_G, clear_poses, pose_table
from examples.demo.simulated_tracker import BASE, TOOL
from examples.demo.steps import DWELL_S, SETTLE_S, DemoSteps
from examples.demo.world import ARM, ROBOT, World, simulated_world
from lrm_ident.measuring.campaign.run import PoseTiming
from lrm_ident.measuring.campaign.session import RealClock, by_daemon, connected
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_ident.measuring.verification.goal_commands import GoalCommand, GoalSolver
from lrm_ident.measuring.verification.goal_run import GoalRun
from lrm_ident.measuring.verification.goals import PlacedGoal, draw_goals
from lrm_ident.residual.better_prediction import vuong_z
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrmd.client import Rover
from validation.options import asked
from validation.residual_field.closed_loop import unfamiliar

POSES, REPEATS, GOALS, VISITS = 240, 8, 72, 2
TRIES = 6
"""Of measuring, which goes on, and of a visit: the simulated board of a busy computer does not answer in time."""
TRACKER = "validation.residual_field.unfamiliar_tracker"
MM2 = 1e6
"""mm² in a m²."""
Tried = TypeVar("Tried")


class FieldSteps(DemoSteps):
    """The demo's steps, and those that name everything and add a field."""

    def name_all(self) -> None:
        """Follows the advice to its end."""
        files = self.file("fitted.toml"), self.file("measured.csv"), "-o", self.file("named.toml")
        self._ident("auto", *files, "--no-nested")

    def add_field(self) -> bool:
        """Adds a field; whether the tool found that it helps."""
        files = self.file("named.toml"), self.file("measured.csv"), "residual_field", "-o", self.file("field.toml")
        try:
            self._ident("add", *files)
        except LrmError:
            return False
        return True


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

    def solve(self, goal: Sequence[float], near: Sequence[float], payload: float) -> GoalCommand | str:
        """See `GoalSolver`."""
        return self.solver.solve(goal, self.start[tuple(goal)], payload)


@dataclass(frozen=True)
class GoalVisits:
    """The goals (m) of a seed and, for each visit, the poses that they are answered from (rad)."""

    goals: Array
    starts: tuple[Array, ...]

    @classmethod
    def of(cls, count: int, seed: int) -> GoalVisits:
        """Goals as `verify` draws them; poses that keep clear of everything."""
        arm = load_arm(ARM)
        rng = np.random.default_rng([seed, 8])
        return cls(draw_goals(arm, count, seed), tuple(clear_poses(arm, count, rng) for _ in range(VISITS)))

    def visit(self, world: World, number: int, slower: float = 1.0) -> Array:
        """(goals,), squared distances of the tip from the goals (m²); NaN where one was not reached.

        `slower`: how many times longer the arm rests.
        """
        arm, targets = load_arm(ARM), TargetNumbers(TOOL, BASE)
        timing = PoseTiming(0.0, slower * SETTLE_S, slower * DWELL_S)
        goals = [tuple(goal) for goal in self.goals.tolist()]
        start = {goal: tuple(q) for goal, q in zip(goals, self.starts[number].tolist(), strict=True)}
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


@dataclass(frozen=True)
class GoalErrors:
    """Squared distances (visits × goals,) from the goals with names alone, and with a field too (m²); None: not added.

    NaN where a goal was not reached.
    """

    named: Array
    field: Array | None

    @property
    def words(self) -> str:
        """Columns: RMS of either over the goals that both reached, z of the paired difference, goals left out."""
        if self.field is None:
            return f"{_rms_mm(self.named[np.isfinite(self.named)]):.2f} | not added | |"
        both = np.isfinite(self.named) & np.isfinite(self.field)
        named, field = self.named[both], self.field[both]
        z = vuong_z(named - field)
        return f"{_rms_mm(named):.2f} | {_rms_mm(field):.2f} | {z:.1f} | {int((~both).sum())} |"


def goal_errors(seed: int, poses: int, goals: int) -> GoalErrors:
    """Errors of the tip with either model, each `VISITS` times over the goals."""
    visits = GoalVisits.of(goals, seed)
    with tempfile.TemporaryDirectory(prefix="lrm-field-") as out:
        steps = FieldSteps(Path(out), (), seed, str(goals))
        steps.write_poses(pose_table(load_arm(ARM), poses, REPEATS, seed))

        def measure() -> None:
            """Goes on where it was interrupted."""
            with world_of(seed) as world:
                arm = *world.daemon, "--tracker", f"dtrack:{world.tracker_port}"
                replace(steps, arm=arm).measure("--load-command", world.load_command)

        def visit(model: str, number: int) -> Array:
            """See `GoalVisits.visit`, with a model of the folder."""
            with world_of(seed) as world:
                subprocess.run([*shlex.split(world.load_command), f"{LOAD_G:g}"], check=True)
                steps.deploy(f"{model}.toml", *world.daemon)
                return visits.visit(world, number)

        def reached(model: str) -> Array:
            """Squared distances of all visits."""
            return np.concatenate([tried(partial(visit, model, number)) for number in range(VISITS)])

        tried(measure)
        steps.fit()
        steps.name_all()
        field = reached("field") if steps.add_field() else None
        return GoalErrors(reached("named"), field)


@contextmanager
def world_of(seed: int) -> Iterator[World]:
    """The arm of a seed, with files of its own."""
    with (
        tempfile.TemporaryDirectory(prefix="lrm-demo-") as private,
        simulated_world(Path(private), seed, TRACKER) as world,
    ):
        yield world


def tried(piece: Callable[[], Tried]) -> Tried:
    """The result of a piece of the loop, which is begun anew where it fails. Raises `LrmError` after `TRIES`."""
    for _ in range(TRIES - 1):
        try:
            return piece()
        except LrmError as error:
            print(f"once more: {error}", file=sys.stderr, flush=True)
    return piece()


def _rms_mm(squares: Array) -> float:
    return float(np.sqrt(squares.mean() * MM2))


def main() -> None:
    """Prints one line a seed."""
    known = asked(__doc__, first=(0, "seed to begin with"), seeds=(10, "how many"), poses=POSES, goals=GOALS)
    print(
        "| seed | hidden | named mm | with a field mm | z of the gain | goals not reached |\n|---|---|---|---|---|---|"
    )
    for seed in range(known.first, known.first + known.seeds):
        with contextlib.redirect_stdout(io.StringIO()):
            found = goal_errors(seed, known.poses, known.goals)
        print(f"| {seed} | {unfamiliar(seed).name} | {found.words}", flush=True)


if __name__ == "__main__":
    main()
