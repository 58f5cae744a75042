"""Nested cross-validation (Stone 1974): held-out error of `auto` itself, effects selected anew in every fold."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.cross_validation import joint_space_folds
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.executors import in_order
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model


def nested_held_out(
    model: Model,
    data: Measurements,
    executor: Executor,
    max_effects: int = MAX_EFFECTS,
    catalogue: Catalogue = CATALOGUE,
    progress: OnProgress = silent,
    loss: Loss = SQUARED,
    rates: EffectRates | None = None,
) -> NestedResidual:
    """Held-out residual where each joint-space fold is predicted by an `auto` on the other folds.

    If a fold does not converge, or has no equilibrium at a held-out pose, there is only the reason.

    Args:
        executor: on which the folds run in parallel (`executor_for`).
    """
    fold = joint_space_folds(data.poses.q, data.repeat_of)
    parts = [fold == number for number in range(int(fold.max()) + 1)]
    predict = partial(_predict, model, data, max_effects, catalogue, loss, rates)
    residual, chosen = np.empty_like(data.tcp), []
    try:
        for out, (left, names) in zip(parts, in_order(executor, predict, parts, progress), strict=True):
            residual[out] = left
            chosen.append(names)
    except LrmError as error:
        return NestedResidual(None, str(error))
    return NestedResidual(residual, chosen=tuple(chosen))


def _predict(
    model: Model,
    data: Measurements,
    max_effects: int,
    catalogue: Catalogue,
    loss: Loss,
    rates: EffectRates | None,
    out: NDArray[np.bool_],
) -> tuple[Array, tuple[str, ...]]:
    """(n, 3), residual at the poses `out` (m), which neither selection nor fit saw; and the effects chosen."""
    run = run_auto(model, data.take(~out), max_effects, catalogue, loss=loss, rates=rates)
    left = data.take(out).position_error(solve_equilibrium(run.model, data.poses.take(out)))
    return left, tuple(step.added for step in run.steps[1:])
