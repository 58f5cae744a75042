"""Predictable part of a fitted model's residual: how much of it can be predicted without names, and where it is."""

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
class PredictableResidual:
    """Share that a nameless model predicts of the held-out residual, and the regimes where the residual is largest.

    `pose`: (M,), numbers of the poses that the regimes part.
    """

    predictable: PredictableError
    regimes: tuple[Regime, ...]
    pose: NDArray[np.int64]


def predictable_residual(
    fitted: Fit,
    data: Measurements,
    blocks: Sequence[HeldOutBlock],
    outlier_distances: Mapping[int, float],
    known: PredictableError | None = None,
) -> PredictableResidual:
    """Tries a Gaussian process on what a cross-validated fit leaves, and looks for regimes.

    Args:
        outlier_distances: distance (m) of each pose that was left out of the data from where the model has it, by its
            number. Outliers that lie together are a regime.
        known: of the Gaussian process.
    """
    keys = [key for key in fitted.model.free if key not in fitted.at_bound]
    columns = parameter_jacobian(fitted.equilibrium, keys).reshape(-1, len(keys))
    predictable = known or predictable_error(data, blocks)
    squares = dict(zip(data.pose.tolist(), studentised_squares(fitted.residual, columns).tolist(), strict=True))
    squares |= {number: distance**2 for number, distance in outlier_distances.items()}
    together = data.complete.take(np.isin(data.complete.pose, [*squares]))
    squared = np.array([squares[number] for number in together.pose.tolist()])
    clusters = outlier_regimes(together, squared, ~np.isin(together.pose, data.pose))
    others = [one for one in find_regimes(together, squared) if one.name not in {same.name for same in clusters}]
    return PredictableResidual(predictable, (*clusters, *others), together.pose)
