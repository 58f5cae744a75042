"""Uncertainty of the predicted TCP position, from uncertain parameters and joints; where a residual field is sure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import BEYOND
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.reversion import Reversion
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.covariance import Covariance
from lrm_math.model.deployed_model import field_of
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.unseen_angles import beyond_range

UNSURE = 0.5
"""Part of its variance beyond the data from which on a residual field is not said to speak."""
POSES_ASKED = 2000
POSES_EXPECTED = 200


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
    """Standard deviation at the first pose: see `prediction_covariance`.

    None, too, where the arm does not settle without a candidate law: what this law leaves open is not known there.
    """
    try:
        every = prediction_covariance(settled, covariance, joint_sd)
    except NoEquilibrium:
        return None
    return None if every is None else PositionUncertainty(every[0], math.sqrt(float(np.trace(every[0]))))


def prediction_covariance(
    settled: Equilibrium, covariance: Covariance | None, joint_sd: Sequence[float] | None = None
) -> Array | None:
    """(N, 3, 3), m²: `position_covariance` and `open_covariance` together; None if no cause is known."""
    every = position_covariance(settled, covariance, joint_sd)
    return None if every is None else every + open_covariance(settled)


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


def open_covariance(settled: Equilibrium) -> Array:
    """(N, 3, 3), m², of what the measured angles leave open (`UnmeasuredAngles`), of candidate laws beyond them
    (`beyond_range`), and of empirical terms that no longer hold (`Reversion`); zero where that is not known."""
    within, out = settled.model.within, np.zeros((len(settled.poses), 3, 3))
    if within is not None and within.unmeasured is not None:
        J = joint_jacobian(settled) * within.unmeasured.spread(settled.poses.q)[:, None, :]
        out += J @ J.transpose(0, 2, 1)
    for apart in beyond_range(settled):
        out += apart[:, :, None] * apart[:, None, :]
    if within is not None and within.reversion is not None:
        out += _reverted_covariance(settled, within, within.reversion)
    return out


def _reverted_covariance(settled: Equilibrium, within: MeasuredRange, reversion: Reversion) -> Array:
    """(N, 3, 3), m²: variance of a Gaussian process that is known with the terms, and is without them far away."""
    share_left = np.broadcast_to(np.asarray(reversion.share(settled.poses)), len(settled.poses))
    rows, out = np.flatnonzero(share_left < 1.0), np.zeros((len(share_left), 3, 3))
    if len(rows):
        there, poses = replace(settled.model, within=replace(within, reversion=None)), settled.poses.take(rows)
        away = there.with_values_of(
            [*reversion.changes], [there.value(key) + change for key, change in reversion.changes.items()]
        )
        apart = solve_equilibrium(there, poses).true_tcp - solve_equilibrium(away, poses).true_tcp
        out[rows] = (1.0 - share_left[rows] ** 2)[:, None, None] * apart[:, :, None] * apart[:, None, :]
    return out


def expected_tip_error(model: Model, covariance: Covariance) -> float:
    """RMS distance (m) of the TCP from where it is predicted, over the arm's range, as far as the parameters go.

    Linear, at angles drawn evenly within the joint limits, and within the range of the fit where that is known.
    """
    lower, upper = (np.array([getattr(joint, end) for joint in model.arm.joints]) for end in ("lower", "upper"))
    if model.within is not None:
        measured = np.array(model.within.angle).T
        lower, upper = np.clip(measured[0], lower, upper), np.clip(measured[1], lower, upper)
    q = np.random.default_rng(0).uniform(lower, upper, (POSES_EXPECTED, model.arm.dof))
    spread = position_covariance(solve_equilibrium(model, poses_of(q)), covariance)
    return 0.0 if spread is None else math.sqrt(float(np.einsum("nii->n", spread).mean()))


@dataclass(frozen=True)
class FieldCoverage:
    """Coverage of the poses within an arm's joint limits by a residual field.

    `effect`: its name. `speaks`: share where the data determine it; None if its covariance is not known. `outside`:
    share with a joint outside the range of the fit, where it fades to zero.
    """

    effect: str
    speaks: float | None
    outside: float


def field_coverage(model: Model, covariance: Covariance | None) -> FieldCoverage | None:
    """Coverage by a model's residual field, of poses drawn evenly within the limits; None without a field."""
    field = field_of(model)
    if field is None:
        return None
    lower, upper = (np.array([getattr(joint, end) for joint in model.arm.joints]) for end in ("lower", "upper"))
    q = np.random.default_rng(0).uniform(lower, upper, (POSES_ASKED, model.arm.dof))
    speaks = field_speaks(model, covariance, q)
    outside = 0.0 if model.within is None else float(model.within.outside(q).any(axis=1).mean())
    return FieldCoverage(field.name, None if speaks is None else float(speaks.mean()), outside)


def field_speaks(model: Model, covariance: Covariance | None, q: Array) -> NDArray[np.bool_] | None:
    """(N,), at which commands q (N, n) (rad) the data determine a model's residual field.

    Its predictive variance, over the axes, is less than `UNSURE` of what it is where nothing was measured. None without
    a field or its covariance.
    """
    field = field_of(model)
    if field is None or covariance is None or not set(field.keys).intersection(covariance.keys):
        return None
    rows_of_field, poses, position = field.over(model.within), poses_of(q), {key: k for k, key in enumerate(field.keys)}
    rows = [row for row, key in enumerate(covariance.keys) if key in position]
    covariance_of_field = covariance.matrix[np.ix_(rows, rows)]
    columns = [position[covariance.keys[row]] for row in rows]
    basis, beyond = rows_of_field.basis(poses, ()), np.array([field.parameters[k].name in BEYOND for k in columns])
    F = np.array([[np.broadcast_to(amount, len(q)) for amount in basis[k]] for k in columns])
    variance = np.einsum("ian,ij,jan->n", F, covariance_of_field, F)
    return np.asarray(variance < UNSURE * float(np.diag(covariance_of_field)[beyond].sum()))
