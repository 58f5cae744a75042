"""The figures of the README beside the confusion table, on other seeds than the table's.

`python -m validation.hidden_effects.other_seeds`: `auto` on two and three hidden effects, no hidden effect,
few poses, and unknown noise.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.cross_validation import cross_validated_residual
from lrm_ident.fitting.executors import executor_for, in_order
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from validation.hidden_effects.case import LAB
from validation.hidden_effects.cases import CASES, DOUBLE, NOTHING, SINGLE, TRIPLE
from validation.hidden_effects.data import write_case
from validation.hidden_effects.examine import base_model
from validation.hidden_effects.outcome import FLOOR_MM, Outcome

FIRST_SEED, FLOOR_M = 100, FLOOR_MM / 1000.0


@dataclass(frozen=True)
class DataSetSpec:
    """One data set: its case, seed and size, whether the noise is known, and whether `auto` runs on it."""

    case: str
    seed: int
    poses: int
    noise_known: bool = True
    auto: bool = False

    def graded(self, one: Outcome) -> str:
        """right, wrong (one name, not the truth), or the verdict that was given instead."""
        named, truth = [name for step in one.steps for name in step], one.of.truth or ()
        if not truth:
            return "right" if one.verdict == ("nothing_missing" if self.noise_known else "noise_unknown") else "wrong"
        if all(name in named for name in truth):
            return "right"
        if len(named) == 1 and not self.auto:
            return "wrong"
        return "in part" if named else one.verdict


def searched(spec: DataSetSpec) -> Outcome:
    """Makes the data set, fits `offsets,compliance`, and searches: steps of `auto`, or the first class."""
    arm = load_arm(LAB)
    with TemporaryDirectory() as folder:
        path = write_case(CASES[spec.case], spec.seed, spec.poses, Path(folder))
        if not spec.noise_known:
            path.with_suffix(".toml").unlink()
        data = load_measurements(path, arm)
    try:
        model = base_model(data, arm)
        if spec.auto:
            course = run_auto(model, data)
            steps, verdict = tuple((step.added,) for step in course.steps[1:]), course.verdict
            left = error_stats(cross_validated_residual(course.model, data)).rms
        else:
            report = build_report(diagnose(model, data))
            first, verdict = report.first, report.verdict
            steps = () if first is None else ((first.scored.name, *first.equivalent),)
            left = report.held_out.rms if first is None else first.held_out_rms
    except LrmError as error:
        return Outcome(spec.case, spec.seed, verdict=str(error))
    return Outcome(spec.case, spec.seed, steps, verdict, left / FLOOR_M)


def _specs(
    cases: Iterable[str], seeds: int, poses: int, noise_known: bool = True, auto: bool = False
) -> list[DataSetSpec]:
    return [DataSetSpec(case, FIRST_SEED + seed, poses, noise_known, auto) for case in cases for seed in range(seeds)]


def main() -> None:
    """Runs all groups and prints one line each."""
    groups = {
        "two or three effects, auto, 300 poses": _specs([*DOUBLE, *TRIPLE], 3, 300, auto=True),
        "nothing hidden, 300 poses": _specs([NOTHING.name], 20, 300),
        "nothing hidden, 120 poses, noise not known": _specs([NOTHING.name], 10, 120, noise_known=False),
        "one effect, 120 poses, noise not known": _specs(SINGLE, 3, 120, noise_known=False),
        "one effect, 50 poses": _specs(SINGLE, 4, 50),
    }
    with executor_for(most=os.cpu_count()) as pool:
        for name, specs in groups.items():
            graded = [(spec.graded(one), one) for spec, one in zip(specs, in_order(pool, searched, specs), strict=True)]
            counts = ", ".join(f"{n} {what}" for what, n in Counter(grade for grade, _ in graded).most_common())
            worst = max(one.ratio or 0.0 for grade, one in graded if grade == "right")
            words = f"{len(specs)} data sets, {counts}; worst error over noise where right {worst:.2f}"
            print(f"{name}: {words}", flush=True)


if __name__ == "__main__":
    main()
