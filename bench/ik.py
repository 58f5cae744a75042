"""Nominal inverse kinematics beside the peers: success, error and time. `python -m bench.ik` prints the table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.ik_peers import PEERS, EaikSolver, PeerSolver
from bench.timing import race
from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal, point, point_along, pose
from lrm_math.ik.nominal import NominalSolver
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

GOALS, PARTIAL_GOALS, BATCH, TIMED = 100_000, 1000, 1000, 500
BATCH_NAME = f"lrm_math, batches of {BATCH}"
TOLERANCE_M, TOLERANCE_RAD = 1e-6, 1e-6
"""Success; the largest error of the successes is shown beside it."""
SAME_RAD = 1e-3
"""The same branch: microradians from a stretched elbow, single angles are known to 1e-4 rad only."""


@dataclass(frozen=True)
class SolverRow:
    """One line: share of goals solved within the limits, worst position error of those (m), seconds per goal."""

    name: str
    goals: int
    success: float
    error: float
    seconds: float | None
    note: str = ""


def poses(arm: Arm, q: Array) -> Array:
    """(N, 4, 4), where the tool is at angles (N, n)."""
    chain = chain_of(arm)
    return frames(chain, chain.values(list(q.T.copy())), len(q))[:, -1]


def reachable(arm: Arm, count: int, seed: int = 0) -> tuple[Array, Array]:
    """Angles (N, n) drawn evenly within the limits, and the poses (N, 4, 4) that they take."""
    limits = JointLimits.of(arm)
    q = np.random.default_rng(seed).uniform(limits.lower, limits.upper, (count, arm.dof))
    return q, poses(arm, q)


def is_solution(arm: Arm, T: Array, q: Array, solved: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Array]:
    """Whether angles (N, n) keep the limits and take the poses, and how far their TCP is off (m)."""
    limits, reached = JointLimits.of(arm), poses(arm, q)
    off = np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1)
    rotated = np.abs(reached[:, :3, :3] - T[:, :3, :3]).max(axis=(1, 2))
    kept = ((q >= np.array(limits.lower) - 1e-9) & (q <= np.array(limits.upper) + 1e-9)).all(axis=1)
    return solved & kept & (off < TOLERANCE_M) & (rotated < TOLERANCE_RAD), off


def run_peer(arm: Arm, name: str, solve: Callable[[Array], Array | None], T: Array) -> SolverRow:
    """Success and error of a solver that answers one pose (4, 4) with angles (n,) or None."""
    answers = [solve(pose) for pose in T]
    solved = np.array([answer is not None for answer in answers])
    q = np.array([np.zeros(arm.dof) if answer is None else answer for answer in answers])
    good, off = is_solution(arm, T, q, solved)
    return SolverRow(name, len(T), float(good.mean()), float(off[good].max(initial=0.0)), None)


def run_batches(arm: Arm, q: Array, T: Array) -> SolverRow:
    """All branches of all goals: worst error of any branch, and goals of which the angles drawn were not found."""
    solver, missed, worst, solved = NominalSolver.of(arm), 0, 0.0, 0
    for start in range(0, len(T), BATCH):
        part = slice(start, start + BATCH)
        batch = solver.solve_batch(T[part, :3, 3], T[part, :3, :3])
        row, _ = np.nonzero(batch.valid)
        good, off = is_solution(arm, T[part][row], batch.q[batch.valid], np.ones(len(row), dtype=np.bool_))
        nearest = np.where(batch.valid, np.abs(batch.q - q[part, None]).max(axis=2), np.inf).min(axis=1)
        missed += int((nearest > SAME_RAD).sum())
        solved += int(batch.solved.sum())
        worst = max(worst, float(off.max(initial=0.0)))
        if not good.all():
            raise AssertionError(f"a branch does not take its goal: {off.max()} m")
    return SolverRow(BATCH_NAME, len(T), solved / len(T), worst, None, f"{missed} branches missed")


def run_goals(arm: Arm, name: str, goals: list[Goal]) -> SolverRow:
    """Success and error of our solver for goals of any kind."""
    solver, solved, worst = NominalSolver.of(arm), 0, 0.0
    for goal in goals:
        answer = solver.solve(goal)
        solved += answer.solved
        if answer.branches:
            T = poses(arm, np.array([branch.q for branch in answer]))
            worst = max(worst, float(np.linalg.norm(T[:, :3, 3] - goal.position, axis=1).max()))
    return SolverRow(name, len(goals), solved / len(goals), worst, None)


def branches_of_eaik_missed(arm: Arm, T: Array) -> int:
    """Number of EAIK's branches within the limits that ours misses. Raises `ImportError` where it is not installed."""
    peer, solver, missed = EaikSolver(arm), NominalSolver.of(arm), 0
    for pose_ in T:
        q = peer.branches(pose_)
        theirs = q[((q >= peer.lower) & (q <= peer.upper)).all(axis=1)]
        ours = np.array([b.q for b in solver.solve(pose(pose_[:3, 3], pose_[:3, :3]))]).reshape(-1, arm.dof)
        missed += sum(np.abs(ours - x).max(axis=1).min(initial=np.inf) > SAME_RAD for x in theirs)
    return missed


def rows(arm: Arm, count: int) -> Iterator[SolverRow]:
    """The table, ours first; peers that are not installed say so."""
    q, T = reachable(arm, count)
    goals = [pose(pose_[:3, 3], pose_[:3, :3]) for pose_ in T[:TIMED]]
    solver = NominalSolver.of(arm)
    contenders: dict[str, Callable[[], object]] = {}

    def timed(name: str, run: Callable[[object], object], over: list[object]) -> None:
        turn = cycle(over)
        contenders[name] = lambda: run(next(turn))

    found: list[SolverRow] = []
    found.append(run_peer(arm, "lrm_math, Answer with all branches in limits", _first(solver), T[:20_000]))
    timed(found[-1].name, solver.solve, list(goals))  # type: ignore[arg-type]
    if solver.form is not None:
        found.append(SolverRow("lrm_math, branches alone", 0, np.nan, np.nan, None))
        timed(found[-1].name, solver.branches, list(goals))  # type: ignore[arg-type]
    found.append(run_batches(arm, q, T))
    contenders[found[-1].name] = lambda: solver.solve_batch(T[:BATCH, :3, 3], T[:BATCH, :3, :3])
    partial = {
        "lrm_math, position and approach": [point_along(t[:3, 3], t[:3, 2]) for t in T[:PARTIAL_GOALS]],
        "lrm_math, position alone": [point(t[:3, 3]) for t in T[:PARTIAL_GOALS]],
    }
    for name, kind_goals in partial.items():
        found.append(run_goals(arm, name, kind_goals))
        timed(name, solver.solve, list(kind_goals))  # type: ignore[arg-type]
    for kind in PEERS:
        peer = _installed(kind, arm)
        if peer is None:
            found.append(SolverRow(kind.name, 0, np.nan, np.nan, None, "not installed"))
            continue
        found.append(run_peer(arm, peer.name, peer.solve, T[: min(count, peer.goals)]))
        timed(peer.name, peer.solve, list(T[:TIMED]))  # type: ignore[arg-type]
        if isinstance(peer, EaikSolver):
            timed("EAIK, all branches", peer.branches, list(T[:TIMED]))  # type: ignore[arg-type]
            note = f"{branches_of_eaik_missed(arm, T[:5000])} of its branches not ours"
            found.append(SolverRow("EAIK, all branches", 5000, np.nan, np.nan, None, note))
    spent = race(contenders)
    for row in found:
        per = spent[row.name].median / (BATCH if row.name == BATCH_NAME else 1) if row.name in spent else None
        yield SolverRow(row.name, row.goals, row.success, row.error, per, row.note)


def one_pose(arm: Arm, ours: str) -> dict[str, Callable[[], object]]:
    """Solvers to race for one pose, all branches: our closed form under the name `ours`, our whole answer, and EAIK."""
    _, T = reachable(arm, TIMED)
    goals, solver = [pose(t[:3, 3], t[:3, :3]) for t in T], NominalSolver.of(arm)
    if solver.form is None:
        raise ValueError(f"{arm.name} has no closed form")
    turns = [cycle(goals), cycle(goals), cycle(T)]

    out: dict[str, Callable[[], object]] = {ours: lambda: solver.branches(next(turns[0]))}
    out["lrm_math, Answer"] = lambda: solver.solve(next(turns[1]))
    eaik = _installed(EaikSolver, arm)
    if isinstance(eaik, EaikSolver):
        out["EAIK, limits not looked at"] = lambda: eaik.branches(next(turns[2]))
    return out


def _first(solver: object) -> Callable[[Array], Array | None]:
    def solve(T: Array) -> Array | None:
        answer = solver.solve(pose(T[:3, 3], T[:3, :3]))  # type: ignore[attr-defined]
        return np.array(answer.branches[0].q) if answer.branches else None

    return solve


def _installed(kind: type[PeerSolver], arm: Arm) -> PeerSolver | None:
    try:
        return kind(arm)
    except ImportError:
        return None


def table(arm: Arm, count: int) -> Table:
    """The rows as a table."""
    out = Table(title=f"{arm.name}: random poses within the limits, one core", title_justify="left")
    for name in ("by", "goals", "solved", "worst error", "µs per goal", ""):
        out.add_column(name, justify="left" if name in ("by", "") else "right")
    for row in rows(arm, count):
        solved = "" if np.isnan(row.success) else f"{100 * row.success:.3f} %"
        error = "" if np.isnan(row.error) else f"{row.error:.1e} m"
        spent = "" if row.seconds is None else f"{1e6 * row.seconds:.3g}"
        out.add_row(row.name, str(row.goals or ""), solved, error, spent, row.note)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arm", default="lrm-rover")
    parser.add_argument("--goals", type=int, default=GOALS)
    options = parser.parse_args()
    Console(width=130).print(table(load_arm(options.arm), options.goals))


if __name__ == "__main__":
    main()
