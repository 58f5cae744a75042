"""`python -m validation.hidden_effects.faults`: what goes wrong in a measurement, through the functions behind `auto`.

The third catalogue: faults of rows, frames, instruments and joints for which the tool has no formula, on the lab arm
with the errors of the independent generator. A run is *right* if no step has a false name, and its first name is a
right one or its verdict an honest one. Half `tune` and half `report` differ in sizes, joints, moments and seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.diagnosis_report import report_of
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm.arm_file import load_arm as load_tool_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import model_of
from validation.hidden_effects.case_generator import stable_seed
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, NOISE_M
from validation.hidden_effects.tables import markdown_table
from validation.synthetic import GroundTruth, even_schedule, load_arm, measure, random_poses
from validation.synthetic import base_displacement_to_deviations as as_deviations
from validation.synthetic.generate import directions
from validation.synthetic.screws import rotation_matrix

FIRST_SEED = {"tune": 3000, "report": 4000}
ALWAYS_TRUE = ("offsets", "compliance")
QUIET, HONEST = ("nothing_missing",), ("unexplained_structure", "unpredictable")


@dataclass(frozen=True, eq=False)
class HealthyMeasurement:
    """A healthy measurement: commands q (N, 6) (rad), positions tcp (N, 3) (m); `at`: those of other joint angles."""

    q: Array
    tcp: Array
    at: Callable[[Array], Array]
    rng: np.random.Generator


Fault = Callable[[HealthyMeasurement], tuple[Array, Array | None]]
"""Positions (N, 3) (m) as the fault leaves them, and every pose's session where sessions are known."""


@dataclass(frozen=True, eq=False)
class FaultCase:
    """A fault, the names that are right for it, and the verdicts that are honest in the end."""

    name: str
    spoil: Fault
    right: tuple[str, ...] = ()
    verdicts: tuple[str, ...] = QUIET
    noise_known: bool = True


def _block(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    first, tcp = int(taken.rng.integers(20, len(taken.q) - 40)), taken.tcp.copy()
    rows = np.arange(first, first + int(taken.rng.integers(8, 18)))
    tcp[rows] = taken.tcp[rows - 1]
    return tcp, None


def _swapped(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    tcp = taken.tcp.copy()
    for row in taken.rng.choice(len(tcp) - 1, 4, replace=False):
        tcp[[row, row + 1]] = tcp[[row + 1, row]]
    return tcp, None


def _pushed(taken: HealthyMeasurement) -> Array:
    turn = rotation_matrix(np.radians(taken.rng.uniform(-0.3, 0.3, 3)))
    return np.asarray(taken.tcp @ np.asarray(turn).T + taken.rng.uniform(-0.003, 0.003, 3))


def _moved_between(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    session: Array = np.repeat([1.0, 2.0], [len(taken.q) // 2, len(taken.q) - len(taken.q) // 2])
    return np.where((session == 2.0)[:, None], _pushed(taken), taken.tcp), session


def _moved_meanwhile(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    when = taken.rng.uniform(0.3, 0.7) * len(taken.q)
    return np.where((np.arange(len(taken.q)) >= when)[:, None], _pushed(taken), taken.tcp), None


def _skipped_tooth(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    q, when = taken.q.copy(), int(taken.rng.uniform(0.3, 0.7) * len(taken.q))
    q[when:, int(taken.rng.integers(1, 4))] += np.radians(taken.rng.uniform(0.6, 1.5))
    return taken.at(q), None


def _loose(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    """A screw that lets a joint rest at either of two angles, whatever the pose."""
    q, size = taken.q.copy(), np.radians(taken.rng.uniform(0.4, 0.9))
    q[:, int(taken.rng.integers(1, 4))] += size * taken.rng.choice([-0.5, 0.5], len(q))
    return taken.at(q), None


def _grows(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    """All lengths grow as the room warms up."""
    return taken.tcp * (1.0 + 0.006 * np.linspace(0.0, 1.0, len(taken.q)) ** 2)[:, None], None


def _heavy_tails(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    noise = taken.rng.standard_t(3.0, taken.tcp.shape) / np.sqrt(3.0)
    return taken.at(taken.q) + 0.3 * NOISE_M * noise, None


def _healthy(taken: HealthyMeasurement) -> tuple[Array, Array | None]:
    return taken.tcp, None


BASE = ("session@base", "drift@base", "drift_curve@base")
CASES = (
    FaultCase("a block carries the row before", _block),
    FaultCase("four pairs of rows swapped", _swapped),
    FaultCase("tracker moved between sessions", _moved_between, BASE),
    FaultCase("tracker moved meanwhile", _moved_meanwhile, BASE, HONEST),
    FaultCase("a joint skipped a tooth", _skipped_tooth, (), HONEST),
    FaultCase("a loose screw", _loose, (), HONEST),
    FaultCase("all lengths grow", _grows, (), HONEST),
    FaultCase("heavier tails", _heavy_tails, (), (*QUIET, "unpredictable")),
    FaultCase("healthy, noise unknown", _healthy, (), ("noise_unknown",), noise_known=False),
    FaultCase("a loose screw, noise unknown", _loose, (), ("noise_unknown", *HONEST), noise_known=False),
)


@dataclass(frozen=True)
class FaultOutcome:
    """The steps of `auto`, each with its class, the verdict of the report, and what is left over the noise."""

    case: FaultCase
    seed: int
    steps: tuple[tuple[str, ...], ...]
    verdict: str
    ratio: float

    @property
    def false_names(self) -> tuple[str, ...]:
        """First names of steps in whose class nothing is right."""
        new = [step for step in self.steps if step[0].partition("@")[0] not in ALWAYS_TRUE]
        return tuple(step[0] for step in new if not set(step) & set(self.case.right))

    @property
    def honest(self) -> bool:
        """Whether the first name is right, or the verdict an honest one where nothing is named."""
        if self.steps:
            return bool(set(self.steps[0]) & set(self.case.right))
        return self.verdict in self.case.verdicts


def examine(case: FaultCase, half: str, number: int, poses: int) -> FaultOutcome:
    """Simulates a measurement, spoils it, and follows `auto`."""
    seed = FIRST_SEED[half] + number
    data = spoiled(case, seed, poses)
    arm = load_tool_arm(ARM_FILE)
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    try:
        run = run_auto(fit_identifiable(model, data, model.keys).fit.model, data)
    except LrmError as error:
        return FaultOutcome(case, seed, (), str(error), np.nan)
    steps = tuple(step.names for step in run.steps[1:])
    return FaultOutcome(case, seed, steps, report_of(run.confirmed).verdict, run.steps[-1].fit.sigma / NOISE_M)


def spoiled(case: FaultCase, seed: int, count: int) -> Measurements:
    """The measurement with the fault."""
    described, fixed = load_arm(ARM_FILE), stable_seed(case.name, seed, "fault")
    truth = as_deviations(described, GroundTruth.random(described, seed, ()))
    q, rng = random_poses(described, count, seed, floor_m=FLOOR_M), np.random.default_rng(fixed)
    plan, load = even_schedule(*q.shape), rng.choice([0.0, 0.0663], count)

    def at(angles: Array) -> Array:
        return measure(described, truth, angles, load, NOISE_M, seed, plan)

    tcp, session = case.spoil(HealthyMeasurement(q, at(q), at, rng))
    poses = Poses(q, load, directions(q, np.zeros(6)), plan.time_s, session)
    noise, pose = NOISE_M if case.noise_known else None, np.arange(1, count + 1)
    return Measurements(poses, pose, tcp, None, noise, pose, Path("simulated.csv"), "")


def table(outcomes: Sequence[FaultOutcome]) -> str:
    """Totals, then every run, as Markdown."""
    false, honest = (sum(map(bool, of)) for of in ([o.false_names for o in outcomes], [o.honest for o in outcomes]))
    rows = [
        (one.case.name, " > ".join(" or ".join(step) for step in one.steps) or "–", one.verdict, f"{one.ratio:.2f}")
        for one in outcomes
    ]
    head = (
        f"{len(outcomes)} runs: a false name in {false}, first name or verdict right in {honest} "
        "(*left*: residual over the noise)."
    )
    return f"{head}\n\n{markdown_table(('fault', 'named', 'verdict', 'left'), rows)}"


def main() -> None:
    """Read the options, run, print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects.faults", description=__doc__)
    parser.add_argument("--half", choices=tuple(FIRST_SEED), default="tune")
    parser.add_argument("--seeds", type=int, default=1, help="data sets per case")
    parser.add_argument("--poses", type=int, default=200, help="poses per data set")
    options = parser.parse_args()
    outcomes = []
    for case in CASES:
        for number in range(options.seeds):
            outcomes.append(examine(case, options.half, number, options.poses))
            print(f"{case.name}: {outcomes[-1].steps} {outcomes[-1].verdict}", file=sys.stderr, flush=True)
    print(table(outcomes))


if __name__ == "__main__":
    main()
