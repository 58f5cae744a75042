"""Patterns of a fitted model's residual that have no name: what a Gaussian process predicts of it, and its regimes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.held_out import HeldOutBlock
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.predictability import PredictableError, predictable_error
from lrm_ident.residual.regime import Regime, find_regimes, outlier_regimes, studentised_squares
from lrm_math.model.derivatives import parameter_jacobian


@dataclass(frozen=True, eq=False)
class ResidualPatterns:
    """Part of the held-out residual that a Gaussian process predicts, and regimes where the residual is largest.

    `pose`: (M,), numbers of the poses on which the regimes are defined, outliers among them.
    """

    predictable: PredictableError
    regimes: tuple[Regime, ...]
    pose: NDArray[np.int64]


def residual_patterns(
    fitted: Fit,
    data: Measurements,
    blocks: Sequence[HeldOutBlock],
    outlier_distances: Mapping[int, float],
    prediction: PredictableError | None = None,
) -> ResidualPatterns:
    """Tries a Gaussian process on the residual of a cross-validated fit, and looks for regimes.

    Args:
        outlier_distances: distance (m) between measured and predicted TCP of each pose that was left out of the data,
            by number. Outliers that lie together are a regime.
        prediction: result of the Gaussian process, where it is known already.
    """
    keys = [key for key in fitted.model.free if key not in fitted.at_bound]
    columns = parameter_jacobian(fitted.equilibrium, keys).reshape(fitted.residual.size, len(keys))
    predictable = prediction or predictable_error(data, blocks)
    squares = dict(zip(data.pose.tolist(), studentised_squares(fitted.residual, columns).tolist(), strict=True))
    squares |= {number: distance**2 for number, distance in outlier_distances.items()}
    together = data.complete.take(np.isin(data.complete.pose, [*squares]))
    squared = np.array([squares[number] for number in together.pose.tolist()])
    clusters = outlier_regimes(together, squared, ~np.isin(together.pose, data.pose))
    known_already = {same.quantity.variable for same in clusters}
    others = [regime for regime in find_regimes(together, squared) if regime.quantity.variable not in known_already]
    return ResidualPatterns(predictable, (*clusters, *others), together.pose)
