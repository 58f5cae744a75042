"""Adding effects to a model, everything refitted from the present values; and automatic stepwise selection."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.estimation.identifiability import fit_identifiable
from lrm_ident.estimation.levenberg_marquardt import Fit, FitNotConverged, fit
from lrm_math.effects import CATALOGUE, Effect
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.model.model import Model, model_of

MAX_SHAPE_FITS = 12


def add_effects(
    model: Model, data: Measurements, effects: Sequence[Effect], shape: Sequence[float] | None = None
) -> Fit:
    """Fits a model with further effects: all its free parameters and the new ones together.

    Shape parameters are held at the values that fit best (Brent's bounded search around `shape`, the parameter vector
    of a single effect, or around their defaults).

    Raises:
        LrmError: all parameters are fitted already, no new one is identifiable, or no convergence.
    """
    extended, names = model, ", ".join(f"{effect.id}@{effect.place}" for effect in effects)
    for effect in effects:
        extended = _with_effect(extended, effect, shape)
    own = {f"{e.id}.{e.place}.{p.name}": p for e in effects for p in e.parameters}
    new = [key for key, parameter in own.items() if parameter.fixed is None and key not in model.free]
    if not new:
        raise LrmError(f"{names}: in the model already, with all parameters fitted")
    keys = [*model.free, *new]
    best = fit_identifiable(extended, data, keys).fit
    if not set(new) & set(best.model.free):
        raise LrmError(f"{names}: these poses cannot tell it from what the model has already")
    for key, parameter in own.items():
        if parameter.scan and parameter.fixed is not None:
            best = _fit_shape(best, data, key, parameter.scan)
    return best


def _with_effect(model: Model, effect: Effect, shape: Sequence[float] | None) -> Model:
    known = {key: model.value(key) for key in model.keys}
    if (effect.id, effect.place) in {(e.id, e.place) for e in model.effects}:
        return model
    if shape is not None:
        prefix = f"{effect.id}.{effect.place}."
        known |= {prefix + p.name: value for p, value in zip(effect.parameters, shape, strict=True)}
    return replace(model_of(model.arm, (*model.effects, effect), known), free=model.free)


def _fit_shape(best: Fit, data: Measurements, key: str, scan: Sequence[float]) -> Fit:
    """The best fit over a shape parameter, on a logarithmic scale around its present value."""

    def loss(log_value: float) -> float:
        """RMS of the fit with the shape held at this value (m)."""
        nonlocal best
        values = best.model.values.copy()
        values[best.model.position(key)] = np.exp(log_value)
        try:
            tried = fit(best.model.with_values(values), data)
        except (NoEquilibrium, FitNotConverged):
            return np.inf
        rms = error_stats(tried.residual).rms
        if rms < error_stats(best.residual).rms:
            best = tried
        return rms

    present = np.log(best.model.value(key))
    step = np.log(max(np.array(scan[1:]) / np.array(scan[:-1])))
    bracket = (max(present - step, np.log(scan[0])), min(present + step, np.log(scan[-1])))
    minimize_scalar(loss, bounds=bracket, method="bounded", options={"maxiter": MAX_SHAPE_FITS, "xatol": 0.03})
    return best


@dataclass(frozen=True, eq=False)
class AutoStep:
    """One step of `auto`: the effect added ("" at the start), the fit after it, and the effects equivalent to it."""

    added: str
    fit: Fit
    equivalent: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class AutoRun:
    """A run of `auto`: its steps, and the diagnosis that ended it."""

    steps: tuple[AutoStep, ...]
    diagnosis: Diagnosis

    @property
    def model(self) -> Model:
        """The model after the last step."""
        return self.steps[-1].fit.model


def run_auto(
    model: Model,
    data: Measurements,
    max_effects: int = 20,
    catalogue: Iterable[type[Effect]] = CATALOGUE,
    on_step: Callable[[AutoStep, Diagnosis], object] = lambda *_: None,
) -> AutoRun:
    """Stepwise selection: adds the first supported effect, refits, diagnoses again, until none is supported.

    An effect that does not lower the held-out error, or whose fit fails, is rejected for good.

    Raises:
        LrmError: the first diagnosis fails.
    """
    kinds = tuple(catalogue)
    diagnosis = diagnose(model, data, kinds)
    steps = [AutoStep("", diagnosis.fit)]
    on_step(steps[0], diagnosis)
    rejected: set[str] = set()
    while diagnosis.verdict == "effect_missing" and len(steps) <= max_effects:
        chosen = next((one for one in diagnosis.supported if one.name not in rejected), None)
        if chosen is None:
            break
        try:
            better = add_effects(diagnosis.fit.model, data, [chosen.candidate.effect], chosen.shape)
            after = diagnose(better.model, data, kinds)
        except LrmError:
            after = diagnosis
        if after.squared_held_out.mean() >= diagnosis.squared_held_out.mean():
            rejected.add(chosen.name)
            continue
        steps.append(AutoStep(chosen.name, better, diagnosis.equivalent[chosen.name]))
        diagnosis = after
        on_step(steps[-1], diagnosis)
    return AutoRun(tuple(steps), diagnosis)
