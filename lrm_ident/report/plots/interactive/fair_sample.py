"""Fair sample of the drawn poses: a stratum that was drawn in full is thinned to the rate of the rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_ident.residual.picture.error_field import MOST_DRAWN, SEED, WORST_DRAWN
from lrm_math.arrays import Array


def fair_rows(residual: Array, poses: int) -> NDArray[np.int64] | None:
    """Rows of the drawn poses that show errors as often as they occur; None where every pose is drawn.

    The drawn poses are the worst, all of them, and a random part of the others. Of the worst as large a part is kept,
    evenly from the largest error to the least of them, from a random start (Cochran 1977, Sampling Techniques, ch. 5
    and 8).

    Args:
        residual: (M, 3), of the drawn poses. poses: how many there are in all.
    """
    if len(residual) >= poses:
        return None
    order = np.argsort(-np.linalg.norm(residual, axis=1), kind="stable")
    rate = (MOST_DRAWN - WORST_DRAWN) / (poses - WORST_DRAWN)
    start = np.random.default_rng(SEED).random()
    kept = np.unique(np.floor(np.arange(start, WORST_DRAWN * rate) / rate).astype(np.int64))
    return np.sort(np.concatenate([order[kept], order[WORST_DRAWN:]]))
