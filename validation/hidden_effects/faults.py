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
    """A healthy measurement: commands q (N, 6) (rad), load (N,) (kg), positions tcp (N, 3) (m); `at`: positions at
    other joint angles."""

    q: Array
    load: Array
    tcp: Array
    at: Callable[[Array], Array]
    rng: np.random.Generator


@dataclass(frozen=True, eq=False)
class SpoiledMeasurement:
    """Positions (N, 3) (m) as a fault leaves them, every pose's session where known, and the names that are
    right for it."""

    tcp: Array
    session: Array | None = None
    right: tuple[str, ...] = ()


Fault = Callable[[HealthyMeasurement], SpoiledMeasurement]


@dataclass(frozen=True, eq=False)
class FaultCase:
    """A fault, and the verdicts that are honest in the end."""

    name: str
    spoil: Fault
    verdicts: tuple[str, ...] = QUIET
    noise_known: bool = True


def _joint(taken: HealthyMeasurement) -> int:
    return int(taken.rng.integers(1, 4))


def _moment(taken: HealthyMeasurement) -> int:
    return int(taken.rng.uniform(0.3, 0.7) * len(taken.q))


def _block(taken: HealthyMeasurement) -> SpoiledMeasurement:
    first, tcp = int(taken.rng.integers(20, len(taken.q) - 40)), taken.tcp.copy()
    rows = np.arange(first, first + int(taken.rng.integers(8, 18)))
    tcp[rows] = taken.tcp[rows - 1]
    return SpoiledMeasurement(tcp)


def _swapped(taken: HealthyMeasurement) -> SpoiledMeasurement:
    tcp = taken.tcp.copy()
    for row in taken.rng.choice(len(tcp) - 1, 4, replace=False):
        tcp[[row, row + 1]] = tcp[[row + 1, row]]
    return SpoiledMeasurement(tcp)


def _pushed(taken: HealthyMeasurement) -> Array:
    turn = rotation_matrix(np.radians(taken.rng.uniform(-0.3, 0.3, 3)))
    return np.asarray(taken.tcp @ np.asarray(turn).T + taken.rng.uniform(-0.003, 0.003, 3))


def _moved_between(taken: HealthyMeasurement) -> SpoiledMeasurement:
    session: Array = np.repeat([1.0, 2.0], [len(taken.q) // 2, len(taken.q) - len(taken.q) // 2])
    return SpoiledMeasurement(np.where((session == 2.0)[:, None], _pushed(taken), taken.tcp), session, BASE)


def _moved_meanwhile(taken: HealthyMeasurement) -> SpoiledMeasurement:
    after = np.arange(len(taken.q)) >= _moment(taken)
    return SpoiledMeasurement(np.where(after[:, None], _pushed(taken), taken.tcp), None, BASE)


def _moved_twice(taken: HealthyMeasurement) -> SpoiledMeasurement:
    row = np.arange(len(taken.q))[:, None]
    first, second = (np.array([0.3, 0.6]) * len(row)).astype(int)
    between = np.where(row >= first, _pushed(taken), taken.tcp)
    return SpoiledMeasurement(np.where(row >= second, _pushed(taken), between), None, BASE)


def _slips(taken: HealthyMeasurement, joint: int, degrees: float) -> SpoiledMeasurement:
    q, name = taken.q.copy(), f"change_point@joint{joint + 1}"
    q[_moment(taken) :, joint] += np.radians(degrees)
    return SpoiledMeasurement(taken.at(q), None, (name,))


def _skipped_tooth(taken: HealthyMeasurement) -> SpoiledMeasurement:
    return _slips(taken, _joint(taken), taken.rng.uniform(0.6, 1.5))


def _reflector_slipped(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The reflector turns about the last axis, as if the last joint stood elsewhere."""
    return _slips(taken, taken.q.shape[1] - 1, taken.rng.uniform(3.0, 6.0))


def _loose(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A screw that lets a joint rest at either of two angles, whatever the pose."""
    q, size = taken.q.copy(), np.radians(taken.rng.uniform(0.4, 0.9))
    q[:, _joint(taken)] += size * taken.rng.choice([-0.5, 0.5], len(q))
    return SpoiledMeasurement(taken.at(q))


def _loosens(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The same, but the screw comes loose in the middle."""
    q, size = taken.q.copy(), np.radians(taken.rng.uniform(0.6, 1.2))
    since = _moment(taken)
    q[since:, _joint(taken)] += size * taken.rng.choice([-0.5, 0.5], len(q) - since)
    return SpoiledMeasurement(taken.at(q))


def _grows(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """All lengths grow as the room warms up."""
    return SpoiledMeasurement(taken.tcp * (1.0 + 0.006 * np.linspace(0.0, 1.0, len(taken.q)) ** 2)[:, None])


def _supply_sags(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """All servos fall short of their angles together, the more the farther out the arm holds itself and its load."""
    moment = np.linalg.norm(taken.tcp[:, :2], axis=1) * (0.2 + taken.load)
    sag = taken.rng.uniform(0.03, 0.05) * moment / moment.max()
    return SpoiledMeasurement(taken.at(taken.q * (1.0 - sag[:, None])))


def _belt_across(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A belt beside two joints turns one by the sine of the sum of the others' angles."""
    q, joint = taken.q.copy(), _joint(taken)
    q[:, joint] += np.radians(taken.rng.uniform(0.6, 1.0)) * np.sin(2.0 * (q[:, joint - 1] + q[:, joint + 1]))
    return SpoiledMeasurement(taken.at(q))


def _line_of_sight(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """One reading in twelve lies too far along the line of sight, by some millimetres (a reflection)."""
    camera = np.array([1.5, -1.0, 0.8])
    sight = taken.tcp - camera
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    far = (taken.rng.random(len(sight)) < 1 / 12) * taken.rng.uniform(1.5, 4.0, len(sight)) * 1e-3
    return SpoiledMeasurement(taken.tcp + far[:, None] * sight)


def _heavy_tails(taken: HealthyMeasurement) -> SpoiledMeasurement:
    noise = taken.rng.standard_t(3.0, taken.tcp.shape) / np.sqrt(3.0)
    return SpoiledMeasurement(taken.at(taken.q) + 0.3 * NOISE_M * noise)


def _healthy(taken: HealthyMeasurement) -> SpoiledMeasurement:
    return SpoiledMeasurement(taken.tcp)


BASE = ("session@base", "drift@base", "drift_curve@base", "change_point@base")
CASES = (
    FaultCase("a block carries the row before", _block),
    FaultCase("four pairs of rows swapped", _swapped),
    FaultCase("tracker moved between sessions", _moved_between),
    FaultCase("tracker moved meanwhile", _moved_meanwhile),
    FaultCase("tracker moved twice", _moved_twice, HONEST),
    FaultCase("a joint skipped a tooth", _skipped_tooth),
    FaultCase("the reflector slipped", _reflector_slipped),
    FaultCase("a loose screw", _loose, HONEST),
    FaultCase("a screw comes loose", _loosens, HONEST),
    FaultCase("all lengths grow", _grows, HONEST),
    FaultCase("a supply that sags", _supply_sags, HONEST),
    FaultCase("a belt across two joints", _belt_across, HONEST),
    FaultCase("reflections", _line_of_sight, (*QUIET, *HONEST)),
    FaultCase("heavier tails", _heavy_tails, (*QUIET, "unpredictable")),
    FaultCase("healthy", _healthy),
    FaultCase("healthy, noise unknown", _healthy, ("noise_unknown",), noise_known=False),
    FaultCase("a loose screw, noise unknown", _loose, ("noise_unknown", *HONEST), noise_known=False),
)


@dataclass(frozen=True)
class FaultOutcome:
    """The steps of `auto`, each with its class, which of them are findings, the verdict of the report, and what is left
    over the noise."""

    case: FaultCase
    right: tuple[str, ...]
    steps: tuple[tuple[str, ...], ...]
    findings: tuple[bool, ...]
    verdict: str
    ratio: float

    @property
    def false_names(self) -> tuple[str, ...]:
        """First names of steps in whose class nothing is right."""
        new = [step for step in self.steps if step[0].partition("@")[0] not in ALWAYS_TRUE]
        return tuple(step[0] for step in new if not set(step) & set(self.right))

    @property
    def false_findings(self) -> tuple[str, ...]:
        """Those of them that are said to be findings."""
        said = {step[0] for step, finding in zip(self.steps, self.findings, strict=True) if finding}
        return tuple(name for name in self.false_names if name in said)

    @property
    def honest(self) -> bool:
        """Whether the first name is right, or the verdict an honest one where nothing is named."""
        if self.steps:
            return bool(set(self.steps[0]) & set(self.right))
        return self.verdict in self.case.verdicts


def examine(case: FaultCase, half: str, number: int, poses: int) -> FaultOutcome:
    """Simulates a measurement, spoils it, and follows `auto`."""
    seed = FIRST_SEED[half] + number
    data, right = spoiled(case, seed, poses)
    arm = load_tool_arm(ARM_FILE)
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    try:
        run = run_auto(fit_identifiable(model, data, model.keys).fit.model, data)
    except LrmError as error:
        return FaultOutcome(case, right, (), (), str(error), np.nan)
    steps = tuple(step.names for step in run.steps[1:])
    findings = tuple(not step.describes for step in run.steps[1:])
    return FaultOutcome(
        case, right, steps, findings, report_of(run.confirmed).verdict, run.steps[-1].fit.sigma / NOISE_M
    )


def spoiled(case: FaultCase, seed: int, count: int) -> tuple[Measurements, tuple[str, ...]]:
    """The measurement with the fault, and the names that are right for it."""
    described, fixed = load_arm(ARM_FILE), stable_seed(case.name, seed, "fault")
    truth = as_deviations(described, GroundTruth.random(described, seed, ()))
    q, rng = random_poses(described, count, seed, floor_m=FLOOR_M), np.random.default_rng(fixed)
    plan, load = even_schedule(*q.shape), rng.choice([0.0, 0.0663], count)

    def at(angles: Array) -> Array:
        return measure(described, truth, angles, load, NOISE_M, seed, plan)

    found = case.spoil(HealthyMeasurement(q, load, at(q), at, rng))
    noise, pose = NOISE_M if case.noise_known else None, np.arange(1, count + 1)
    poses = Poses(q, load, directions(q, np.zeros(6)), plan.time_s, found.session, number=pose)
    return Measurements(poses, pose, found.tcp, None, noise, pose, Path("simulated.csv"), ""), found.right


def table(outcomes: Sequence[FaultOutcome]) -> str:
    """Totals, then every run, as Markdown."""
    false, said, honest = (
        sum(map(bool, of)) for of in zip(*((o.false_names, o.false_findings, o.honest) for o in outcomes), strict=True)
    )
    rows = [(one.case.name, _steps(one), one.verdict, f"{one.ratio:.2f}") for one in outcomes]
    head = (
        f"{len(outcomes)} runs: a false name in {false}, as a finding in {said}, first name or verdict right in "
        f"{honest} (*left*: residual over the noise; in brackets: steps that only describe)."
    )
    return f"{head}\n\n{markdown_table(('fault', 'named', 'verdict', 'left'), rows)}"


def _steps(one: FaultOutcome) -> str:
    """Names of the steps with their classes; those that only describe in brackets."""
    named = [" or ".join(step) for step in one.steps]
    said = (name if finding else f"({name})" for name, finding in zip(named, one.findings, strict=True))
    return " > ".join(said) or "–"


def main() -> None:
    """Read the options, run, print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects.faults", description=__doc__)
    parser.add_argument("--half", choices=tuple(FIRST_SEED), default="tune")
    parser.add_argument("--seeds", type=int, default=1, help="data sets per case")
    parser.add_argument("--poses", type=int, default=200, help="poses per data set")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    options = parser.parse_args()
    outcomes = []
    for case in [one for one in CASES if options.only in one.name]:
        for number in range(options.seeds):
            outcomes.append(examine(case, options.half, number, options.poses))
            print(f"{case.name}: {outcomes[-1].steps} {outcomes[-1].verdict}", file=sys.stderr, flush=True)
    print(table(outcomes))


if __name__ == "__main__":
    main()
