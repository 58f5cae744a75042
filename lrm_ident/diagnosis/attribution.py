"""Whether an effect shows a cause: sensitivity to an omitted one (Cinelli & Hazlett 2020).

A cause that the catalogue lacks is taken in part by effects that resemble it, and the rest of it stays as structure or
as error above the noise. So what stays unexplained bounds what may have been named wrongly: where it is not small
beside what an effect took away, the effect may stand for that cause. What other effects took that show no cause counts
as unexplained too, be it before or after, unless they are forms of effects that are there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_math.model.model_file import AttributionTerm


def term_of(kind: Support, equivalent: Collection[str]) -> AttributionTerm:
    """The word for an effect; `equivalent`: those that the data cannot distinguish from it."""
    if kind == Support.DESCRIPTION:
        return "empirical term"
    if kind == Support.POSSIBLE_CAUSE:
        return "candidate cause"
    return "indistinguishable cause" if equivalent else "identified cause"


@dataclass(frozen=True)
class StepAttribution:
    """Attribution of a step; `unexplained`: mean square that may belong to another cause, in the same unit."""

    kind: Support
    unexplained: float


def support_of(explained: float, remaining: float, evidence: Evidence) -> Support:
    """Support of an effect by the held-out mean squares that it took away and that stay unexplained, in one unit.

    One that takes nothing away explains nothing: it shows no cause, however little stays.
    """
    if evidence.describes:
        return Support.DESCRIPTION
    shown = evidence.replicates and not evidence.misspecified and explained > 0.0
    return Support.FINDING if shown and remaining <= MAX_UNEXPLAINED_RATIO * explained else Support.POSSIBLE_CAUSE


def unexplained_ratio(explained: float, remaining: float) -> float:
    """Mean square that stays unexplained, per mean square that was taken away; infinite where none was."""
    return remaining / explained if explained > 0.0 else math.inf


def attribute_steps(steps: Sequence[tuple[float, Evidence]], remaining: float) -> tuple[StepAttribution, ...]:
    """Attributions of the steps of a run, of each the held-out mean square that it took away, and the evidence for it.

    Whatever their order: the largest set of steps of which each shows a cause beside what the others leave unexplained.

    Args:
        remaining: held-out mean square that stays unexplained after the last one.
    """
    shown = [True] * len(steps)
    while True:
        unnamed = [
            0.0 if show or step.of_present else max(explained, 0.0)
            for show, (explained, step) in zip(shown, steps, strict=True)
        ]
        beside = [remaining + sum(unnamed[:number]) + sum(unnamed[number + 1 :]) for number in range(len(steps))]
        attributions = tuple(
            StepAttribution(support_of(explained, others, step), others)
            for others, (explained, step) in zip(beside, steps, strict=True)
        )
        findings = [attribution.kind == Support.FINDING for attribution in attributions]
        if findings == shown:
            return attributions
        shown = findings


def unexplained_mean_square(report: DiagnosisReport) -> float:
    """Held-out mean square (m²) above the noise (`_above_noise`); 0 if nothing is missing."""
    return 0.0 if report.verdict == Verdict.NOTHING_MISSING else _above_noise(report, report.held_out.rms)


def explained_by_first(report: DiagnosisReport) -> tuple[float, float] | None:
    """Held-out mean squares (m²) that the effect to add takes away, and that it leaves above the noise; None where no
    effect is to be added."""
    if report.first is None:
        return None
    after = report.first.held_out_rms
    return report.held_out.rms**2 - after**2, _above_noise(report, after)


def _above_noise(report: DiagnosisReport, rms: float) -> float:
    """Mean square above the noise. A noise that is not known is at most what a black-box model leaves. It may be far
    less, since not every cause can be predicted: so much counts then that a cause must explain more than all that
    stays."""
    floor = report.diagnosis.floor.rms
    if floor is not None:
        return max(rms**2 - floor**2, 0.0)
    return max(rms**2 - report.patterns.predictable.noise_bound**2, MAX_UNEXPLAINED_RATIO * rms**2)


def attribution_of(report: DiagnosisReport) -> Support | None:
    """Attribution of the effect that a diagnosis would add; None where it would add none."""
    squares = explained_by_first(report)
    if report.first is None or squares is None or not report.verdict.adds:
        return None
    describes, misspecified = report.verdict == Verdict.EFFECT_DESCRIBES, report.first.name in report.misspecified
    return support_of(*squares, Evidence(describes=describes, replicates=report.replicates, misspecified=misspecified))
