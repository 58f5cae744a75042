"""Worlds of the third catalogue, faults of measurements, that go on.

A fault of the arm acts on measured and fresh poses; moments lie within the measurement, and what grows stays as it is
at its end. Of a tracker's, fresh tips are given in the frame that it shows at the end. Others are over by then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arrays import Array
from validation.as_deployed.catalogue import continued_schedule
from validation.as_deployed.recording import FRESH, WorldRecording, in_shown_frame
from validation.hidden_effects.case import FAULTS_REPORT, FIRST_SEED, Case, stable_seed
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, LOADS_KG, NOISE_M
from validation.hidden_effects.faults import people
from validation.hidden_effects.faults.cases import BLIND_FAULTS, FAULT_CASES
from validation.hidden_effects.faults.measurement import GoesOn, HealthyMeasurement, SpoiledMeasurement
from validation.synthetic import Dataset, GroundTruth, base_displacement_to_deviations, load_arm, measure, random_poses
from validation.synthetic.generate import rounded

WITHOUT_END = (people.rows_sorted_afterwards,)
"""Its order of rows is not that of time: no pose comes after it."""
FAULTS = {f"fault/{one.name}": one for one in (*FAULT_CASES, *BLIND_FAULTS) if one.spoil not in WITHOUT_END}


@dataclass(frozen=True, eq=False)
class FaultyMeasurement(HealthyMeasurement):
    """A measurement of `measured` poses with those that follow it; what grows has grown at its end."""

    measured: int

    def moment(self) -> int:
        return int(self.rng.uniform(0.3, 0.7) * self.measured)

    @property
    def progress(self) -> Array:
        return np.minimum(np.arange(len(self.q)) / (self.measured - 1), 1.0)


class EndOfMeasurement(FaultyMeasurement):
    """The same where all poses stand as what grows has grown at the end."""

    @property
    def progress(self) -> Array:
        return np.ones(len(self.q))


def fault_recording(case: Case, seed: int, poses: int) -> WorldRecording:
    """The world of a fault on the lab arm."""
    number, arm = FIRST_SEED[FAULTS_REPORT] + seed, load_arm(ARM_FILE)
    truth = base_displacement_to_deviations(arm, GroundTruth.random(arm, number))
    counts, drawn = (poses, FRESH), (number, stable_seed(case.name, number, "fresh"))
    q = np.vstack([random_poses(arm, n, at, floor_m=FLOOR_M) for n, at in zip(counts, drawn, strict=True)])
    load = np.random.default_rng(stable_seed(case.name, number, "loads")).choice(LOADS_KG, len(q))
    plan = continued_schedule(poses, 1, q.shape[1])
    noise = NOISE_M * np.random.default_rng(number).normal(size=(len(q), 3))
    fault = stable_seed(case.name, number, "fault")

    def at(angles: Array) -> Array:
        return measure(arm, truth, angles, load, 0.0, 0, plan)

    true = at(q)

    def spoiled(rows: int, added: Array, kind: type[FaultyMeasurement] = FaultyMeasurement) -> SpoiledMeasurement:
        def noisy(angles: Array) -> Array:
            whole = np.vstack([angles, q[len(angles) :]])
            return (at(whole) + added)[: len(angles)]

        of = (q[:rows], load[:rows], (true + added)[:rows], noisy, np.random.default_rng(fault))
        assert case.spoil is not None
        return case.spoil(kind(*of, measured=poses))

    exact = np.zeros_like(noise)
    if case.goes_on is GoesOn.ARM:
        found, tips = spoiled(len(q), noise), spoiled(len(q), exact).tcp[poses:]
    else:
        found, tips = spoiled(poses, noise), true[poses:]
        if case.goes_on in (GoesOn.FRAME, GoesOn.LAST_FRAME):
            rows = slice(poses - poses // 10 if case.goes_on is GoesOn.LAST_FRAME else 0, poses)
            tips = in_shown_frame(true[rows], spoiled(poses, exact, EndOfMeasurement).tcp[rows], tips)
    written = (_then(found.q, q), _then(found.load, load), _then(found.tcp, true))
    session = _then(found.session, np.full(len(q), 1.0 if found.session is None else found.session[-1]))
    whole = Dataset(arm, truth, replace(plan, session=session), rounded(written[0]), *written[1:], NOISE_M, number)
    return WorldRecording(ARM_FILE, whole, poses, tips, case.noise_known)


def _then(spoiled: Array | None, healthy: Array) -> Array:
    """Spoiled rows, and after them healthy ones."""
    return healthy if spoiled is None else np.concatenate([spoiled, healthy[len(spoiled) :]])
