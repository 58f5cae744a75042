"""Adding an effect: everything is refitted from the present values; and following the tool's own advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from lrm_ident.data.error_stats import figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.score_test import Scored
from lrm_ident.fit.identifiability import fit_identifiable
from lrm_ident.fit.levenberg_marquardt import Fit, NotConverged, fit
from lrm_math.effects import CATALOGUE, Effect
from lrm_math.errors import LrmError, NotSettled
from lrm_math.model.model import Model, model_of

MOST_SHAPE_FITS = 12


def add_effects(
    model: Model, data: Measurements, effects: Sequence[Effect], shape: Sequence[float] | None = None
) -> Fit:
    """The model with further effects, all its free parameters and the new ones fitted together.

    Shape parameters are searched for the values that fit best, around `shape` (the parameter vector of a single effect)
    or their defaults, and then held.

    Raises:
        LrmError: all parameters are fitted already, the data cannot tell any new one, or no convergence.
    """
    wide, names = model, ", ".join(f"{effect.id}@{effect.place}" for effect in effects)
    for effect in effects:
        wide = _with_effect(wide, effect, shape)
    own = {f"{e.id}.{e.place}.{p.name}": p for e in effects for p in e.parameters}
    new = [key for key, parameter in own.items() if parameter.fixed is None and key not in model.free]
    if not new:
        raise LrmError(f"{names}: in the model already, with all parameters fitted")
    keys = [*model.free, *new]
    best = _fit_at(wide, data, keys)
    if not set(new) & set(best.model.free):
        raise LrmError(f"{names}: these poses cannot tell it from what the model has already")
    for key, parameter in own.items():
        if parameter.scan and parameter.fixed is not None:
            best = _tune(best, data, key, parameter.scan)
    return best


def _with_effect(model: Model, effect: Effect, shape: Sequence[float] | None) -> Model:
    known = {key: model.value(key) for key in model.keys}
    if (effect.id, effect.place) in {(e.id, e.place) for e in model.effects}:
        return model
    if shape is not None:
        prefix = f"{effect.id}.{effect.place}."
        known |= {prefix + p.name: value for p, value in zip(effect.parameters, shape, strict=True)}
    return replace(model_of(model.arm, (*model.effects, effect), known), free=model.free)


def _fit_at(model: Model, data: Measurements, keys: Sequence[str]) -> Fit:
    return fit_identifiable(model, data, keys).fit


def _tune(best: Fit, data: Measurements, key: str, scan: Sequence[float]) -> Fit:
    """The best fit over a shape parameter, on a logarithmic scale around its present value."""
    found = [best]

    def loss(log_value: float) -> float:
        """RMS of the fit with the shape held at this value (m)."""
        model = found[0].model
        values = model.values.copy()
        values[model.position(key)] = np.exp(log_value)
        try:
            tried = fit(model.with_values(values), data)
        except (NotSettled, NotConverged):
            return np.inf
        if figures(tried.residual).rms < figures(found[0].residual).rms:
            found[0] = tried
        return figures(tried.residual).rms

    present = np.log(best.model.value(key))
    step = np.log(max(np.array(scan[1:]) / np.array(scan[:-1])))
    bracket = (max(present - step, np.log(scan[0])), min(present + step, np.log(scan[-1])))
    minimize_scalar(loss, bounds=bracket, method="bounded", options={"maxiter": MOST_SHAPE_FITS, "xatol": 0.03})
    return found[0]


@dataclass(frozen=True, eq=False)
class Step:
    """One step of `auto`: what was added ("" at the start), the fit after it, and what could not be told from it."""

    added: str
    fit: Fit
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Course:
    """The whole of `auto`: its steps, and the diagnosis that ended it."""

    steps: tuple[Step, ...]
    last: Diagnosis

    @property
    def model(self) -> Model:
        """The model at its end."""
        return self.steps[-1].fit.model


def follow_advice(
    model: Model,
    data: Measurements,
    most: int = 20,
    catalogue: Iterable[type[Effect]] = CATALOGUE,
    told: Callable[[Step, Diagnosis], None] | None = None,
) -> Course:
    """Adds the first supported effect, diagnoses again, and so on until nothing is supported or `most` were added."""
    kinds = tuple(catalogue)
    diagnosis = diagnose(model, data, kinds)
    steps = [Step("", diagnosis.fit)]
    if told:
        told(steps[0], diagnosis)
    refused: set[str] = set()
    while diagnosis.verdict == "effect_missing" and len(steps) <= most:
        chosen = next((one for one in diagnosis.supported if one.name not in refused), None)
        if chosen is None:
            break
        try:
            better = add_effects(diagnosis.fit.model, data, [chosen.candidate.effect], shape_of(chosen))
            after = diagnose(better.model, data, kinds)
        except LrmError:
            refused.add(chosen.name)
            continue
        if after.before.mean() >= diagnosis.before.mean():
            refused.add(chosen.name)
            continue
        steps.append(Step(chosen.name, better, diagnosis.rivals[chosen.name]))
        diagnosis = after
        if told:
            told(steps[-1], diagnosis)
    return Course(tuple(steps), diagnosis)


def shape_of(scored: Scored) -> tuple[float, ...]:
    """The parameter vector at which a candidate explains most, other parameters zero."""
    return scored.candidate.shapes[scored.shape]
