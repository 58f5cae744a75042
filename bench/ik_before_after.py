"""Inverse kinematics of this checkout beside another one's, in one run: `ik_before_after --before FOLDER`.

Each checkout answers the same goals in a process of its own, in turn, a few goals at a time, so that the machine's
speed meets both alike. Times are the processor's, of the whole `CalibratedSolver.solve`; figures are ratios. Branches
are counted against the union of what both find and what 96 starts of this checkout lead to; errors are those of the
model's own equilibrium, settled anew from the start.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.model import Model

HERE = Path(__file__).resolve().parents[1]
TURN = 20
"""Goals that one checkout answers before the other one does."""
PAYLOAD = 0.0663
KINDS = ("direct", "cube", "position", "approach", "unreachable")


def answer(solver: Any, kind: str, tool: Array) -> tuple[float, list[tuple[float, ...]], float]:
    """Processor time (s), branches (rad), and distance of the nearest command (m) where there are none."""
    from lrm_math.ik.goal import point, point_along, pose
    from lrm_math.ik.methods import Cube, Direct

    goal = pose(tool[:3, 3], tool[:3, :3])
    if kind == "position":
        goal = point(tool[:3, 3])
    elif kind == "approach":
        goal = point_along(tool[:3, 3], tool[:3, 2])
    elif kind == "unreachable":
        goal = pose(1.7 * tool[:3, 3], tool[:3, :3])
    started = time.thread_time()
    reply = solver.solve(goal, PAYLOAD, method=Cube() if kind == "cube" else Direct())
    took = time.thread_time() - started
    nearest = getattr(reply, "nearest", None)
    branches = [branch.q for branch in getattr(reply, "branches", ())]
    return took, branches, float("nan") if nearest is None else float(np.hypot(nearest.distance, 0.1 * nearest.angle))


def work() -> None:
    """Answers what comes in by pickles: (model's name, kind, tools)."""
    from lrm_math.ik.calibrated import CalibratedSolver
    from validation.calibrated_ik import models

    known, solvers = dict(models()), dict[str, Any]()
    while True:
        try:
            name, kind, tools = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        if name not in solvers:
            solvers[name] = CalibratedSolver.of(known[name])
            solvers[name].warm_up()
        pickle.dump([answer(solvers[name], kind, tool) for tool in tools], sys.stdout.buffer)
        sys.stdout.buffer.flush()


@dataclass(frozen=True)
class CheckoutUnderTest:
    """A process that answers with the code of one checkout."""

    process: subprocess.Popen[bytes]

    @classmethod
    def of(cls, folder: Path) -> CheckoutUnderTest:
        """Starts it. The worker's own code is this file, whatever the checkout has."""
        environment = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder)!r}); exec(sys.argv[1])"]
        source = f"import runpy; runpy.run_path({str(Path(__file__).resolve())!r}, run_name='worker')"
        pipe = subprocess.PIPE
        return cls(subprocess.Popen([*command, source], stdin=pipe, stdout=pipe, env=environment, cwd=folder))

    def ask(self, name: str, kind: str, tools: Array) -> list[tuple[float, list[tuple[float, ...]], float]]:
        """One answer per tool frame (N, 4, 4)."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        pickle.dump((name, kind, tools), self.process.stdin)
        self.process.stdin.flush()
        return pickle.load(self.process.stdout)  # type: ignore[no-any-return]


def ratios(before: Sequence[float], after: Sequence[float]) -> str:
    """Percentiles of both (ms), and their ratios."""
    b, a = (np.percentile(np.array(some) * 1e3, [50, 99]) for some in (before, after))
    return (
        f"p50 {b[0]:7.2f} -> {a[0]:6.3f} ms ({b[0] / a[0]:5.1f} times)   p99 {b[1]:7.2f} -> {a[1]:6.2f} ms "
        f"({b[1] / a[1]:5.1f} times)"
    )


def compare(
    before: CheckoutUnderTest, after: CheckoutUnderTest, name: str, model: Model, counts: dict[str, int]
) -> None:
    """Prints one line per kind of goal."""

    from lrm_math.ik.calibrated import CalibratedSolver
    from lrm_math.ik.goal import IkQuery, pose
    from validation.calibrated_ik import distinct, exhaustive, goals

    solver, tools = CalibratedSolver.of(model), goals(model, max(counts.values()), seed=7)
    print(name)
    for kind in KINDS:
        chosen = tools[: counts[kind]]
        got: list[list[tuple[float, list[tuple[float, ...]], float]]] = [[], []]
        for start in range(0, len(chosen), TURN):
            for rows, checkout in zip(got, (before, after), strict=True):
                rows += checkout.ask(name, kind, chosen[start : start + TURN])
        line = f"  {kind:12s}{ratios([t for t, _, _ in got[0]], [t for t, _, _ in got[1]])}"
        solved = [100.0 * np.mean([bool(branches) for _, branches, _ in rows]) for rows in got]
        line += f"   solved {solved[0]:.2f} -> {solved[1]:.2f} %"
        if kind in ("direct", "cube"):
            found, known = [0, 0], 0
            for k, tool in enumerate(chosen[: counts["cube"]]):
                mine = [[np.array(q) for q in rows[k][1]] for rows in got]
                query = IkQuery(pose(tool[:3, 3], tool[:3, :3]), PAYLOAD)
                every = distinct([*mine[1], *mine[0], *exhaustive(solver, query)])
                known += len(every)
                for i, answered in enumerate(mine):
                    found[i] += sum(any(np.abs(q - row).max() < 1e-3 for row in answered) for q in every)
            line += f"   branches {100 * found[0] / known:.1f} -> {100 * found[1] / known:.1f} %"
            line += f"   worst {1e3 * worst(model, chosen, [branches for _, branches, _ in got[1]]):.1e} mm"
        if kind == "unreachable":
            nearer = np.array([[d for _, _, d in rows] for rows in got])
            line += f"   nearer in {np.sum(nearer[1] < nearer[0] - 1e-4)}, further in "
            line += f"{np.sum(nearer[1] > nearer[0] + 1e-4)} of {np.isfinite(nearer).all(axis=0).sum()}"
        print(line, flush=True)


def worst(model: Model, tools: Array, answers: list[list[tuple[float, ...]]]) -> float:
    """m, largest distance of any branch from its goal by the model's own equilibrium."""
    from lrm_math.kinematics.poses import poses_of
    from lrm_math.model.equilibrium import solve_equilibrium

    owner = [k for k, branches in enumerate(answers) for _ in branches]
    q = np.array([row for branches in answers for row in branches])
    equilibrium = solve_equilibrium(model, poses_of(q, PAYLOAD), tolerance=1e-12)
    return float(np.linalg.norm(equilibrium.true_tcp - tools[owner, :3, 3], axis=1).max())


def main() -> None:
    from validation.calibrated_ik import models

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, required=True, help="a checkout of another version")
    parser.add_argument("--goals", type=int, default=2000, help="for direct; a tenth of it for the other kinds")
    options = parser.parse_args()
    few = max(options.goals // 10, TURN)
    counts = {kind: options.goals if kind == "direct" else few for kind in KINDS}
    before, after = CheckoutUnderTest.of(options.before.resolve()), CheckoutUnderTest.of(HERE)
    for name, model in models():
        compare(before, after, name, model, counts)


if __name__ == "worker":
    work()
elif __name__ == "__main__":
    main()
