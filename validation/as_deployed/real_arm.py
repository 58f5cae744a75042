"""The real arm in nested folds: effects are chosen anew without each fold, which is predicted as shown and deployed.

As shown, a held-out pose has its time, number and session; as deployed it has what a rover knows after a restart, or,
`recorded`, what a daemon knows that was never off. The model as deployed
is of the other folds alone, the state that it carries included.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import FOLDS, joint_space_folds, random_folds
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.deployed_model import as_deployed_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.as_deployed.outcome import Record
from validation.as_deployed.recording import as_known_to_a_rover

MEASUREMENTS = "measurements.csv"
REAL = ("option1, blocks", "identifiable, blocks", "option1, random", "identifiable, random")
"""Parameters of the plain fit that `auto` starts from, and kind of folds."""
FOLDINGS = {"blocks": joint_space_folds, "random": random_folds}


def nested_record(folder: Path, parameters: str, folding: str, folds: int = FOLDS) -> Record:
    """RMS in mm of a plain fit and of `auto` from it, each as shown and as deployed, and what each fold chose."""
    data = load_measurements(folder / MEASUREMENTS, load_arm("lrm-lab"))
    fold = FOLDINGS[folding](data.poses.q, data.repeat_of)
    chosen: list[list[str]] = []
    plain, named = [], []
    for number in range(folds):
        train, test = data.take(fold != number), data.take(fold == number)
        start = Study.of(train).fit(parameters)
        plain.append(_errors(start.model, test))
        run, _ = start.auto()
        named.append(_errors(run.model, test))
        chosen.append([step.added for step in run.steps[1:]])
    (before_shown, before, before_recorded), (after_shown, after, after_recorded) = (
        map(_rms_mm, zip(*of, strict=True)) for of in (plain, named)
    )
    return {
        "hidden": "a real arm",
        "shown_before_mm": before_shown,
        "shown_after_mm": after_shown,
        "before_mm": before,
        "after_mm": after,
        "before_recorded_mm": before_recorded,
        "after_recorded_mm": after_recorded,
        "chosen": chosen,
    }


def _errors(model: Model, test: Measurements) -> tuple[Array, Array, Array]:
    """(n, 3) of held-out poses, m: as shown, as deployed after a restart, and as deployed where it was never off."""
    shown = solve_equilibrium(model, test.poses).tcp
    driven = [
        solve_equilibrium(as_deployed_at(model, poses), poses).tcp
        for poses in (as_known_to_a_rover(test.poses), test.poses)
    ]
    return test.tcp - shown, test.tcp - driven[0], test.tcp - driven[1]


def _rms_mm(parts: tuple[Array, ...]) -> float:
    return round(1e3 * error_stats(np.concatenate(parts)).rms, 3)
