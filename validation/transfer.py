"""`python -m validation.transfer`: a model of the laboratory's arm goes to the rover, where it is mounted anew.

Arms of the independent generator with random errors are measured on the rig, 300 poses, and fitted. The same arm, links
and springs alike, then stands on a rover: another base, another tool, another base compliance, and gravity leans by up
to 8 degrees against the tracker's frame. `lrm-ident transfer` takes the arm's part along and identifies the
installation from the poses that `design --installation` chooses. Beside it: a full calibration with 300 poses on the
rover. In every other world a gear ripple is hidden that neither model has. Errors of the tip are those at 200 fresh
poses, without the tracker's noise, and with it, as a held-out error counts it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.design.installation import COUNTS, expected_errors, installation_poses
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.fitting.transfer import INSTALLED
from lrm_ident.study.study import Study
from lrm_ident.study.transfer import identified, transfer_of
from lrm_math.arm import arm_file
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation import synthetic
from validation.options import Count, asked
from validation.runner import run_cases
from validation.synthetic.generate import directions
from validation.synthetic.screws import rotation_matrix
from validation.tables import Column, figure, grouped, spread, table

RIG, ROVER = "lrm-lab", "lrm-rover"
SEEDS, FULL, FRESH, NOISE, FLOOR = 20, 300, 200, 3e-4, 0.1
MOST_LEAN = math.radians(8.0)
ANGLE, LENGTH = 0.04, 0.006
"""rad, m: how far another base and another tool stand off their drawing (standard deviations)."""
RIPPLE_RAD = (0.004, 0.008)


@dataclass(frozen=True)
class AtPoses:
    """One arm after so many poses on the rover, `FULL`: fitted anew; `rippled`: whether a gear ripple is hidden.

    rms: error of the tip at fresh poses (m). full: that of the full calibration. expected: as the tool expects it.
    """

    rippled: bool
    poses: int
    rms: float
    full: float
    expected: float | None

    def ratio(self, noise: float = 0.0) -> float:
        """Error over that of the full calibration, both with noise (m per axis) on what they are compared with."""
        return math.hypot(self.rms, math.sqrt(3.0) * noise) / math.hypot(self.full, math.sqrt(3.0) * noise)


def examine(seed: int) -> list[AtPoses]:
    """Measures and fits an arm on the rig, and takes it to the rover: by the number of poses there."""
    rippled = bool(seed % 2)
    rng = np.random.default_rng([seed, 57])
    ripple = synthetic.ToothRipple(2 + seed % 3, int(rng.integers(3, 6)), rng.uniform(*RIPPLE_RAD), rng.uniform(0, 6))
    rig, rover = (synthetic.load_arm(arm_file.shipped_arms()[name]) for name in (RIG, ROVER))
    random = synthetic.GroundTruth.random(rig, seed, (ripple,) if rippled else ())
    truth, leaning = synthetic.base_displacement_to_deviations(rig, random), leant(rover, rng)
    there = synthetic.base_displacement_to_deviations(rover, remounted(random, rng))
    bench = _fitted(DEFAULT_EFFECTS, _measured(RIG, rig, truth, _poses(rig, FULL, seed), seed))
    fresh = _measured(ROVER, leaning, there, _poses(rover, FRESH, seed + 1000), None)
    begun = transfer_of(bench.file, bench.model, bench.covariance, ROVER)
    rms = {0: _error(begun.model, fresh)}
    for count in COUNTS:
        few = _measured(ROVER, leaning, there, installation_poses(begun.start, count).q, seed + count)
        rms[count] = _error(identified(begun, few).model, fresh)
    full = _measured(ROVER, leaning, there, _poses(rover, FULL, seed + 2000), seed + 1)
    rms[FULL] = _error(_fitted(list(dict.fromkeys([*DEFAULT_EFFECTS, *INSTALLED])), full).model, fresh)
    expected = dict(expected_errors(begun.start))
    return [AtPoses(rippled, poses, error, rms[FULL], expected.get(poses)) for poses, error in rms.items()]


def remounted(truth: synthetic.GroundTruth, rng: np.random.Generator) -> synthetic.GroundTruth:
    """The same arm with another base, base compliance and tool; its displaced links turn with the base."""
    spread = np.array([*[ANGLE] * 3, *[LENGTH] * 3])
    base, tool = (rng.normal(size=6) * spread for _ in range(2))
    turn = rotation_matrix(base[:3]) @ rotation_matrix(np.array(truth.displacements[0][:3])).T
    links = [(np.reshape(link, (2, 3)) @ turn.T).reshape(-1) for link in truth.displacements[1:-1]]
    displacements = tuple(tuple(row.tolist()) for row in (base, *links, tool))
    return replace(truth, displacements=displacements, base_compliance_rad_per_nm=float(rng.uniform(0.0, 0.04)))


def leant(arm: synthetic.ArmDescription, rng: np.random.Generator) -> synthetic.ArmDescription:
    """The arm under gravity that leans to a random side of the frame of measurement."""
    angle, side = rng.uniform(0.0, MOST_LEAN), rng.uniform(0.0, 2.0 * math.pi)
    turn = angle * np.array([math.cos(side), math.sin(side), 0.0])
    return arm.tilted(turn)


def _poses(arm: synthetic.ArmDescription, count: int, seed: int) -> Array:
    return synthetic.random_poses(arm, count, seed, floor_m=FLOOR)


def _measured(
    name: str, arm: synthetic.ArmDescription, truth: synthetic.GroundTruth, q: Array, seed: int | None
) -> Measurements:
    """Measurements at commands q (rad); without noise if there is no seed."""
    tcp = synthetic.measure(arm, truth, q, 0.0, 0.0 if seed is None else NOISE, seed or 0)
    described = arm_file.load_arm(name)
    poses = Poses(q, np.zeros(len(q)), directions(q, np.zeros(q.shape[1])))
    return Measurements.of_tcp(poses, tcp, NOISE, source=Source(arm=described, arm_name=name))


def _fitted(effects: Sequence[str], data: Measurements) -> Study:
    return Study.of(data, effects).fit()


def _error(model: Model, fresh: Measurements) -> float:
    return error_stats(fresh.tcp - solve_equilibrium(model, fresh.poses).tcp).rms


COLUMNS: dict[str, Column[AtPoses]] = {
    "error of the tip (mm), median (worst)": spread(lambda one: 1e3 * one.rms, 2),
    "expected": figure(lambda one: None if one.expected is None else 1e3 * one.expected),
    "over a full calibration": spread(AtPoses.ratio, 2),
    "with noise": spread(lambda one: one.ratio(NOISE), 2),
}


def group(one: AtPoses) -> str:
    """What is hidden, and how many poses."""
    return f"{'a gear ripple' if one.rippled else 'nothing'}, {one.poses}"


def line(key: str, found: Sequence[AtPoses]) -> str:
    """Errors of one arm (mm) by the number of poses."""
    return f"{key} " + ", ".join(f"{one.poses}: {1e3 * one.rms:.2f}" for one in found)


def main() -> None:
    """Prints a table."""
    options = asked(__doc__, seeds=Count(SEEDS), first=0, jobs=1)
    seeds = range(options.first, options.first + options.seeds)
    found = run_cases({str(seed): seed for seed in seeds}, examine, line, options.jobs)
    every = sorted(itertools.chain(*found.values()), key=lambda one: (one.rippled, one.poses))
    print(table("hidden, poses on the rover", grouped(every, group), COLUMNS))


if __name__ == "__main__":
    main()
