"""Estimates of a fit as a table: value, standard error, and how much of it the data determined."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lrm_ident.fitting.levenberg_marquardt import Fit


@dataclass(frozen=True)
class ParameterEstimate:
    """Estimate of a parameter, in the unit that its key ends in.

    Attributes:
        standard_error: None at a bound. from_data: share (0 to 1) of its prior variance that the poses removed; None
            of a fit without a prior.
    """

    value: float
    standard_error: float | None
    unit: str
    from_data: float | None


def parameter_estimates(fit: Fit) -> dict[str, ParameterEstimate]:
    """Estimates of the free parameters by key."""
    estimates = {}
    for key, error, told in zip(fit.model.free, fit.standard_error.tolist(), fit.told.tolist(), strict=True):
        parameter, bound = fit.model.parameter(key), key in fit.at_bound
        share = None if bound or math.isnan(told) else max(0.0, told)
        error = None if bound else error / parameter.si
        estimates[key] = ParameterEstimate(fit.model.value(key) / parameter.si, error, parameter.unit, share)
    return estimates
