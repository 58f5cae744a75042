"""Calibrated inverse with a residual field of a hundred numbers beside that without: `python -m bench.ik_field`.

The same goals for both, reachable with the field; the two take turns at every goal. Exit code 1 where the field
takes more than `MOST` times as long, a goal is missed, or a smaller share of all branches is answered.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from bench.calibrated_ik import METHODS, PAYLOAD, goals, shares_of_branches
from lrm_ident.study.study import Study
from lrm_math.arrays import Array
from lrm_math.ik.answer import CalibratedReply, Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import Method
from lrm_math.ik.goal import pose
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import named_part
from lrm_math.model.equilibrium import solve_equilibrium
from tests.support.nameless_arm import measured

MOST, SLACK = 1.5, 0.01
"""Largest ratio of times; share of the branches by which either may differ by chance."""
EXACT = 1e-9
"""m."""


@dataclass(frozen=True)
class InverseOutcome:
    """Share of goals solved, largest error of a branch (m), branches per goal, and median processor time (s)."""

    method: str
    solved: float
    worst: float
    branches: float
    median: float


def race(solvers: list[CalibratedSolver], tools: Array, method: Method) -> list[InverseOutcome]:
    """The outcome of each solver, taking turns at every tool frame (N, 4, 4)."""
    times: list[list[float]] = [[] for _ in solvers]
    replies: list[list[CalibratedReply]] = [[] for _ in solvers]
    for tool in tools:
        for k, solver in enumerate(solvers):
            begun = time.process_time()
            replies[k].append(solver.solve(pose(tool[:3, 3], tool[:3, :3]), PAYLOAD, method=method))
            times[k].append(time.process_time() - begun)
    return [_outcome(*of, tools, method.name) for of in zip(solvers, replies, times, strict=True)]


def _outcome(
    solver: CalibratedSolver, replies: list[CalibratedReply], times: list[float], tools: Array, method: str
) -> InverseOutcome:
    solved = [(row, reply) for row, reply in enumerate(replies) if isinstance(reply, Solved)]
    owner = [row for row, reply in solved for _ in reply.branches]
    commands = np.array([branch.q for _, reply in solved for branch in reply.branches])
    equilibrium = solve_equilibrium(solver.arm.model, poses_of(commands, PAYLOAD), tolerance=1e-12)
    worst = float(np.linalg.norm(equilibrium.tcp - tools[owner, :3, 3], axis=1).max())
    return InverseOutcome(method, len(solved) / len(tools), worst, len(commands) / len(tools), float(np.median(times)))


def main() -> int:
    asked = argparse.ArgumentParser("bench.ik_field", description=__doc__)
    asked.add_argument("--goals", type=int, default=400)
    known, console, good = asked.parse_args(), Console(width=120), True
    model = Study.of(measured(1, 3e-3)).fit("option1").add_field().model
    tools = goals(model, known.goals)
    solvers = [CalibratedSolver.of(one) for one in (named_part(model), model)]
    for solver in solvers:
        solver.warm_up()
    for method in METHODS:
        without, beside = race(solvers, tools, method)
        ratio = beside.median / without.median
        good &= ratio <= MOST and beside.solved == 1.0 and beside.worst <= EXACT
        console.print(f"{method.name}: {ratio:.2f} × the time without\n  without {without}\n  with    {beside}")
    shares = [shares_of_branches(solver, tools) for solver in solvers]
    for name, share in zip(("without", "with"), shares, strict=True):
        console.print(f"{name}: {100 * share[0]:.1f} % (direct) and {100 * share[1]:.1f} % (cube) of all branches")
    return int(not good or any(b < a - SLACK for a, b in zip(*shares, strict=True)))


if __name__ == "__main__":
    sys.exit(main())
