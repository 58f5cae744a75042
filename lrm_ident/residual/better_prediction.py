"""Comparison of two predictions by their held-out errors: relevance (a share of the RMS) and significance (Vuong)."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.error_stats import CHI3_MEDIAN
from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE
from lrm_ident.residual.thresholds import FLOOR_RATIO, NEGLIGIBLE, SMALL_SHARE, Z_THRESHOLD
from lrm_math.arrays import Array


def predicts_better(after: Array, before: Array, share: float, start: Array | None = None) -> bool:
    """Whether the RMS falls by a share (`falls_by_share`), and by more than `Z_THRESHOLD` standard errors.

    Args:
        after, before: (N,), held-out squared distances with a change of the model and without it.
        start: (N,), squared distances of whose RMS the share is; None: `before`.
    """
    return falls_by_share(after, before, share, start) and paired_z(after, before) > Z_THRESHOLD


def falls_by_share(after: Array, before: Array, share: float, start: Array | None = None) -> bool:
    """Whether mean squares fall by as much as if the RMS of `start` (None: of `before`) fell by a share; (N,) each."""
    whole = float((before if start is None else start).mean())
    return float(before.mean() - after.mean()) > (1.0 - (1.0 - share) ** 2) * whole


def share_of_excess(after: float, before: float, floor: float) -> float:
    """Share of the mean square above the noise floor that a change of the model takes away; RMS errors in one unit."""
    return (before**2 - after**2) / max(before**2 - floor**2, NEGLIGIBLE * after**2)


def takes_little(after: float, before: float, floor: float) -> bool:
    """Whether a change of the model takes a small share of the mean square above the noise floor (0 if unknown) away
    while much stays; RMS errors in one unit."""
    return share_of_excess(after, before, floor) < SMALL_SHARE and after > FLOOR_RATIO * floor


def paired_z(better: Array, worse: Array) -> float:
    """`vuong_z` of squared errors (N,), winsorised at the `squared_outlier_distance` of the better ones.

    Else a few poses would decide where a joint is about to fall to the other side of its play.
    """
    return float(paired_z_of_each(better, worse))


def paired_z_of_each(better: Array, worse: Array) -> Array:
    """(…), `paired_z` of each of some squared errors (…, N) against the same other ones (N,)."""
    most = squared_outlier_distance(better)[..., None]
    return _vuong_z_of_each(np.minimum(worse, most) - np.minimum(better, most))


def squared_outlier_distance(squared: Array) -> Array:
    """(…), square of `OUTLIER_DISTANCE` robust standard deviations per axis, of squared 3-D distances (…, N)."""
    return np.square(OUTLIER_DISTANCE / CHI3_MEDIAN * np.median(np.sqrt(squared), axis=-1))


def vuong_z(difference: Array) -> float:
    """z score of a paired difference of squared errors (N,): mean over its standard error (Vuong 1989)."""
    return float(_vuong_z_of_each(difference))


def _vuong_z_of_each(difference: Array) -> Array:
    spread = difference.std(axis=-1, ddof=1) / np.sqrt(difference.shape[-1])
    return np.where(spread > 0, difference.mean(axis=-1) / np.where(spread > 0, spread, 1.0), 0.0)
