"""Linear estimate of a candidate where all parameters stay within their bounds (Stark & Parker 1995).

The screening holds the parameters that the fit has at a bound, and no bound stops the others. Beside a large effect
both may be wrong: a compliance that the fit had put to zero comes back, or another one would have to be negative. Then
the screening promises too little of the one effect, or too much of the other.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis
from lrm_ident.diagnosis.screening.linearised_fit import LinearisedFit
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
        squares: (n,), squared distance of each screened pose (m²), in the sample.
        as_screened: whether the parameters at a bound are those that the fit has there, and none of the candidate's.
    """

    squares: Array
    as_screened: bool


@dataclass(frozen=True, eq=False)
class BoundedFit:
    """A fit linearised at its minimum, with the bounds of its parameters.

    Attributes:
        screening: of the fit. released: its linearised fit, what is held at a bound fitted too.
        free: (R n + K, P), orthonormal basis of the columns of parameters without bounds; rows of n poses, and K of the
            prior.
        columns: (R n + K, p), of the parameters with a bound, in typical sizes. residual: (R n + K,), m.
        lower, upper: (p,), how far each of them may go from its value. held: (p,), which the fit has at a bound.
    """

    screening: Screening
    released: LinearisedFit
    free: Array
    columns: Array
    residual: Array
    lower: Array
    upper: Array
    held: NDArray[np.bool_]

    @staticmethod
    def of(screening: Screening) -> BoundedFit:
        """The fit of a screening."""
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
        released = linear.beside(linear.project(measured[:, at_bound])) if at_bound.any() else linear
        free = orthonormal_basis(every[:, ~bounded])
        columns, left = _projected(every[:, bounded], free), _projected(right, free)
        return BoundedFit(screening, released, free, columns, left, lower, upper, at_bound[bounded])

    def explain(self, one: ScoredCandidate) -> BoundedEstimate:
        """Estimate of a candidate at its best shape."""
        from scipy.optimize import lsq_linear  # takes a quarter of a second to load

        linear, (acting, moved) = self.screening.linear, one.candidate.acting(one.shape)
        own = np.zeros((len(self.residual), moved.shape[1]))
        own[: linear.measured] = self.screening.weigh(moved)
        known, size = len(self.held), own.shape[1]
        ridge = np.hstack([np.zeros((size, known)), np.sqrt(linear.ridge) * np.eye(size)])
        columns = np.vstack([np.hstack([self.columns, _projected(own, self.free)]), ridge])
        right = np.append(self.residual, np.zeros(size))
        root = np.asarray(np.linalg.qr(np.column_stack([columns, right]), mode="r"))  # as good as all rows
        from_start = [
            ((p.lower - one.shape[row]) / p.typical, (p.upper - one.shape[row]) / p.typical)
            for row, p in zip(acting.rows, acting.parameters, strict=True)
        ]
        own_limits = np.array(from_start).reshape(-1, 2).T
        lower, upper = np.append(self.lower, own_limits[0]), np.append(self.upper, own_limits[1])
        most = 100 * len(lower)  # of iterations: each goes down, and few are needed
        found = lsq_linear(root[:-1, :-1], root[:-1, -1], (lower, upper), method="bvls", max_iter=most).x
        left = (right - columns @ found)[: linear.measured].reshape(-1, linear.rows)
        held = (found <= lower + AT_BOUND) | (found >= upper - AT_BOUND)
        as_screened = np.array_equal(held, np.append(self.held, np.zeros(size, dtype=np.bool_)))
        return BoundedEstimate((left**2).sum(axis=1), as_screened)

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
        own = self.explain(first)
        left = own.squares if refit is None else max(own.squares, self.left_by(refit), key=np.sum)
        measures = first.candidate.effect.part is ModelPart.MEASUREMENT
        before = float((self.screening.linear.residual[: self.screening.linear.measured] ** 2).sum())
        least = EQUIVALENT_GAIN * (before - float(left.sum()))
        # with what is held released, and no bounds, none can explain more
        most = self.released.explain_each(self.released.up_to_date(self.screening.sets))
        found = []
        for one, free in zip(self.screening.scored, most, strict=True):
            effect = one.candidate.effect
            of_other = effect.part is ModelPart.MEASUREMENT and not measures
            if one is first or of_other or effect.is_free_form or before - free.in_sample <= least:
                continue
            estimate = self.explain(one)
            rest = float(estimate.squares.sum())
            changed, known = not (own.as_screened and estimate.as_screened), one.name in equivalent
            near = changed and before - rest > least and paired_z(left, estimate.squares) < Z_THRESHOLD
            less = rest < float(left.sum())
            if (changed and less) if known else (near or less):
                found.append((rest, one))
        return [one for _, one in sorted(found, key=lambda pair: pair[0])]


def _projected(rows: Array, basis: Array) -> Array:
    """Rows (R n + K, …) less their part along an orthonormal basis (R n + K, P)."""
    return np.asarray(rows - basis @ (basis.T @ rows))
