"""Score test of every candidate alone on the residual (Rao 1948; Saris, Satorra & Sörbom 1987)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_ident.data.weights.row_weights import RowWeights
from lrm_ident.diagnosis.screening.candidates import Candidate
from lrm_ident.diagnosis.screening.column_sets import ColumnSets
from lrm_ident.diagnosis.screening.linearised_fit import (
    AT_ONCE,
    LinearEstimate,
    LinearisedFit,
    orthonormal_basis,
    projected_rank,
)
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.significance import f_test_p_value
from lrm_ident.residual.thresholds import MIN_DETECTABLE, SIGNIFICANCE, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import Effect

Trials = list[tuple[LinearEstimate, tuple[float, ...], ColumnSets, Array]]


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate at its best shape, alone on the residual.

    Attributes:
        shape: the effect's parameter vector at which it explains most, parameters other than shapes zero.
        alone: what it explains if nothing else is added. added: (R N,), that, pose by pose (m).
        implausible: why its estimate is impossible, or empty.
        p_value: after the scan over shapes, before Benjamini and Yekutieli.
    """

    candidate: Candidate
    shape: tuple[float, ...]
    projected: ColumnSets
    alone: LinearEstimate
    added: Array
    p_value: float
    implausible: str

    @property
    def name(self) -> str:
        """`effect@place`."""
        return self.candidate.name

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.candidate.rows)

    @cached_property
    def orthonormal(self) -> Array:
        """(R N, rank), orthonormal basis of its projected columns."""
        return orthonormal_basis(self.projected.columns)


def score_candidates(
    found: Sequence[Candidate], linear: LinearisedFit, weigh: RowWeights, progress: OnProgress
) -> tuple[list[ScoredCandidate], list[tuple[Effect, str]]]:
    """Scores every candidate; those not detectable at their typical size, and not significant, come apart, with the
    reason.

    Args:
        weigh: relative weights of the rows.
    """
    scored, undetectable = [], []
    for number, (candidate, tried) in enumerate(_tried(found, linear, weigh)):
        alone, shape, projected, columns = min(tried, key=lambda one: one[0].in_sample)
        rank, projected = projected_rank(projected.columns, columns), projected.copy()
        moved = float(np.linalg.norm(projected.columns))
        p_value = (
            f_test_p_value(linear.now.in_sample, alone.in_sample, rank, linear.degrees_of_freedom) if rank else 1.0
        )
        p_value = min(1.0, p_value * len(tried))
        if rank == 0 or (moved < MIN_DETECTABLE * linear.sigma and p_value > SIGNIFICANCE):
            each = moved / np.sqrt(len(linear.residual) / linear.rows)
            size = f"a typical size moves the TCP by only {each * 1e3:.2g} mm"
            undetectable.append((candidate.effect, f"{size} beyond what the fitted parameters already explain"))
        else:
            added = linear.pose_by_pose(projected.columns @ alone.theta)
            why_not = _implausible(candidate, alone)
            scored.append(ScoredCandidate(candidate, shape, projected, alone, added, p_value, why_not))
        progress(number + 1, 2 * len(found))
    return scored, undetectable


def _tried(found: Sequence[Candidate], linear: LinearisedFit, weigh: RowWeights) -> Iterator[tuple[Candidate, Trials]]:
    """Estimate of every candidate alone at each of its shapes; `AT_ONCE` columns or more are projected together."""
    ends = np.cumsum([len(one.rows) * len(one.shapes) for one in found])
    for number in np.unique(ends // AT_ONCE):
        together = [one for one, end in zip(found, ends, strict=True) if end // AT_ONCE == number]
        every = [weigh(one.columns(shape)) for one in together for shape in one.shapes]
        sets = linear.project_each(every, [C.shape[1] for C in every])
        ready = zip(linear.explain_each(sets), sets, every, strict=True)
        for one in together:
            yield one, [(alone, shape, own, C) for shape, (alone, own, C) in zip(one.shapes, ready)]  # noqa: B905


def _implausible(candidate: Candidate, alone: LinearEstimate) -> str:
    for parameter, theta, error in zip(candidate.parameters, alone.theta, alone.error, strict=True):
        margin = Z_THRESHOLD * error
        if theta + margin < parameter.lower or theta - margin > parameter.upper:
            return f"{parameter.name} would have to be {theta * parameter.typical / parameter.si:.3g}, against physics"
    return ""
