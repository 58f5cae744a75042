"""The one rule of better prediction: held-out errors that fall by a share worth naming, and by more than chance."""

from __future__ import annotations

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE
from lrm_ident.fitting.loss import CHI3_MEDIAN
from lrm_ident.residual.thresholds import NEGLIGIBLE, Z_THRESHOLD
from lrm_math.arrays import Array


def predicts_better(then: Array, now: Array, share: float, start: Array | None = None) -> bool:
    """Whether squared errors (N,) fall by a share of the RMS and by more than `Z_THRESHOLD` standard errors.

    Args:
        then, now: held-out squared distances with and without something. start: of whose RMS the share is; None: now.
    """
    return saves(then, now, share, start) and paired_z(then, now) > Z_THRESHOLD


def saves(then: Array, now: Array, share: float, start: Array | None = None) -> bool:
    """Whether mean squares (N,) fall by what a share of the RMS of `start` (None: of `now`) amounts to."""
    whole = float((now if start is None else start).mean())
    return float(now.mean() - then.mean()) > (1.0 - (1.0 - share) ** 2) * whole


def share_of_excess(before: float, after: float, floor: float) -> float:
    """Share of the mean square above a noise floor that is taken away; RMS errors in one unit, a floor of 0: of all."""
    return (before**2 - after**2) / max(before**2 - floor**2, NEGLIGIBLE * after**2)


def paired_z(better: Array, worse: Array) -> float:
    """`vuong_z` of squared errors (N,), winsorised at `OUTLIER_DISTANCE` robust standard deviations of the better one.

    A few poses where a joint is about to fall over to the other side of its play would decide else.
    """
    most = outlier_bound(better)
    return vuong_z(np.minimum(worse, most) - np.minimum(better, most))


def outlier_bound(squared: Array) -> Array:
    """(...), squared distance beyond which a pose of `squared` (..., N) is an outlier: `OUTLIER_DISTANCE` robust
    standard deviations."""
    return np.square(OUTLIER_DISTANCE / CHI3_MEDIAN * np.median(np.sqrt(squared), axis=-1))


def vuong_z(difference: Array) -> float:
    """z score of a paired difference of squared errors (N,): mean over its standard error (Vuong 1989)."""
    spread = float(difference.std(ddof=1)) / np.sqrt(len(difference))
    return float(difference.mean() / spread) if spread > 0 else 0.0
