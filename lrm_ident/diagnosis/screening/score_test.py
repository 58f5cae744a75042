"""Score test of every candidate alone on the residual (Rao 1948; Saris, Satorra & Sörbom 1987)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.candidates import Candidate, Refusal
from lrm_ident.diagnosis.screening.column_sets import ColumnSets, columns_of, side_by_side, stacks_of
from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis, projected_rank
from lrm_ident.diagnosis.screening.linearised_fit import AT_ONCE, LinearEstimate, LinearisedFit
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.significance import f_test_p_value
from lrm_ident.residual.thresholds import MIN_DETECTABLE, SIGNIFICANCE, Z_THRESHOLD
from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate at its best shape, alone on the residual.

    Attributes:
        candidate: with the parameters that move something at these poses. size: number of all its parameters.
        shape: the effect's parameter vector at which it explains most, parameters other than shapes zero.
        projected: its columns, the fitted parameters' projected out.
        alone: estimate of it alone. added: (R N,), the motion that it explains, pose by pose (m).
        p_value: of the F test, corrected for the scan over shapes but not for the number of candidates.
        implausible: why its estimate is physically impossible, or None.
    """

    candidate: Candidate
    size: int
    shape: tuple[float, ...]
    projected: ColumnSets
    alone: LinearEstimate
    added: Array
    p_value: float
    implausible: Reason | None

    def __repr__(self) -> str:
        return f"<{self.name} alone: p = {self.p_value:.2g}>"

    @property
    def name(self) -> str:
        """`effect@place`."""
        return self.candidate.name

    @property
    def parameter_count(self) -> int:
        """Number of its parameters, and of those of its shape that were scanned."""
        return self.size + int(np.count_nonzero(np.ptp(np.array(self.candidate.shapes), axis=0)))

    @cached_property
    def at_shape(self) -> tuple[Candidate, Array]:
        """`Candidate.acting` at its best shape."""
        return self.candidate.acting(self.shape)

    @cached_property
    def orthonormal(self) -> Array:
        """(R N, rank), orthonormal basis of its projected columns."""
        return orthonormal_basis(self.projected.columns)


def score_candidates(
    candidates: Sequence[Candidate], linear: LinearisedFit, weigh: RowWeights, progress: OnProgress
) -> tuple[list[ScoredCandidate], ColumnSets, list[Refusal]]:
    """Scores every candidate.

    Args:
        weigh: relative weights of the rows.

    Returns the scored candidates, their projected columns side by side, and the effects that are neither detectable at
    their typical size nor significant, with the reason.
    """
    detectable, kept, undetectable = [], [], []
    for number, (trial, columns) in enumerate(_at_best_shapes(candidates, linear, weigh)):
        moved = float(np.linalg.norm(columns))
        p_value = 1.0
        if trial.rank:
            p_value = f_test_p_value(linear.baseline.in_sample, trial.in_sample, trial.rank, linear.degrees_of_freedom)
        p_value = min(1.0, p_value * trial.candidate.trials)
        if trial.rank == 0 or (moved < MIN_DETECTABLE * linear.sigma and p_value > SIGNIFICANCE):
            each = moved / np.sqrt(linear.measured / linear.rows)
            undetectable.append((trial.candidate.effect, Reason(ReasonKind.HARDLY_MOVES, (float(each),))))
        else:
            detectable.append((trial, p_value))
            kept.append(columns)
        progress(number + 1, 2 * len(candidates))
    together = side_by_side(kept, len(linear.residual))
    kept.clear()  # of thousands of poses they are large
    sets = linear.in_folds(*together)
    scored = []
    for (trial, p_value), projected, alone in zip(detectable, sets, linear.explain_each(sets), strict=True):
        added, why_not = linear.pose_by_pose(projected.columns @ alone.theta), _implausible(trial.candidate, alone)
        found_at = trial.candidate, trial.size, trial.shape
        scored.append(ScoredCandidate(*found_at, projected, alone, added, p_value, why_not))
    return scored, sets, undetectable


@dataclass(frozen=True, eq=False)
class _Trial:
    """A candidate at the shape at which it explains most in the sample: the rank of its projected columns, and the
    residual sum of squares that it leaves (m²)."""

    candidate: Candidate
    size: int
    shape: tuple[float, ...]
    rank: int
    in_sample: float


def _at_best_shapes(
    candidates: Sequence[Candidate], linear: LinearisedFit, weigh: RowWeights
) -> Iterator[tuple[_Trial, Array]]:
    """Every candidate at its best shape, and its projected columns (R N, m); about `AT_ONCE` columns are projected
    together."""
    ends = np.cumsum([len(candidate.rows) * len(candidate.shapes) for candidate in candidates])
    for number in np.unique(ends // AT_ONCE):
        together = [candidate for candidate, end in zip(candidates, ends, strict=True) if end // AT_ONCE == number]
        shapes = [(candidate, shape) for candidate in together for shape in candidate.shapes]
        acting, moved = zip(*(candidate.acting(shape) for candidate, shape in shapes), strict=True)
        every = [weigh(C) for C in moved]
        squares, starts = (
            linear.residual_squares(every),
            np.cumsum([0, *(len(candidate.shapes) for candidate in together)]),
        )
        best = [start + int(np.argmin(squares[start:end])) for start, end in pairwise(starts.tolist())]
        stacks = stacks_of([every[row].shape[1] for row in best])
        columns, place = linear.residualised((every[row] for row in best), stacks), columns_of(stacks)
        for row, moved_rows in zip(best, (columns[:, place[i]].copy("F") for i in range(len(best))), strict=True):
            (at_best, shape), rank = shapes[row], projected_rank(moved_rows, every[row])
            yield _Trial(acting[row], len(at_best.rows), shape, rank, float(squares[row])), moved_rows


def _implausible(candidate: Candidate, alone: LinearEstimate) -> Reason | None:
    """Why an estimate lies beyond the bounds of physics by more than its errors; None if it does not."""
    for parameter, theta, error in zip(candidate.parameters, alone.theta, alone.error, strict=True):
        margin = Z_THRESHOLD * error
        if theta + margin < parameter.lower or theta - margin > parameter.upper:
            value = float(theta * parameter.typical / parameter.si)
            return Reason(ReasonKind.IMPLAUSIBLE, (value,), (parameter.name,))
    return None
