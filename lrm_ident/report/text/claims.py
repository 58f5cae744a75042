"""Claims in words: the sentence of an effect with its estimates, in the units that people read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lrm_ident.data.wording import in_mm, poses_words, quantity
from lrm_ident.diagnosis.reason import Claim
from lrm_math.arm.place_names import place_words
from lrm_math.effects import Effect, Parameter

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


def claim_sentence(claim: Claim) -> str:
    """Claim of an effect with its estimates, for instance `joint2 has 2.3 ± 0.1° of play`; where the claim has no
    number, as of a curve, with the largest motion that the effect makes."""
    effect, estimates = claim.effect, claim.estimates
    parameters = {p.name: p for p in effect.parameters}
    words = {name: in_words(parameters[name], value, error, claim.turns.get(name)) for name, value, error in estimates}
    chosen = {p.name: _chosen(p, value) for p, value in zip(effect.parameters, claim.shape, strict=True)}
    sentence = stated(effect, {**chosen, **words}, claim.turns)
    if claim.largest_motion is not None:
        sentence += f", by up to {in_mm(claim.largest_motion)} mm at the tip"
    acting = [estimate for estimate in estimates if estimate.value]
    further = [estimate for estimate in acting if estimate.name not in effect.about.claimed]
    if effect.is_free_form:  # coefficients of a curve mean nothing to a reader
        return sentence
    if any(estimate not in further for estimate in acting if estimate.error) or not further or len(further) > TOO_MANY:
        return sentence
    surest = sorted(further, key=lambda estimate: -abs(estimate.value) / max(estimate.error, 1e-300))[:MOST_ESTIMATES]
    shown = [name for name in words if name in {estimate.name for estimate in surest}]
    meanings, more = {p.name: place_words(p.meaning) for p in effect.parameters}, len(further) - MOST_ESTIMATES
    surest_values = ", ".join(f"{meanings[name]} {words[name]}{turned(name in claim.turns)}" for name in shown)
    return f"{sentence} ({surest_values}{f' and {more} more' if more > 0 else ''})"


def stated(effect: Effect, words: Mapping[str, str], turns: Mapping[str, float]) -> str:
    """The claim of an effect with its estimates in words. `turns`: as in `in_words`, by the name of the parameter."""
    claimed = effect.about.claimed_with(effect.place_in_words, words)
    sentence = claimed or f"{effect.id} at {effect.place_in_words}"
    return sentence + turned(not effect.about.claimed.isdisjoint(turns))


def turned(by_load: bool) -> str:
    """What follows an angle that is a compliance at the usual load."""
    return " under the usual load" if by_load else ""


def in_words(parameter: Parameter, value: float, error: float | None, turn: float | None) -> str:
    """Estimate with its standard error; of a compliance the angle that the usual load makes of it.

    Args:
        turn: (rad) that the usual load makes of a compliance of 1, where that is known.
    """
    if turn is None:
        return with_unit(value, error, parameter.unit)
    return with_unit(value * turn, None if error is None else error * turn, "rad")


def outliers_left_out(poses: Sequence[int]) -> str:
    """What a step did that left poses out, and what to do about them."""
    what = "is left out as an outlier" if len(poses) == 1 else "are left out as outliers"
    return f"{poses_words(poses)} {what}: measure there again"


def chosen_again(frequency: Mapping[str, int], folds: int) -> str:
    """In how many repeated searches each effect was chosen: what few choose is unstable."""
    often = [f"{name} in {count}" for name, count in frequency.items() if count > 1]
    once = sum(count == 1 for count in frequency.values())
    searches = f"of {folds} repeated searches, each without a part of the poses"
    more = f"; {once} {'more ' if often else ''}in one {'each' if once > 1 else 'only'}" if once else ""
    return f"{', '.join(often) or 'no effect in two or more'} {searches}{more}"


def empirical_words(count: int) -> str:
    """What `count` empirical terms do."""
    return f"{'it improves' if count == 1 else 'they improve'} the prediction; the cause is not identified"


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
