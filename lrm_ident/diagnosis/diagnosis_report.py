"""A diagnosis turned into advice: each candidate's verdict, its estimate in words, and what to measure next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lrm_ident.data.data_audit import audit
from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.diagnosis.add_effect import add_effects, shape_of
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.forward_selection import WORTHWHILE
from lrm_ident.diagnosis.score_test import Scored
from lrm_ident.fit.cross_validation import held_out
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_math.errors import LrmError

CONFIRMED = 3  # candidates that are refitted and cross-validated in full
UNITS = {
    "rad": (180.0 / np.pi, "°"),
    "rad_per_rad": (100.0, " %"),
    "rad_per_Nm": (1.0, " rad/Nm"),
    "rad_per_Nm2": (1.0, " rad/Nm²"),
    "rad_per_Nm3": (1.0, " rad/Nm³"),
    "Nm_per_rad": (1.0, " Nm/rad"),
    "mm_per_m": (1.0, " mm/m"),
}


@dataclass(frozen=True, eq=False)
class Advice:
    """One candidate, judged.

    Attributes:
        estimates: (name with unit, value, standard error) in the file's units.
        held_out_rms: what the held-out RMS would be (m); `exact` if refitted and cross-validated, else linear.
    """

    scored: Scored
    verdict: Literal["supported", "indistinguishable", "no_evidence"]
    held_out_rms: float
    exact: bool
    estimates: tuple[tuple[str, float, float], ...]
    rivals: tuple[str, ...]
    why: str


@dataclass(frozen=True, eq=False)
class Report:
    """A diagnosis with everything that is said of it."""

    diagnosis: Diagnosis
    verdict: Literal["effect_missing", "nothing_missing", "unexplained_structure"]
    fit: ErrorFigures
    held_out: ErrorFigures
    ranking: tuple[Advice, ...]
    traps: tuple[str, ...]
    hint: str

    @property
    def first(self) -> Advice | None:
        """The effect to add, if any."""
        return self.ranking[0] if self.verdict == "effect_missing" else None


def advise(diagnosis: Diagnosis, told: Callable[[str], object] = str) -> Report:
    """Judges every candidate; the best few are refitted and cross-validated. `told` hears what is being done."""
    told("cross-validating the model as it is")
    before = figures(held_out(diagnosis.fit.model, diagnosis.data))
    confirmed: dict[str, tuple[Fit, float]] = {}
    refuted: list[str] = []
    for scored in _worth_confirming(diagnosis):
        told(f"refitting with {scored.name}")
        found = _confirm(diagnosis, scored)
        if found and found[1] < (1.0 - WORTHWHILE) * before.rms:
            confirmed[scored.name] = found
        else:
            refuted.append(scored.name)
    supported = [s for s in diagnosis.supported if s.name not in refuted]
    verdict = diagnosis.verdict
    if verdict == "effect_missing" and not supported:
        verdict = "unexplained_structure"
    ordered = _order(diagnosis, supported)
    ranking = tuple(_judge(scored, diagnosis, supported, confirmed, before) for scored in ordered)
    return Report(
        diagnosis=diagnosis,
        verdict=verdict,
        fit=figures(diagnosis.fit.residual),
        held_out=before,
        ranking=ranking,
        traps=audit(diagnosis.data, diagnosis.fit.rest.joint_torque),
        hint=_hint(diagnosis, supported),
    )


def _worth_confirming(diagnosis: Diagnosis) -> list[Scored]:
    by_name = {scored.name: scored for scored in diagnosis.scored}
    names = [s.name for s in diagnosis.supported[:1]]
    names += [rival for name in names for rival in diagnosis.rivals[name]]
    names += [s.name for s in diagnosis.supported[1:]]
    return [by_name[name] for name in names[:CONFIRMED]]


def _confirm(diagnosis: Diagnosis, scored: Scored) -> tuple[Fit, float] | None:
    try:
        fitted = add_effects(diagnosis.fit.model, diagnosis.data, [scored.candidate.effect], shape_of(scored))
        return fitted, figures(held_out(fitted.model, diagnosis.data)).rms
    except LrmError:
        return None


def _order(diagnosis: Diagnosis, supported: Sequence[Scored]) -> list[Scored]:
    """Supported ones first, those that cannot be told from the first next, then by what they would leave."""
    first = supported[:1]
    rivals = {name for scored in first for name in diagnosis.rivals[scored.name]}
    rest = [s for s in diagnosis.scored if s not in supported]
    rest.sort(key=lambda s: (s.name not in rivals, bool(s.implausible), s.alone.rms))
    return [*supported, *rest]


def _judge(
    scored: Scored,
    diagnosis: Diagnosis,
    supported: Sequence[Scored],
    confirmed: dict[str, tuple[Fit, float]],
    before: ErrorFigures,
) -> Advice:
    fitted, rms = confirmed.get(scored.name, (None, scored.alone.rms))
    estimates = _estimates(scored) if fitted is None else _fitted_estimates(scored, fitted)
    rivals = diagnosis.rivals.get(scored.name, ()) if scored in supported else ()
    leaders = [s.name for s in supported[:1] if scored.name in diagnosis.rivals[s.name]]
    verdict: Literal["supported", "indistinguishable", "no_evidence"] = "no_evidence"
    if rivals or leaders:
        verdict = "indistinguishable"
    elif scored in supported:
        verdict = "supported"
    why = _why(scored, diagnosis, verdict, estimates, rms, before, tuple(leaders) or rivals)
    return Advice(scored, verdict, rms, fitted is not None, estimates, tuple(leaders) or rivals, why)


def _estimates(scored: Scored) -> tuple[tuple[str, float, float], ...]:
    return tuple(
        (p.name, float(theta * p.typical / p.si), float(error * p.typical / p.si))
        for p, theta, error in zip(scored.candidate.parameters, scored.alone.theta, scored.alone.error, strict=True)
    )


def _fitted_estimates(scored: Scored, fitted: Fit) -> tuple[tuple[str, float, float], ...]:
    effect, model = scored.candidate.effect, fitted.model
    errors = dict(zip(model.free, fitted.standard_error, strict=True))
    out = []
    for parameter in effect.parameters:
        key = f"{effect.id}.{effect.place}.{parameter.name}"
        if key in errors or parameter.fixed is not None:
            out.append((parameter.name, model.value(key) / parameter.si, float(errors.get(key, 0.0)) / parameter.si))
    return tuple(out)


def _why(
    scored: Scored,
    diagnosis: Diagnosis,
    verdict: str,
    estimates: Sequence[tuple[str, float, float]],
    rms: float,
    before: ErrorFigures,
    rivals: Sequence[str],
) -> str:
    if scored.name in diagnosis.borrowed:
        return f"it only resembles {diagnosis.borrowed[scored.name]}, which explains far more"
    if verdict == "no_evidence":
        if scored.implausible:
            return scored.implausible
        if scored.alone.rms > (1.0 - WORTHWHILE) * before.rms:
            return f"it would leave {rms * 1e3:.2f} mm held out of {before.rms * 1e3:.2f}: hardly less"
        return f"alone it would leave {rms * 1e3:.2f} mm, but with the effects above there is no need of it"
    fall = f"the held-out error falls from {before.rms * 1e3:.2f} to {rms * 1e3:.2f} mm"
    unsure = f"; these data cannot tell it from {', '.join(rivals[:4])}" if rivals else ""
    return f"{in_words(scored, estimates)}: {fall}{unsure}"


def in_words(scored: Scored, estimates: Sequence[tuple[str, float, float]]) -> str:
    """The effect's claim with its estimates, for instance `joint2 has 2.3 ± 0.1° of play`."""
    effect = scored.candidate.effect
    units = {p.name: p.unit for p in effect.parameters}
    words = {name: _with_unit(value, error, units[name]) for name, value, error in estimates}
    numbers = {p.name: words.get(p.name, "0") for p in effect.parameters}
    if effect.claim and any(name in effect.claim for name in words):
        return effect.claim.format(place=effect.place, **numbers)
    said = effect.claim.format(place=effect.place, **numbers) if effect.claim else f"{effect.id} at {effect.place}"
    return f"{said} ({', '.join(f'{name} {text}' for name, text in words.items())})"


def _with_unit(value: float, error: float, unit: str) -> str:
    scale, symbol = UNITS.get(unit, (1.0, f" {unit}"))
    return f"{value * scale:.3g} ± {error * scale:.1g}{symbol}"


def _hint(diagnosis: Diagnosis, supported: Sequence[Scored]) -> str:
    """One sentence on which poses would tell more."""
    kinds = {scored.name: scored.candidate.effect for scored in diagnosis.scored}
    for scored in supported[:1]:
        names = (scored.name, *diagnosis.rivals[scored.name])
        needs = [kinds[name].needs for name in names if kinds[name].needs]
        if len(names) > 1:
            what = "; ".join(dict.fromkeys(needs)) or "poses that differ in load, angle and order independently"
            return f"To tell {names[0]} from {names[1]}: {what}."
    for effect, reason in diagnosis.not_testable:
        if effect.needs and "typical size" not in reason:
            return f"To test {effect.id}@{effect.place} ({reason}): {effect.needs}."
    return "Repeat a few poses to know the noise, and measure in random order with two loads."
