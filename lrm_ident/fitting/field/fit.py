"""Residual field on a fitted model: regression on the model's residual, and its cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.held_out import HeldOutBlock
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model


def fit_with_field(fitted: Fit, data: Measurements) -> Fit:
    """The fit with a residual field added; the other parameters stay as they are. Raises `LrmError` (positions)."""
    from scipy.linalg import block_diag  # takes a quarter of a second to load

    from lrm_ident.fitting.field.regression import field_posterior

    model, field = fitted.model, ResidualField(fitted.model.arm, "tool")
    check_positions(data)
    residual = data.position_error(fitted.equilibrium)
    posterior = field_posterior(field.over(model.within), data.poses, residual, fitted.weight)
    free = (*model.free, *(field.keys[row] for row in posterior.kept))
    values = np.concatenate([model.values, posterior.values])
    extended = Model(model.arm, (*model.effects, field), values, free, model.within, model.fitted_to, model.state)
    equilibrium = solve_equilibrium(extended, data.poses, tuple(fitted.equilibrium.slots))
    error, parameters = data.position_error(equilibrium), fitted.effective_parameters + posterior.determined
    square = float((fitted.weight * (error**2).sum(axis=1)).sum())
    return replace(
        fitted,
        model=extended,
        equilibrium=equilibrium,
        residual=error,
        covariance=block_diag(fitted.covariance, posterior.covariance),
        effective_parameters=parameters,
        sigma=float(np.sqrt(square / max(error.size - parameters, 1.0))),
    )


def blocks_with_field(
    field: ResidualField, data: Measurements, blocks: Sequence[HeldOutBlock]
) -> tuple[HeldOutBlock, ...]:
    """Blocks of a cross-validation with a field that is learned anew, hyperparameters and all, without each block."""
    check_positions(data)
    return tuple(_with_field(field, data.poses, block) for block in blocks)


def check_positions(data: Measurements) -> None:
    """Raises `LrmError` for poses without a measured position: a field is learned from positions alone."""
    if len(data.positions.rows) < len(data):
        count = len(data) - len(data.positions.rows)
        raise LrmError(f"{count} poses have no measured position; a residual field needs the position of every pose")


def _with_field(field: ResidualField, poses: Poses, block: HeldOutBlock) -> HeldOutBlock:
    """A block with the field that is learned from its training residual."""
    from lrm_ident.fitting.field.regression import field_posterior

    train_poses, unseen, train_error = poses.take(block.train), poses.take(block.test), block.train_residual
    field_here = field.over(range_of(train_poses))
    values = field_posterior(field_here, train_poses, train_error).values.tolist()
    apart = block.deployed_residual, block.time_unknown_residual
    deployed, unknown = (
        None if apart_residual is None else _less_field(apart_residual, field_here, unseen, values)
        for apart_residual in apart
    )
    return replace(
        block,
        deployed_residual=deployed,
        time_unknown_residual=unknown,
        train_residual=_less_field(train_error, field_here, train_poses, values),
        test_residual=_less_field(block.test_residual, field_here, unseen, values),
        weighted=None,
    )


def _less_field(residual: Array, field: ResidualField, poses: Poses, values: Sequence[float]) -> Array:
    """(N, 3), a residual less the field (m)."""
    amounts = field.amounts(poses, (), values)
    return np.asarray(residual - np.stack([np.broadcast_to(amount, len(poses)) for amount in amounts], axis=1))


def range_of(poses: Poses) -> MeasuredRange:
    """Range of some poses' commands and payloads."""
    lower, upper = poses.q.min(axis=0), poses.q.max(axis=0)
    payload = float(poses.payload.min()), float(poses.payload.max())
    return MeasuredRange(tuple(zip(lower.tolist(), upper.tolist(), strict=True)), payload)
