"""Calibrated inverse kinematics on reachable goals: success rate, accuracy and time.

A goal is the tool frame that the model gives for random commands within the limits; errors are those of the model's
own equilibrium, settled anew from the start for every branch.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_ident.data.examples import EXAMPLE
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.ik.answer import CalibratedReply, Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import AT_LIMIT, Method
from lrm_math.ik.goal import CHAR_LENGTH, IkQuery, pose
from lrm_math.ik.methods import Cube, Direct
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import COMPENSATED
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from validation.options import Count, asked
from validation.tables import markdown_table

ROOT = Path(__file__).resolve().parents[1]
TABLE_B2 = ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml"
PLAY_AND_BENDING = ("backlash", "lateral_compliance", "servo_gain")
SMOOTH = tuple(kind.id for kind in CATALOGUE if set(kind.depends_on) <= COMPENSATED)
PAYLOAD = 0.0663
METHODS: tuple[Method, Method] = (Direct(), Cube())
QUICK = Cube(guesses=2, name="cube, 2 guesses")
EXACT, CLOSE = 1e-9, 1e-3  # m
STARTS = 96
DISTINCT = 1e-3
"""rad: commands no further apart count as one branch; singular poses have ever more of them."""


@dataclass(frozen=True)
class IkAccuracy:
    """Success, accuracy and time of one method on the goals of one model: shares of the goals, m, s.

    `close_before_polish`: share of goals that the cube had within a millimetre before; None for other methods.
    """

    model: str
    method: str
    goals: int
    solved: float
    worst_error: float
    branches: float
    p50: float
    p99: float
    close_before_polish: float | None


def with_effects(model: Model, names: tuple[str, ...], seed: int = 0, size: float = 0.3) -> Model:
    """The model and more effects at every place where they can act, of up to `size` times what is typical."""
    have = {(effect.id, effect.place) for effect in model.effects}
    added = [e for name in names for e in effects_at(model.arm, name) if (e.id, e.place) not in have]
    known = dict(zip(model.keys, model.values.tolist(), strict=True))
    full = model_of(model.arm, (*model.effects, *added), known)
    rng = np.random.default_rng(seed)
    values = {
        key: rng.uniform(0.2, 1.0) * size * p.typical * (1.0 if p.lower == 0.0 else rng.choice([-1.0, 1.0]))
        for key, p in zip(full.keys, full.parameters, strict=True)
        if key not in known and p.fixed is None
    }
    return model_of(model.arm, full.effects, known | values)


def models() -> Iterator[tuple[str, Model]]:
    """The thesis's parameters on the rover's arm, a model fitted to the shipped example, and more effects in either."""
    thesis = load_model(TABLE_B2)
    arm = load_arm("lrm-lab")
    drawn = nominal_model(arm)
    fitted = fit(replace(drawn, free=select_parameters(drawn, "option1")), load_measurements(EXAMPLE, arm)).model
    yield "rover, Table B.2", thesis
    yield "lab, fitted", fitted
    yield "rover, play + bending + gain", with_effects(thesis, PLAY_AND_BENDING)
    yield "lab, play + bending + gain", with_effects(fitted, PLAY_AND_BENDING)
    yield "rover, whole catalogue", with_effects(thesis, SMOOTH, size=0.15)


def goals(model: Model, count: int, seed: int = 1) -> Array:
    """(N, 4, 4), tool frames at random commands within the limits, with a load, where the arm settles."""
    lower, upper = ([getattr(joint, end) for joint in model.arm.joints] for end in ("lower", "upper"))
    q = np.random.default_rng(seed).uniform(lower, upper, (count, model.arm.dof))
    equilibrium, _ = batch_equilibrium(model, poses_of(q, PAYLOAD), tolerance=1e-13)
    return frames(model.chain, equilibrium.slots, len(equilibrium.poses))[:, -1]


def replies(solver: CalibratedSolver, tools: Array, method: Method) -> list[CalibratedReply]:
    """One reply per goal; each with the time it took."""
    solver.warm_up()
    return [solver.solve(pose(tool[:3, 3], tool[:3, :3]), PAYLOAD, method=method) for tool in tools]


def figures(name: str, solver: CalibratedSolver, tools: Array, method: Method) -> IkAccuracy:
    """The figures of one method on some goals."""
    answers = replies(solver, tools, method)
    solved = [(i, reply) for i, reply in enumerate(answers) if isinstance(reply, Solved)]
    owner = np.array([i for i, reply in solved for _ in reply.branches])
    commands = np.array([branch.q for _, reply in solved for branch in reply.branches])
    equilibrium, rows = batch_equilibrium(solver.arm.model, poses_of(commands, PAYLOAD), tolerance=1e-12)
    error = np.full(len(commands), np.inf)
    error[rows] = np.linalg.norm(equilibrium.true_tcp - tools[owner[rows], :3, 3], axis=1)
    exact = {i for i, off in zip(owner.tolist(), error.tolist(), strict=True) if off <= EXACT}
    cube = [reply.cube_error for _, reply in solved if reply.cube_error is not None]
    times = np.array([reply.elapsed for reply in answers])
    return IkAccuracy(
        model=name,
        method=method.name,
        goals=len(tools),
        solved=len(exact) / len(tools),
        worst_error=float(error.max()),
        branches=len(commands) / len(tools),
        p50=float(np.percentile(times, 50)),
        p99=float(np.percentile(times, 99)),
        close_before_polish=float(np.sum(np.array(cube) <= CLOSE) / len(tools)) if cube else None,
    )


def one_cube(solver: CalibratedSolver, tools: Array) -> float:
    """Median time (s) of a single cube: one correction, 11³ goals by the nominal inverse, the arm at rest at each."""
    once, took = Cube(moves=0, guesses=1), []
    for tool in tools:
        query = IkQuery(pose(tool[:3, 3], tool[:3, :3]), PAYLOAD)
        started = time.perf_counter()
        once.search(solver.arm, query)
        took.append(time.perf_counter() - started)
    return float(np.median(took))


def exhaustive(solver: CalibratedSolver, query: IkQuery) -> list[Array]:
    """Commands within the limits that the `STARTS` closest poses of the library lead to."""
    arm, library = solver.arm, solver.arm.library
    goal = query.goal
    off = ((library.tcp[:, :3, 3] - goal.position) ** 2).sum(axis=1)
    off += CHAR_LENGTH**2 * ((library.tcp[:, :3, :3] - np.array(goal.rotation)) ** 2).sum(axis=(1, 2))
    reached = [c for row in np.argsort(off)[:STARTS] for c in arm.at_goal(query, library.slots[row])]
    return distinct([np.array(command.q) for command in reached if command.margin >= -AT_LIMIT])


def distinct(commands: list[Array]) -> list[Array]:
    """Those further than `DISTINCT` from all before them."""
    kept: list[Array] = []
    for q in commands:
        if all(np.abs(q - other).max() > DISTINCT for other in kept):
            kept.append(q)
    return kept


def shares_of_branches(solver: CalibratedSolver, tools: Array) -> tuple[float, float]:
    """Shares of all branches known, by `STARTS` starts or either of `METHODS`, that `METHODS` answer with."""
    found, known = [0, 0], 0
    for tool in tools:
        query = IkQuery(pose(tool[:3, 3], tool[:3, :3]), PAYLOAD)
        answers = [solver.solve(query.goal, PAYLOAD, method=method) for method in METHODS]
        rows = [[np.array(b.q) for b in r.branches] if isinstance(r, Solved) else [] for r in answers]
        every = distinct([*exhaustive(solver, query), *rows[0], *rows[1]])
        known += len(every)
        for i, answered in enumerate(rows):
            found[i] += sum(any(np.abs(q - row).max() < DISTINCT for row in answered) for q in every)
    return found[0] / known, found[1] / known


def goals_met(direct: list[IkAccuracy]) -> str:
    """Whether the direct method meets its time goals; the first two models have springs and rigid errors alone."""

    def verdict(some: list[IkAccuracy], p50: float, p99: float) -> str:
        met = all(f.p50 <= p50 and f.p99 <= p99 for f in some)
        worst = f"{1e3 * max(f.p50 for f in some):.2f} and {1e3 * max(f.p99 for f in some):.2f}"
        return f"{1e3 * p50:g} and {1e3 * p99:g} ms at p50 and p99 are {'met' if met else 'missed'} ({worst} at worst)"

    return (
        f"Goals of direct, whatever is in the model: {verdict(direct, 1e-3, 3e-3)}; "
        f"with offsets and compliance alone: {verdict(direct[:2], 0.2e-3, 1e-3)}"
    )


COLUMNS = ("model", "method", "goals", "solved", "worst mm", "branches", "p50 ms", "p99 ms", "cube < 1 mm")


def main() -> None:
    """Prints the table, then what it leaves out."""
    options = asked(
        __doc__,
        goals=(Count(2000), "goals per model for the direct method"),
        cube_goals=(Count(400), "goals per model for the cube"),
    )
    rows: list[tuple[object, ...]] = []
    shares: list[str] = []
    direct_figures: list[IkAccuracy] = []
    for name, model in models():
        tools = goals(model, options.goals)
        solver = CalibratedSolver.of(model)
        for method, count in ((Direct(), options.goals), (Cube(), options.cube_goals), (QUICK, options.cube_goals)):
            f = figures(name, solver, tools[:count], method)
            if isinstance(method, Direct):
                direct_figures.append(f)
            close = "" if f.close_before_polish is None else f"{100 * f.close_before_polish:.1f} %"
            values = (f"{100 * f.solved:.2f} %", f"{1e3 * f.worst_error:.1e}", f"{f.branches:.2f}")
            rows.append((name, f.method, f.goals, *values, f"{1e3 * f.p50:.2f}", f"{1e3 * f.p99:.2f}", close))
        tools = tools[: options.cube_goals]
        p50 = f"{1e3 * one_cube(solver, tools):.2f}"
        rows.append((name, "one cube of 11³", len(tools), *[""] * 3, p50, "", ""))
        direct, cube = shares_of_branches(solver, tools)
        shares.append(f"{name} {100 * direct:.1f} and {100 * cube:.1f} %")
    print(markdown_table(COLUMNS, rows))
    print(goals_met(direct_figures))
    print(f"Of the branches that {STARTS} starts for one goal lead to, direct and cube answer: {'; '.join(shares)}")


if __name__ == "__main__":
    main()
