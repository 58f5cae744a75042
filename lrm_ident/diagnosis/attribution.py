"""Whether an effect shows a cause: sensitivity to an omitted one (Cinelli & Hazlett 2020).

A cause that the catalogue lacks is taken in part by effects that resemble it, and the rest of it stays as structure or
as error above the noise. So what stays unexplained bounds what may have been named wrongly: where it is not small
beside what an effect took away, the effect may stand for that cause. What later effects took that show no cause counts
as unexplained too, unless they are forms of effects that are there.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO

AttributionTerm = Literal["identified cause", "indistinguishable cause", "candidate cause", "empirical term"]
"""What an added effect is, in the words that people and files read."""


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


def attribute_steps(steps: Sequence[tuple[float, Evidence]], left: float) -> tuple[StepAttribution, ...]:
    """Attributions of successive steps, of each the held-out mean square that it took away, and the evidence for it.

    left: held-out mean square that stays unexplained after the last one.
    """
    found: list[StepAttribution] = []
    for explained, step in reversed(steps):
        sure = step.replicates and left <= MAX_UNEXPLAINED_RATIO * explained
        shown = Support.FINDING if sure else Support.POSSIBLE_CAUSE
        found.append(StepAttribution(Support.DESCRIPTION if step.describes else shown, left))
        if found[-1].kind != Support.FINDING and not step.of_present:
            left += max(explained, 0.0)
    return tuple(reversed(found))


def unexplained_mean_square(report: DiagnosisReport) -> float:
    """Held-out mean square (m²) above the noise, where that is unknown above its bound; 0 if nothing is missing."""
    if report.verdict.quiet:
        return 0.0
    floor = report.diagnosis.floor.rms or report.left.predictable.noise_bound
    return max(report.held_out.rms**2 - floor**2, 0.0)


def unexplained_ratio(report: DiagnosisReport) -> float | None:
    """Held-out mean square above the noise that the effect to add would leave, per mean square that it takes away.

    A noise that is not known is at most what a black-box model leaves. None where no effect is to be added.
    """
    floor = report.diagnosis.floor.rms or report.left.predictable.noise_bound
    if report.first is None:
        return None
    left, before = report.first.held_out_rms**2, report.held_out.rms**2
    return max(left - floor**2, 0.0) / (before - left)


def attribution_of(report: DiagnosisReport) -> Support | None:
    """Attribution of the effect that a diagnosis would add; None where it would add none."""
    if report.first is None or not report.verdict.adds:
        return None
    if report.verdict == Verdict.EFFECT_DESCRIBES:
        return Support.DESCRIPTION
    ratio = unexplained_ratio(report)
    unsure = ratio is not None and ratio > MAX_UNEXPLAINED_RATIO
    return Support.POSSIBLE_CAUSE if unsure or not report.replicates else Support.FINDING
