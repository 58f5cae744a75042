"""Linear estimate of a candidate where all parameters stay within their bounds (Stark & Parker 1995).

The screening holds the parameters that the fit has at a bound, and no bound stops the others. Beside a large effect
both may be wrong: a compliance that the fit had put to zero comes back, or another one would have to be negative. Then
the screening promises too little of the one effect, or too much of the other.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis, truncated_svd
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import Screening, prior_rows
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.parameter_sets import bounds_of
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.residual.thresholds import EQUIVALENT_GAIN, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart
from lrm_math.model.derivatives import parameter_jacobian

AT_BOUND = 1e-9
"""Typical sizes: round-off."""


@dataclass(frozen=True, eq=False)
class BoundedEstimate:
    """What a candidate leaves beside the fitted parameters.

    Attributes:
        squares: (n,), squared distance of each screened pose (m²), predicted where it is none of those estimated from.
        as_screened: whether the parameters at a bound are those that the fit has there, and none of the candidate's.
    """

    squares: Array
    as_screened: bool


@dataclass(frozen=True, eq=False)
class BoundedFit:
    """A fit linearised at its minimum, with the bounds of its parameters, estimated from all or some of its poses.

    Attributes:
        screening: of the fit.
        training: rows that an estimate is made of: R rows of each pose, and the K rows of the prior.
        free: (R n + K, P), basis of the columns of parameters without bounds, orthonormal at the training rows.
        columns: (R n + K, p), of the parameters with a bound, in typical sizes. residual: (R n + K,), m.
        lower, upper: (p,), how far each of them may go from its value. held: (p,), which the fit has at a bound.
    """

    screening: Screening
    training: NDArray[np.int64]
    free: Array
    columns: Array
    residual: Array
    lower: Array
    upper: Array
    held: NDArray[np.bool_]

    @staticmethod
    def of(screening: Screening) -> BoundedFit:
        """The fit of a screening, estimated from all its poses."""
        fitted, data = screening.subset
        keys, linear = list(fitted.model.free), screening.linear
        typical = np.array([fitted.model.parameter(key).typical for key in keys])
        jacobian = parameter_jacobian(fitted.equilibrium, keys, data.whitening.sensed) * typical
        measured = screening.weigh(jacobian.reshape(linear.measured, len(keys)))
        residual = screening.weigh(data.residual(fitted.equilibrium).reshape(-1, 1))[:, 0]
        prior, prior_residual = prior_rows(fitted, keys)
        every, right = np.concatenate([measured, prior]), np.concatenate([residual, prior_residual])
        limits, values = bounds_of(fitted.model, keys), np.array([fitted.model.value(key) for key in keys])
        bounded = np.isfinite(limits.lower) | np.isfinite(limits.upper)
        at_bound = np.array([key in fitted.at_bound for key in keys], dtype=np.bool_)
        lower, upper = (((limit - values) / typical)[bounded] for limit in (limits.lower, limits.upper))
        own = orthonormal_basis(every[:, ~bounded]), every[:, bounded], right
        return BoundedFit(screening, np.arange(len(right)), *own, lower, upper, at_bound[bounded])

    def from_poses(self, poses: NDArray[np.int64]) -> BoundedFit:
        """The fit estimated from these of the screened poses; what it leaves at the others is a prediction."""
        linear = self.screening.linear
        measured = (linear.rows * poses[:, None] + np.arange(linear.rows)).reshape(-1)
        training = np.concatenate([measured, np.arange(linear.measured, len(self.residual))])
        free = self.free @ truncated_svd(np.asarray(np.linalg.qr(self.free[training], mode="r")))[1]
        return replace(self, training=training, free=free)

    @cached_property
    def baseline(self) -> BoundedEstimate:
        """Estimate of no candidate: the error of the fit as it is."""
        return self._estimate(np.zeros((len(self.residual), 0)), np.zeros((2, 0)))

    def explain(self, scored: ScoredCandidate) -> BoundedEstimate:
        """Estimate of a candidate at its best shape."""
        return self.explain_each([scored])[0]

    def explain_each(self, candidates: Sequence[ScoredCandidate]) -> list[BoundedEstimate]:
        """Estimate of each candidate alone at its best shape."""
        measured = self.screening.linear.measured
        moved = [np.zeros((measured, 0)), *(scored.at_shape[1] for scored in candidates)]
        every = np.zeros((len(self.residual), sum(columns.shape[1] for columns in moved)))
        every[:measured] = self.screening.weigh(np.hstack(moved))
        columns_of_each = np.split(
            self._projected(every), np.cumsum([columns.shape[1] for columns in moved[:-1]]), axis=1
        )[1:]
        return [
            self._estimate(columns, _limits(scored))
            for scored, columns in zip(candidates, columns_of_each, strict=True)
        ]

    def _estimate(self, added: Array, own_limits: Array) -> BoundedEstimate:
        """Estimate of further columns (R n + K, m), `free` projected out, within limits (2, m)."""
        from scipy.optimize import lsq_linear  # takes a quarter of a second to load

        (bounded_columns, residual), linear, size = self._left, self.screening.linear, added.shape[1]
        columns, right = np.hstack([bounded_columns, added]), residual[self.training]
        ridge = np.hstack([np.zeros((size, bounded_columns.shape[1])), np.sqrt(linear.ridge) * np.eye(size)])
        trained = np.column_stack([np.vstack([columns[self.training], ridge]), np.append(right, np.zeros(size))])
        root = np.asarray(np.linalg.qr(trained, mode="r"))  # as good as all rows
        lower, upper = np.append(self.lower, own_limits[0]), np.append(self.upper, own_limits[1])
        most = 100 * max(len(lower), 1)  # of iterations: each goes down, and few are needed
        amounts = lsq_linear(root[:, :-1], root[:, -1], (lower, upper), method="bvls", max_iter=most).x
        left = (residual - columns @ amounts)[: linear.measured].reshape(-1, linear.rows)
        held = (amounts <= lower + AT_BOUND) | (amounts >= upper - AT_BOUND)
        as_screened = np.array_equal(held, np.append(self.held, np.zeros(size, dtype=np.bool_)))
        return BoundedEstimate((left**2).sum(axis=1), as_screened)

    @cached_property
    def _left(self) -> tuple[Array, Array]:
        """`columns` and `residual`, `free` projected out."""
        return self._projected(self.columns), self._projected(self.residual)

    def _projected(self, rows: Array) -> Array:
        """Rows (R n + K, …) less their prediction by `free`, whose amounts the training rows give."""
        return np.asarray(rows - self.free @ (self.free[self.training].T @ rows[self.training]))

    def left_by(self, fitted: Fit) -> Array:
        """(n,), squared distance of each screened pose that a refit leaves (m²)."""
        (_, data), linear = self.screening.subset, self.screening.linear
        residual = data.residual(fitted.equilibrium.take(self.screening.screened)).reshape(-1, 1)
        return np.asarray((self.screening.weigh(residual).reshape(-1, linear.rows) ** 2).sum(axis=1))

    def underrated(
        self, first: ScoredCandidate, equivalent: Collection[str], refit: Fit | None
    ) -> list[ScoredCandidate]:
        """Plain effects that may explain more than the `first` one, or as much, the most promising first.

        Within the bounds they promise to leave less than it promises itself, or left when refitted (`refit`). Where a
        bound changed an estimate, those that prediction cannot separate from it count too: it is the rule of
        `equivalent_effects`, in the sample. `equivalent` ones count only where a bound shows that they promise more.
        One whose own estimate is beyond a bound is implausible by the screening, and may explain as much within it. An
        effect of the measurement is no rival of one of the arm.
        """
        estimate_of_first = self.explain(first)
        squares = (
            estimate_of_first.squares
            if refit is None
            else max(estimate_of_first.squares, self.left_by(refit), key=np.sum)
        )
        measures = first.candidate.effect.part is ModelPart.MEASUREMENT
        before = float((self.screening.linear.residual[: self.screening.linear.measured] ** 2).sum())
        least = EQUIVALENT_GAIN * (before - float(squares.sum()))
        rivals = [
            scored
            for scored in self.screening.scored
            if scored is not first
            and not scored.candidate.effect.is_free_form
            and (measures or scored.candidate.effect.part is not ModelPart.MEASUREMENT)
        ]
        better = []
        for one, estimate in zip(rivals, self.explain_each(rivals), strict=True):
            rest = float(estimate.squares.sum())
            changed, equivalent_to_first = (
                not (estimate_of_first.as_screened and estimate.as_screened),
                one.name in equivalent,
            )
            near = changed and before - rest > least and paired_z(squares, estimate.squares) < Z_THRESHOLD
            less = rest < float(squares.sum())
            if (changed and less) if equivalent_to_first else (near or less):
                better.append((rest, one))
        return [candidate for _, candidate in sorted(better, key=lambda pair: pair[0])]


def _limits(scored: ScoredCandidate) -> Array:
    """(2, m), how far the parameters of a candidate may go from its best shape, in typical sizes."""
    acting, _ = scored.at_shape
    each = [
        ((p.lower - scored.shape[row]) / p.typical, (p.upper - scored.shape[row]) / p.typical)
        for row, p in zip(acting.rows, acting.parameters, strict=True)
    ]
    return np.array(each).reshape(-1, 2).T
