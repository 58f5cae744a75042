"""Claim of an effect: its sentence with the estimates, in the units that people read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lrm_ident.data.wording import in_mm, quantity
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects import Effect, Parameter
from lrm_math.model.equilibrium import solve_equilibrium

DISPLAY_UNITS = {
    "rad": (180.0 / np.pi, "°"),
    "rad_per_rad": (100.0, " %"),
    "rad_per_Nm": (1.0, " rad/Nm"),
    "rad_per_Nm2": (1.0, " rad/Nm²"),
    "rad_per_rad_per_Nm2": (1.0, " /Nm²"),
    "per_turn": (1.0, ""),
    "s_per_s": (1.0, ""),
    "rad_per_Nm3": (1.0, " rad/Nm³"),
    "Nm_per_rad": (1.0, " Nm/rad"),
    "mm_per_m": (1.0, " mm/m"),
    "rad_per_K": (180.0 / np.pi, "°/K"),
    "mm_per_K": (1.0, " mm/K"),
}
MOST_ESTIMATES = 4  # in a sentence, the most significant; all are in the JSON file
TOO_MANY = 12  # estimates from which none is listed: coefficients of a curve


class Estimate(NamedTuple):
    """Estimate of a parameter: its name with the unit, value and standard error in that unit."""

    name: str
    value: float
    error: float


def screened_estimates(scored: ScoredCandidate) -> tuple[Estimate, ...]:
    """Estimates of the linear screening."""
    return tuple(
        Estimate(p.name, float(theta * p.typical / p.si), float(error * p.typical / p.si))
        for p, theta, error in zip(scored.candidate.parameters, scored.alone.theta, scored.alone.error, strict=True)
    )


def fitted_estimates(scored: ScoredCandidate, fitted: Fit) -> tuple[Estimate, ...]:
    """Estimates of the refit, with the shape parameters that it holds."""
    effect, model = scored.candidate.effect, fitted.model
    errors = dict(zip(model.free, fitted.standard_error, strict=True))
    return tuple(
        Estimate(p.name, model.value(key) / p.si, float(errors.get(key, 0.0)) / p.si)
        for key, p in zip(effect.keys, effect.parameters, strict=True)
        if key in errors or p.fixed is not None
    )


def claim_of(scored: ScoredCandidate, estimates: Sequence[Estimate], fitted: Fit | None) -> str:
    """Claim of an effect with its estimates, for instance `joint2 has 2.3 ± 0.1° of play`; where the claim has no
    number, as of a curve, with the largest motion that the effect makes."""
    effect = scored.candidate.effect
    units = {p.name: p.unit for p in effect.parameters}
    words = {name: with_unit(value, error, units[name]) for name, value, error in estimates}
    chosen = {p.name: _chosen(p, value) for p, value in zip(effect.parameters, scored.shape, strict=True)}
    numbers = {**chosen, **words}
    sentence = effect.about.claim
    claim = (sentence or f"{effect.id} at {{place}}").format(place=effect.place_in_words, **numbers)
    if fitted is not None and not any(f"{{{name}}}" in sentence for name in numbers):
        claim += f", by up to {in_mm(_largest_motion(fitted, effect))} mm at the tip"
    acting = [estimate for estimate in estimates if estimate.value]
    further = [estimate for estimate in acting if estimate.name not in sentence]
    if effect.is_free_form:  # coefficients of a curve mean nothing to a reader
        return claim
    if any(estimate not in further for estimate in acting if estimate.error) or not further or len(further) > TOO_MANY:
        return claim
    surest = sorted(further, key=lambda estimate: -abs(estimate.value) / max(estimate.error, 1e-300))[:MOST_ESTIMATES]
    shown = [name for name in words if name in {estimate.name for estimate in surest}]
    meanings, more = {p.name: p.meaning for p in effect.parameters}, len(further) - MOST_ESTIMATES
    surest_values = ", ".join(f"{meanings[name]} {words[name]}" for name in shown)
    return f"{claim} ({surest_values}{f' and {more} more' if more > 0 else ''})"


def _largest_motion(fitted: Fit, effect: Effect) -> float:
    """Largest motion of the TCP by an effect of a fitted model at the measured poses (m)."""
    without = fitted.model.with_values_of([key for key in effect.keys if key in fitted.model.free], 0.0)
    moved = fitted.equilibrium.tcp - solve_equilibrium(without, fitted.equilibrium.poses, fitted.equilibrium).tcp
    return float(np.linalg.norm(moved, axis=1).max())


def _chosen(parameter: Parameter, value: float) -> str:
    """Value of a shape parameter (SI) with its unit, for instance the pose of a change; 0 for other parameters."""
    return "0" if parameter.fixed is None else with_unit(value / parameter.si, None, parameter.unit)


def with_unit(value: float, error: float | None, unit: str) -> str:
    """Estimate with its standard error, if any, in the unit that is shown, for instance `2.3 ± 0.1°`."""
    scale, symbol = DISPLAY_UNITS.get(unit, (1.0, f" {unit}"))
    if unit == "pose":
        return f"pose {value:.0f}"
    shown = value * scale
    if error:
        return f"{quantity(shown, error * scale)}{symbol}"
    return f"{f'{shown:.0f}' if abs(shown) >= 100 else f'{shown:.3g}'}{symbol}"
