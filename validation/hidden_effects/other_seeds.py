"""The figures of the README beside the confusion table, on other seeds than the table's.

`python -m validation.hidden_effects.other_seeds`: `auto` on two and three hidden effects, no hidden effect,
few poses, and unknown noise.
"""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.cross_validation import cross_validated_residual
from lrm_ident.fitting.executors import executor_for, in_order
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.model.model import Model, model_of
from validation.hidden_effects.cases import CASES, DOUBLE, NOTHING, SINGLE, TRIPLE
from validation.hidden_effects.data import NOISE_M, write_case

FIRST_SEED = 100
FLOOR_M = NOISE_M * 3**0.5


@dataclass(frozen=True)
class DataSetSpec:
    """One data set: its case, seed and size, whether the noise is known, and whether `auto` runs on it."""

    case: str
    seed: int
    poses: int
    noise_known: bool = True
    auto: bool = False


@dataclass(frozen=True)
class SearchOutcome:
    """Names found (steps of `auto`, or the first class), the verdict, and error over noise."""

    spec: DataSetSpec
    named: tuple[str, ...]
    verdict: str
    ratio: float

    @property
    def outcome(self) -> str:
        """right, wrong (one name, not the truth), or the verdict that was given instead."""
        truth = CASES[self.spec.case].truth or ()
        if not truth:
            right = "nothing_missing" if self.spec.noise_known else "noise_unknown"
            return "right" if self.verdict == right else "wrong"
        if all(name in self.named for name in truth):
            return "right"
        return (
            "wrong" if len(self.named) == 1 and not self.spec.auto else (self.verdict if not self.named else "in part")
        )


def examine(spec: DataSetSpec) -> SearchOutcome:
    """Makes the data set, fits `offsets,compliance`, and searches."""
    data = _data(spec)
    try:
        model = _base(data)
        if spec.auto:
            course = run_auto(model, data)
            named = tuple(step.added for step in course.steps[1:])
            return SearchOutcome(
                spec, named, course.verdict, error_stats(cross_validated_residual(course.model, data)).rms / FLOOR_M
            )
        report = build_report(diagnose(model, data))
    except LrmError as error:
        return SearchOutcome(spec, (), str(error), float("nan"))
    if report.first is None:
        return SearchOutcome(spec, (), report.verdict, report.held_out.rms / FLOOR_M)
    named = (report.first.scored.name, *report.first.equivalent)
    return SearchOutcome(spec, named, report.verdict, report.first.held_out_rms / FLOOR_M)


def _data(spec: DataSetSpec) -> Measurements:
    with tempfile.TemporaryDirectory() as folder:
        path = write_case(CASES[spec.case], spec.seed, spec.poses, Path(folder))
        if not spec.noise_known:
            path.with_suffix(".toml").unlink()
        return load_measurements(path, load_arm("lrm-lab"))


def _base(data: Measurements) -> Model:
    arm = load_arm("lrm-lab")
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    return fit_identifiable(model, data, model.keys).fit.model


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
            results = in_order(pool, examine, specs)
            outcomes = ", ".join(f"{count} {what}" for what, count in Counter(r.outcome for r in results).most_common())
            worst = max(result.ratio for result in results if result.outcome == "right")
            print(
                f"{name}: {len(specs)} data sets, {outcomes}; worst error over noise where right {worst:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
