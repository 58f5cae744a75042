"""Since when a model's error is larger than before: what came loose while measuring stays loose.

Cumulative sums of squared errors (Inclán & Tiao 1994), over their long-run standard deviation (Bartlett's kernel:
Sansó, Aragó & Carrion 2004), since errors are not Gaussian and poses are measured several times one after the other.
Without a change the largest one is that of a Brownian bridge (Kolmogorov's distribution).
"""

from __future__ import annotations

import numpy as np

from lrm_ident.residual.data_audit import joints_of_order
from lrm_ident.residual.deployment.carried_states import FEWEST
from lrm_ident.residual.thresholds import SIGNIFICANCE
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses


def row_since_error_grew(poses: Poses, squares: Array) -> int:
    """The first row of the later poses whose squared errors (N,) are significantly larger than those before; 0 where
    there are none, fewer than `FEWEST`, or the order of the poses is not known or follows a joint."""
    from scipy.special import kolmogorov  # here: the words of a fit name this error, and load no scipy

    count = len(squares)
    if count < 2 * FEWEST or poses.number is None or joints_of_order(poses.q):
        return 0
    error = squares - squares.mean()
    lags = int(4.0 * (count / 100.0) ** (2.0 / 9.0))
    weighted = ((1.0 - lag / (lags + 1.0)) * float(error[lag:] @ error[:-lag]) for lag in range(1, lags + 1))
    variance = float(error @ error) + 2.0 * sum(weighted)
    smaller_before = -np.cumsum(error)
    row = int(np.argmax(smaller_before)) + 1
    grew = variance > 0.0 and kolmogorov(smaller_before[row - 1] / np.sqrt(variance)) < SIGNIFICANCE
    return row if grew and row <= count - FEWEST else 0
