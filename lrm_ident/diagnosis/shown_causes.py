"""Whether an effect shows a cause: sensitivity to an omitted one (Cinelli & Hazlett 2020).

A cause that the catalogue lacks is taken in part by effects that resemble it, and the rest of it stays as structure or
as error above the noise. So what stays unexplained bounds what may have been named wrongly: where it is not small
beside what an effect took away, the effect may stand for that cause.
"""

from __future__ import annotations

from typing import Literal

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.residual.thresholds import LEFT_PER_TAKEN

Claim = Literal["finding", "possible_cause", "description"]
"""A cause that is shown; one that may stand for another; an effect that predicts better and shows no cause."""


def claim(describes: bool, left: float, taken: float) -> Claim:
    """Claim of a step of `auto` that took a mean square away, of what is `left` unexplained at the end (both m²)."""
    if describes:
        return "description"
    return "finding" if left <= LEFT_PER_TAKEN * taken else "possible_cause"


def unexplained_square(report: DiagnosisReport) -> float:
    """Held-out mean square (m²) above the noise, where that is unknown above its bound; 0 if nothing is missing."""
    if report.verdict in ("nothing_missing", "noise_unknown"):
        return 0.0
    floor = report.diagnosis.floor.rms or report.left.predictable.noise_bound
    return max(report.held_out.rms**2 - floor**2, 0.0)


def left_per_taken(report: DiagnosisReport) -> float | None:
    """Held-out mean square above a known noise that the effect to add would leave, per mean square that it takes away;
    None where no effect is to be added, or the noise is unknown."""
    floor = report.diagnosis.floor.rms
    if report.first is None or floor is None:
        return None
    left, before = report.first.held_out_rms**2, report.held_out.rms**2
    return max(left - floor**2, 0.0) / (before - left)
