"""Addition of effects to a model: everything is refitted, base parameters that were held among it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.identifiability import (
    MAX_SUBSAMPLE,
    expected_noise,
    fit_identifiable,
    identifiable_beside,
    subsample_rows,
)
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_ident.residual.deployment.deployable import deployable
from lrm_math.effects import Effect, Parameter, ParameterRef, effect_of
from lrm_math.errors import LrmError
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

UNMOVED = 1e-9
"""m: round-off."""
MOMENT = "pose"  # unit of a shape parameter that is a moment in the measured order


def add_effects(
    model: Model,
    data: Measurements,
    effects: Sequence[Effect],
    shape: Sequence[float] | None = None,
    loss: Loss = SQUARED,
) -> Fit:
    """Fits a model with further effects: all its free parameters and the new ones together.

    Shape parameters are fitted together with all others, and then held. Held parameters of `offsets` and `compliance`
    are fitted too.

    Args:
        shape: parameter vector of a single effect, where its shape parameters start; None: at their defaults.

    Raises:
        LrmError: all parameters are fitted already, or no convergence.
    """
    extended, names = model, ", ".join(effect.name for effect in effects)
    for effect in effects:
        extended = _with_effect(extended, effect, shape)
    parameters_of = {key: p for e in effects for key, p in zip(e.keys, e.parameters, strict=True)}
    new = [key for key, parameter in parameters_of.items() if parameter.fixed is None and key not in model.free]
    if not new:
        raise LrmError(f"{names}: in the model already, with all parameters fitted")
    best = _with_shapes(extended, data, effects, new, loss)
    for key, parameter, _ in _searched(effects, data):
        if parameter.unit == MOMENT:
            best = _fit_moment(best, data, key, loss)
    return deployable(best, data)


def _with_shapes(model: Model, data: Measurements, effects: Sequence[Effect], new: Sequence[str], loss: Loss) -> Fit:
    """Fit of the free parameters, the `new` ones and those of the base, at the effects' best shapes.

    Of thousands of poses a subsample decides the shapes; then all poses are fitted.
    """
    part = data if len(data) <= MAX_SUBSAMPLE else data.take(subsample_rows(len(data)))
    keys = _to_fit(model, part, new)
    best = fit_identifiable(model, part, keys, loss).fit
    searched = _searched(effects, part)
    best = _fit_shapes(best, part, {key: tried for key, parameter, tried in searched if parameter.unit != MOMENT}, loss)
    return best if part is data else fit_identifiable(best.model, data, keys, loss, near=best).fit


def _to_fit(model: Model, data: Measurements, new: Sequence[str]) -> list[str]:
    """Keys to fit: the free ones, the `new` ones and those of the base; of free forms the coefficients that the poses
    can tell beside these. Raises `LrmError`: none of the new ones is among them."""
    curves = {key for effect in model.effects if effect.is_free_form for key in effect.keys}
    keys = list(dict.fromkeys([*model.free, *new, *_held_base_parameters(model)]))
    fitted_keys = [key for key in keys if key not in curves or key in model.free]
    coefficients = [key for key in keys if key not in fitted_keys]
    if coefficients:
        settled = solve_equilibrium(model, data.poses)
        noise = expected_noise(settled, keys, data)
        fitted_keys += identifiable_beside(settled, fitted_keys, coefficients, noise, data.whitening)
    if not {*new} & {*fitted_keys}:
        names = ", ".join(dict.fromkeys(map(effect_of, new)))
        raise LrmError(f"{names}: these poses cannot tell it from what the model has already")
    return fitted_keys


def _searched(effects: Sequence[Effect], data: Measurements) -> Iterator[tuple[str, Parameter, tuple[float, ...]]]:
    """Key, parameter and values to try of each of the effects' shape parameters that are searched."""
    for effect in effects:
        tried = effect.shapes_to_try(data.poses)
        for key, parameter in zip(effect.keys, effect.parameters, strict=True):
            if parameter.name in tried:
                yield key, parameter, tried[parameter.name]


def _held_base_parameters(model: Model) -> list[str]:
    """Keys of parameters of `offsets`, `compliance` and partly fitted effects that are not free."""
    begun = {effect_of(key) for key in model.free}
    return [
        key
        for key, parameter in zip(model.keys, model.parameters, strict=True)
        if parameter.fixed is None
        and key not in model.free
        and (ParameterRef.parse(key).id in DEFAULT_EFFECTS or effect_of(key) in begun)
    ]


def _with_effect(model: Model, effect: Effect, shape: Sequence[float] | None) -> Model:
    """The model with an effect at a parameter vector; the same model if it has the effect."""
    values = {key: model.value(key) for key in model.keys}
    if effect.name in {present.name for present in model.effects}:
        return model
    if shape is not None:
        values |= dict(zip(effect.keys, shape, strict=True))
    extended = model_of(model.arm, (*model.effects, effect), values)
    return replace(extended, free=model.free, within=model.within, state=model.state)


def _fit_shapes(best: Fit, data: Measurements, tried: Mapping[str, Sequence[float]], loss: Loss) -> Fit:
    """The fit with shape parameters at their estimates within the range of values `tried`, where they were fitted like
    the others; the same fit where they are not identifiable, or this does not lower the error.

    A shape that moves nothing where it stands, such as a long wait before a short memory, is held.
    """
    if not tried:
        return best
    moved = parameter_jacobian(best.equilibrium, [*tried])
    typical = [best.model.parameter(key).typical for key in tried]
    tried = {
        key: tried[key]
        for key, size in zip(tried, np.abs(moved).max(axis=(0, 1)) * typical, strict=True)
        if size > UNMOVED
    }
    if not tried:
        return best
    free, limits = best.model.free, bounds_of(best.model, best.model.free)
    lower = np.append(limits.lower, [values[0] for values in tried.values()])
    upper = np.append(limits.upper, [values[-1] for values in tried.values()])
    both = best.model.with_free((*free, *tried))
    try:
        refitted = fit(both, data, Bounds(lower, upper), loss, typical_prior(both), best.equilibrium)
        held = fit(refitted.model.with_free(free), data, loss=loss, prior=best.stated, near=refitted.equilibrium)
    except LrmError:
        return best
    return min(best, held, key=lambda candidate: error_stats(candidate.residual).rms)


def _fit_moment(best: Fit, data: Measurements, key: str, loss: Loss) -> Fit:
    """The fit with the maximum-likelihood change point (Hinkley 1970), the last pose before a change: the moment and
    the other parameters are estimated in turn until neither moves; the error falls each time, so that it ends."""
    numbers, row = np.unique(data.poses.names(np.arange(len(data))), return_inverse=True)
    while True:
        ends = (best.model.with_values_of([key], end) for end in (numbers[-1], numbers[0] - 1))
        squares = [
            best.weight * (data.residual(solve_equilibrium(model, data.poses)) ** 2).sum(axis=1) for model in ends
        ]
        added = np.cumsum(np.bincount(row.reshape(-1), squares[0] - squares[1]))
        moment = float(numbers[np.argmin(added)])
        if moment == best.model.value(key):
            return best
        refitted = fit(best.model.with_values_of([key], moment), data, loss=loss, prior=best.stated)
        if error_stats(refitted.residual).rms >= error_stats(best.residual).rms:
            return best
        best = refitted
