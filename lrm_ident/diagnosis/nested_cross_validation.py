"""Nested cross-validation (Stone 1974): held-out error of `auto` itself, effects selected anew in every fold."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.cross_validation import held_out_folds
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.executors import in_order
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import as_deployed_when_read
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
    left_out: Sequence[int] = (),
) -> NestedResidual:
    """Held-out residual where each joint-space fold is predicted by an `auto` on the other folds.

    If a fold does not converge, or has no equilibrium at a held-out pose, there is only the reason.

    Args:
        executor: on which the folds run in parallel (`executor_for`).
        left_out: numbers of the poses that `auto` on all of them left out as outliers. Its errors are without them, so
            the nested one is, too; they are in the folds, as in the data that a user has.
    """
    fold = held_out_folds(data)
    parts = [fold == number for number in range(int(fold.max()) + 1)]
    predict = partial(_predict, model, data, max_effects, catalogue, loss, rates)
    residual, deployed, chosen, last = np.empty_like(data.tcp), np.empty_like(data.tcp), [], np.arange(len(data))
    try:
        for out, predicted in zip(parts, in_order(executor, predict, parts, progress), strict=True):
            residual[out], deployed[out] = predicted.residual, predicted.deployed
            chosen.append(predicted.chosen)
            last = np.intersect1d(last, rows_as_deployed(predicted.model, data.poses))
    except LrmError as error:
        return NestedResidual(None, str(error))
    judged = ~np.isin(data.pose, left_out)
    on_arm = DeployedError.of_residual(deployed[judged], np.flatnonzero(np.isin(np.flatnonzero(judged), last)))
    return NestedResidual(residual[judged], deployed=on_arm, chosen=tuple(chosen))


@dataclass(frozen=True, eq=False)
class _Fold:
    """A fold's model, and its residuals (n, 3) at the poses that neither selection nor fit saw (m)."""

    model: Model
    residual: Array
    deployed: Array
    chosen: tuple[str, ...]


def _predict(
    model: Model,
    data: Measurements,
    max_effects: int,
    catalogue: Catalogue,
    loss: Loss,
    rates: EffectRates | None,
    out: NDArray[np.bool_],
) -> _Fold:
    """The fold of an `auto` that does not see the poses `out`."""
    run, unseen = run_auto(model, data.take(~out), max_effects, catalogue, loss=loss, rates=rates), data.take(out)
    deployed = as_deployed_when_read(run.model, unseen.poses)
    errors = [unseen.position_error(solve_equilibrium(m, unseen.poses)) for m in (run.model, deployed)]
    return _Fold(run.model, errors[0], errors[1], tuple(step.added for step in run.steps[1:]))
