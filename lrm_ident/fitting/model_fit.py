"""Fit of a model with chosen effects, parameters and bounds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.degenerate_fit import CHECK
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.data.weights.model_error import with_model_error
from lrm_ident.data.wording import enumerate_words
from lrm_ident.fitting.identifiability import FEW_OUTLIERS, IdentifiedFit, fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import Loss
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of, default_keys, fittable, no_bounds, select_parameters
from lrm_ident.fitting.priors import Prior, of_the_set_up
from lrm_math.arm.arm import Arm
from lrm_math.effects import CATALOGUE, Effect, effects_at
from lrm_math.effects.reference import ParameterRef
from lrm_math.effects.tracker_errors import TouchedBoard, TouchedPoint
from lrm_math.errors import LrmError
from lrm_math.model.model import Model, model_of

TOLD_NOTHING = 0.05
"""Share of a prior's variance below which data that remove no more from any parameter say nothing of the arm."""
MODEL_ERROR_GROWTH = 1.1  # of the estimated model error, from which the fit is repeated with it
LISTED = 8  # poses in a message
DEFAULT_EFFECTS = ("offsets", "compliance")


def nominal_model(
    arm: Arm, effects: Sequence[str] = DEFAULT_EFFECTS, catalogue: Iterable[type[Effect]] = CATALOGUE
) -> Model:
    """The arm with these effects (`id` or `id@place`), all parameters zero. Raises `UnknownName`."""
    return model_of(arm, [effect for name in effects for effect in effects_at(arm, name, tuple(catalogue))])


def fit_model(
    model: Model,
    data: Measurements,
    parameters: str,
    loss: Loss,
    unbounded: bool = False,
    prior: Prior | None = None,
) -> IdentifiedFit:
    """Fits the named parameters of a model to measurements, weighed by their noise and the error of the model itself.

    Args:
        parameters: 'identifiable', 'option1' to 'option5' of the thesis, or names and patterns by commas.
            'identifiable' means all, and what else a stated prior names: the prior determines what the data do not.
        prior: None: of typical sizes for all parameters, none for named ones.
        unbounded: whether values are allowed that physics forbids, such as negative compliances.

    Raises `LrmError`: unknown parameters, too few poses, no convergence, or nothing that these poses can tell.
    """
    result = _fit_named(with_set_up(model, data), data, parameters, loss, unbounded, prior)
    weighed = with_model_error(data, result.fit.equilibrium, result.fit.effective_parameters)
    if weighed.positions.model_sd > MODEL_ERROR_GROWTH * data.positions.model_sd:
        return fit_model(model, weighed, parameters, loss, unbounded, prior)
    off_bounds = np.array([key not in result.fit.at_bound for key in result.fit.model.free], dtype=np.bool_)
    told = result.fit.told[off_bounds & np.isfinite(result.fit.told)]
    if len(told) and told.max() < TOLD_NOTHING:
        raise LrmError(f"nothing can be fitted: no parameter helps, and {_left(result.fit, data)}")
    return result


def _left(fitted: Fit, data: Measurements) -> str:
    """Residual of a fit without parameters, in words, and its outliers, if these are few."""
    stats, far = error_stats(fitted.residual), data.pose[list(fitted.outliers)].tolist()
    words = f"{stats.rms * 1e3:.1f} mm RMS are left"
    if not 0 < len(far) < FEW_OUTLIERS * len(data):
        return f"{words}; {CHECK}"
    which = f"{stats.max * 1e3:.0f} mm at most, of pose: {enumerate_words([str(pose) for pose in far], LISTED)}"
    return f"{words}, {which}; try --leave-out {','.join(map(str, far))}, or --loss cauchy"


def _set_up(key: str) -> bool:
    """Whether a parameter says how was measured, or where touched points stood."""
    return of_the_set_up(key) or ParameterRef.parse(key).id in (TouchedPoint.id, TouchedBoard.id)


def _fit_named(
    model: Model, data: Measurements, parameters: str, loss: Loss, unbounded: bool, prior: Prior | None
) -> IdentifiedFit:
    """Fit of the parameters that a choice names; arguments as of `fit_model`."""
    if parameters != "identifiable":
        named = select_parameters(model, parameters)
        keys = (*named, *(key for key in model.free if _set_up(key) and key not in named))
    elif prior is None:
        keys = default_keys(model, data)
        return fit_identifiable(model, data, keys, loss, no_bounds(keys) if unbounded else None)
    else:
        fitted_or_stated = {*fittable(model), *prior.keys}
        keys = tuple(key for key in model.keys if key in fitted_or_stated)
    free = replace(model, free=keys)
    return IdentifiedFit(fit(free, data, fit_bounds(free, unbounded), loss, prior), data)


def fit_bounds(model: Model, unbounded: bool) -> Bounds:
    """Bounds of the free parameters: the physical ones, or none."""
    return no_bounds(model.free) if unbounded else bounds_of(model, model.free)
