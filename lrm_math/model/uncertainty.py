"""Uncertainty of the predicted TCP position, from uncertain parameters and joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.covariance import Covariance
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class PositionUncertainty:
    """Uncertainty of a position.

    `covariance`: (3, 3), m². `sd`: m, root of its trace: the RMS distance.
    """

    covariance: Array
    sd: float


def position_uncertainty(
    settled: Equilibrium, covariance: Covariance | None, joint_sd: Sequence[float] | None = None
) -> PositionUncertainty | None:
    """Standard deviation at the first pose; see `position_covariance`."""
    every = position_covariance(settled, covariance, joint_sd)
    return None if every is None else PositionUncertainty(every[0], math.sqrt(float(np.trace(every[0]))))


def position_covariance(
    settled: Equilibrium, covariance: Covariance | None, joint_sd: Sequence[float] | None = None
) -> Array | None:
    """(N, 3, 3), m²: J C Jᵀ with the total derivatives through the equilibrium; None if neither cause is known.

    `covariance`: of parameters of the model. `joint_sd`: (n,), rad, repeatability of each servo, independent.
    """
    parts = []
    if covariance is not None:
        J = parameter_jacobian(settled, covariance.keys)
        parts.append(J @ covariance.matrix @ J.transpose(0, 2, 1))
    if joint_sd is not None:
        J = joint_jacobian(settled) * np.asarray(joint_sd, dtype=np.float64)
        parts.append(J @ J.transpose(0, 2, 1))
    return np.asarray(sum(parts)) if parts else None
