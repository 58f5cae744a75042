"""Which steps of `auto` show a cause: sensitivity to an omitted cause (Cinelli & Hazlett 2020).

A cause that the catalogue lacks is taken in part by effects that resemble it, and the rest of it stays as structure or
as error above the noise. So what stays unexplained at the end bounds what may have been named wrongly: where it is not
small beside what a step took away, the step may stand for that cause.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

from lrm_ident.data.error_stats import error_stats
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.residual.thresholds import LEFT_PER_TAKEN

Claim = Literal["finding", "possible_cause", "description"]
"""A cause that is shown; one that may stand for another; an effect that predicts better and shows no cause."""


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


def taken_squares(course: AutoRun) -> tuple[float, ...]:
    """Held-out mean square (m²) that each step after the start took away."""
    squares = [error_stats(step.held_out).rms ** 2 for step in course.steps]
    return tuple(before - after for before, after in pairwise(squares))


def claims(course: AutoRun, report: DiagnosisReport) -> tuple[Claim, ...]:
    """Claims of the steps after the start, given the report of the diagnosis after the last one."""
    left = unexplained_square(report)
    return tuple(
        "description" if step.describes else "finding" if left <= LEFT_PER_TAKEN * taken else "possible_cause"
        for step, taken in zip(course.steps[1:], taken_squares(course), strict=True)
    )
