"""Predictable part of a fitted model's residual: how much of it can be predicted without names, and where it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.held_out import HeldOutBlock
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.predictability import PredictableError, predictable_error
from lrm_ident.residual.regime import Regime, find_regimes, studentised_squares
from lrm_math.model.derivatives import parameter_jacobian


@dataclass(frozen=True, eq=False)
class PredictableResidual:
    """Share that a nameless model predicts of the held-out residual, and the regimes where the residual is largest."""

    predictable: PredictableError
    regimes: tuple[Regime, ...]


def predictable_residual(
    fitted: Fit, data: Measurements, blocks: Sequence[HeldOutBlock], known: PredictableError | None = None
) -> PredictableResidual:
    """Tries a Gaussian process on what a cross-validated fit leaves, and looks for regimes. `known`: of the former."""
    keys = [key for key in fitted.model.free if key not in fitted.at_bound]
    columns = parameter_jacobian(fitted.rest, keys).reshape(-1, len(keys))
    predictable = known or predictable_error(data, blocks)
    return PredictableResidual(predictable, find_regimes(data, studentised_squares(fitted.residual, columns)))
