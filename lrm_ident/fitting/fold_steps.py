"""Fits that leave a block of poses out, from the fit to all poses: one Gauss–Newton step (as Cook 1977 for one row).

The step is exact for a linear model. With thousands of poses a block moves the parameters by a fraction of their
standard errors, so what the step neglects is far below the noise; the Jacobian is computed once instead of per fold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.block_qr import CompressedRows
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.objective import Objective
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of
from lrm_ident.fitting.priors import Prior
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model


def models_without(
    model: Model,
    data: Measurements,
    blocks: Sequence[NDArray[np.int64]],
    bounds: Bounds | None = None,
    loss: Loss = SQUARED,
    prior: Prior | None = None,
) -> Iterator[Model]:
    """Models for each block (rows of `data`), as a fit to the other blocks leaves it. Raises as `fit`."""
    fitted = fit(model, data, bounds, loss, prior)
    limits = bounds or bounds_of(model, model.free)
    objective = Objective(fitted.model, data, loss, fitted.prior)
    typical = objective.typical
    iterate = objective.at(fitted.model.values[objective.columns] / typical, fitted.rest)
    free = np.array([key not in fitted.at_bound for key in model.free])
    noise = objective.noise_scale(iterate, None, free)
    parts = objective.linearise_each(iterate, noise, blocks)
    for left_out in range(len(blocks)):
        others = [part for number, part in enumerate(parts) if number != left_out]
        rows = CompressedRows(
            np.concatenate([part.columns for part in others]), np.concatenate([part.residual for part in others])
        )
        A = objective.gauss_newton(rows.columns, noise)[np.ix_(free, free)]
        descent = objective.negative_gradient(iterate, rows, noise)
        z = iterate.z.copy()
        z[free] += np.linalg.lstsq(A, descent[free], rcond=None)[0]
        values = fitted.model.values.copy()
        values[objective.columns] = np.clip(z * typical, limits.lower, limits.upper)
        stepped = fitted.model.with_values(values)
        if _settles(stepped, data.poses, fitted.rest):
            yield stepped
        else:  # too far for the effects' formulas: the fit shortens its steps
            kept = np.setdiff1d(np.arange(len(data)), blocks[left_out])
            yield fit(fitted.model, data.take(kept), bounds, loss, prior).model


def _settles(model: Model, poses: Poses, near: Equilibrium) -> bool:
    try:
        equilibrium(model, poses, near)
    except NoEquilibrium:
        return False
    return True
