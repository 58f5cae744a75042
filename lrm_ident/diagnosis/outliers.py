"""Outliers of a screening: poses that neither the fit nor the best single candidate explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.screening import Screening, fitted_columns
from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE
from lrm_ident.fitting.loss import robust_scale
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.model.derivatives import respond
from lrm_math.model.equilibrium import equilibrium


def find_outliers(scores: Screening) -> tuple[int, ...]:
    """Numbers of the poses farther out than twice the outlier distance of a fit, with the best single candidate and
    without it.

    Twice, because an effect that is still missing may put whole groups of poses far out.
    """
    distance = _distances(scores)
    return tuple(scores.data.pose[scores.screened[distance > _limit(distance)]].tolist())


def find_explained(scores: Screening, left_out: Measurements) -> tuple[int, ...]:
    """Numbers of those poses, left out of a screening, that the fit or its best single candidate explains."""
    try:
        settled = equilibrium(scores.fit.model, left_out.poses)
        distance = _length(scores, left_out, left_out.residual(settled))
        if scores.ranked:
            changed = left_out.residual(settled) - _by_best_candidate(scores, left_out)
            distance = np.minimum(distance, _length(scores, left_out, changed))
    except NoEquilibrium:
        return ()
    return tuple(left_out.pose[distance <= _limit(_distances(scores))].tolist())


def _distances(scores: Screening) -> Array:
    """(n,), held-out distance of each screened pose by the best single candidate, or without it where that is nearer.

    As measured: a robust loss gives a pose the less weight the farther out it is, which would hide it here.
    """
    squared = scores.linear.now.held_out
    if scores.ranked:
        squared = np.minimum(squared, scores.ranked[0].alone.held_out)
    return np.asarray(np.sqrt(squared / scores.fit.weight[scores.screened]))


def _limit(distance: Array) -> float:
    return 2 * OUTLIER_DISTANCE * robust_scale(distance)


def _length(scores: Screening, data: Measurements, residual: Array) -> Array:
    """(n,), length of a residual (n, R) in the units of `_distances`."""
    whitened = data.whitening(residual) * scores.subset[1].whitening.unit
    return np.asarray(np.linalg.norm(whitened, axis=1))


def _by_best_candidate(scores: Screening, data: Measurements) -> Array:
    """(n, R), what the best candidate predicts at other poses, the fitted parameters refitted beside it (linear)."""
    best, (fitted, part) = scores.ranked[0], scores.subset
    sensed = part.whitening.sensed
    along = scores.weigh(best.candidate.columns(best.shape)) @ best.alone.theta
    beside = np.linalg.lstsq(scores.weigh(fitted_columns(fitted, fitted.rest, sensed)), -along, rcond=None)[0]
    there = respond(equilibrium(scores.response.equilibrium.model, data.poses), sensed)
    own = replace(best.candidate, response=there).columns(best.shape) @ best.alone.theta
    return np.asarray((own + fitted_columns(fitted, there.equilibrium, sensed) @ beside).reshape(len(data), -1))
