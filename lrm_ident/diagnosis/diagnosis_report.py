"""Report of a diagnosis: each candidate's verdict and estimates, the best ones refitted, and what to measure next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.data.wording import in_mm, quantity
from lrm_ident.diagnosis.confirm import ConfirmedDiagnosis, confirm
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.data_audit import audit
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.residual.parameter_hints import parameter_hints
from lrm_ident.residual.predictability import PredictableError
from lrm_ident.residual.residual_patterns import ResidualPatterns, residual_patterns
from lrm_ident.residual.thresholds import MIN_GAIN
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
NEXT_STEP: Mapping[Verdict, str] = {
    Verdict.UNEXPLAINED_STRUCTURE: (
        "Searches for a formula. If you know the cause, write it as an effect: docs/effects.md"
    ),
    Verdict.UNPREDICTABLE: (
        "Measure some of these poses again in another order. An error that repeats belongs to the arm; "
        "one that does not is a loose part, creep or noise."
    ),
    Verdict.NOTHING_MISSING: (
        "Sends it to lrmd, the program that drives the arm. To check it with a tracker: "
        "lrm-ident verify --tracker dtrack:5000 --goals 50"
    ),
    Verdict.NOISE_UNKNOWN: (
        "Measure five poses twice or more (column repeat_of), or state the noise of the instrument "
        "(noise_sd_mm), and diagnose again."
    ),
}
"""Advice after a verdict that names no cause."""


class Estimate(NamedTuple):
    """Estimate of a parameter: its name with the unit, value and standard error in that unit."""

    name: str
    value: float
    error: float


@dataclass(frozen=True, eq=False)
class RankedCandidate:
    """One candidate with its verdict.

    Attributes:
        held_out_rms: held-out RMS with it (m), by the linear screening unless `exact`.
        fit: with it, where it was refitted and cross-validated; else None. deployed: its held-out error as deployed.
        equivalent: names of effects that the data cannot distinguish from it.
        claim: the effect with its estimates, in words; "" without evidence. reason: of the verdict.
    """

    scored: ScoredCandidate
    verdict: Support
    held_out_rms: float
    fit: Fit | None
    estimates: tuple[Estimate, ...]
    equivalent: tuple[str, ...]
    claim: str
    reason: Reason
    deployed: DeployedError | None = None

    def __repr__(self) -> str:
        return f"<{self.name}, {self.verdict}: {self.why}>"

    @property
    def name(self) -> str:
        """`id@place`, by which it is added."""
        return self.scored.name

    @property
    def why(self) -> str:
        """The reason in one sentence."""
        return str(self.reason)

    @property
    def exact(self) -> bool:
        """Whether it was refitted and cross-validated."""
        return self.fit is not None


@dataclass(frozen=True, eq=False)
class DiagnosisReport(ShownInNotebook):
    """A diagnosis with its ranking, the limitations of the data, and a hint on what to measure next.

    Attributes:
        fit, held_out: error of the model as it is, in the fit and cross-validated. deployed: as it is deployed.
        share: of the held-out mean square above the noise that the first candidate takes away.
        left: patterns of the residual without a name. hints: patterns of the estimates, which are no effects.
        replicates: whether the first candidate is chosen in both halves of the data.
    """

    diagnosis: Diagnosis
    verdict: Verdict
    fit: ErrorStats
    held_out: ErrorStats
    deployed: DeployedError
    ranking: tuple[RankedCandidate, ...]
    share: float
    limitations: tuple[str, ...]
    hint: str
    left: ResidualPatterns
    hints: tuple[str, ...]
    replicates: bool = True

    def __repr__(self) -> str:
        fit = self.diagnosis.fit
        count = f"{len(fit.residual)} poses, {len(self.ranking)} candidates"
        return f"<Diagnosis of {fit.model.arm.name}: {self.verdict}; {count}>"

    @property
    def first(self) -> RankedCandidate | None:
        """The effect to add, if any."""
        return self.ranking[0] if self.ranking and self.ranking[0].exact else None

    @property
    def far_rows(self) -> tuple[int, ...]:
        """Rows of the fit's outliers, the farthest first, where the error exceeds the noise and nothing predicts it."""
        found = self.left.predictable.more_to_find or self.diagnosis.unexplained.functions
        if found or self.verdict not in (Verdict.UNEXPLAINED_STRUCTURE, Verdict.UNPREDICTABLE):
            return ()
        fit = self.diagnosis.fit
        return tuple(sorted(fit.outliers, key=lambda row: -float(np.linalg.norm(fit.residual[row]))))


def build_report(
    diagnosis: Diagnosis, on_progress: Callable[[str], object] = str, compared: ModelComparison | None = None
) -> DiagnosisReport:
    """Confirms a diagnosis and reports it.

    Args:
        on_progress: called with what is being done.
        compared: comparison of the same model, fitted without a prior, if known: with the same poses and parameters its
            cross-validation is not repeated.
    """
    same = compared is not None and _same_fit(diagnosis, compared)
    blocks, predictable = (compared.held_out.blocks, compared.predictable) if compared and same else ((), None)
    return report_of(confirm(diagnosis, blocks, on_progress=on_progress), predictable)


def _same_fit(diagnosis: Diagnosis, compared: ModelComparison) -> bool:
    """Whether the cross-validation of a comparison is that of the diagnosed fit."""
    one, other = compared.equilibrium.model, diagnosis.fit.model
    same = set(one.keys) == set(other.keys) and set(one.free) == set(other.free)
    refitted = compared.held_out.residual is not None
    return same and refitted and np.array_equal(compared.data.pose, diagnosis.data.pose)


def report_of(confirmed: ConfirmedDiagnosis, predictable: PredictableError | None = None) -> DiagnosisReport:
    """Report of a confirmed diagnosis: ranking of all candidates, patterns of the residual, what to measure next.

    Args:
        predictable: of the confirmed diagnosis's cross-validation, where that is known already.
    """
    diagnosis, supported = confirmed.diagnosis, confirmed.supported
    left = residual_patterns(diagnosis.fit, diagnosis.data, confirmed.blocks, diagnosis.outlier_distances, predictable)
    before = error_stats(confirmed.held_out)
    quiet = confirmed.verdict.quiet
    more = left.predictable.more_to_find and (quiet or confirmed.verdict == Verdict.UNPREDICTABLE)
    verdict = Verdict.UNEXPLAINED_STRUCTURE if more or (quiet and left.regimes) else confirmed.verdict
    return DiagnosisReport(
        diagnosis=diagnosis,
        verdict=verdict,
        fit=error_stats(diagnosis.fit.residual),
        held_out=before,
        deployed=confirmed.deployed,
        ranking=tuple(_rank(one, confirmed, before) for one in _order(diagnosis, supported)),
        share=confirmed.share,
        limitations=audit(diagnosis.data, diagnosis.fit.equilibrium.joint_torque),
        hint=NEXT_STEP[verdict] if verdict in NEXT_STEP else _hint(diagnosis, supported[:1]),
        left=left,
        hints=parameter_hints(diagnosis.fit),
        replicates=confirmed.replicates,
    )


def _order(diagnosis: Diagnosis, supported: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
    """Candidates in the order of the ranking: supported ones, those equivalent to the first, others by held-out RMS."""
    equivalent = diagnosis.equivalent[supported[0].name] if supported else ()
    rest = [one for one in diagnosis.scored if one not in supported]
    rest.sort(key=lambda one: (one.name not in equivalent, bool(one.implausible), one.alone.rms))
    return [*supported, *rest]


def _rank(scored: ScoredCandidate, confirmed: ConfirmedDiagnosis, before: ErrorStats) -> RankedCandidate:
    """A candidate with its verdict and the reason of it. `before`: held-out error without it."""
    diagnosis, supported = confirmed.diagnosis, confirmed.supported
    refit = confirmed.refit if scored in supported[:1] else None
    fitted, rms = (None, scored.alone.rms) if refit is None else (refit.fit, refit.error.rms)
    estimates = _estimates(scored) if fitted is None else _fitted_estimates(scored, fitted)
    leaders = tuple(one.name for one in supported[:1] if scored.name in diagnosis.equivalent[one.name])
    equivalent = leaders or (diagnosis.equivalent[scored.name] if scored in supported else ())
    verdict = Support.NO_EVIDENCE
    none = ReasonKind.UNCONFIRMED if confirmed.refused else ReasonKind.CHANCE
    other = Reason(ReasonKind.BEHIND if supported else none)
    reason = Reason(ReasonKind.REFUSED, (rms,), because=confirmed.refused.get(scored.name, other))
    claim = ""
    if equivalent or scored in supported:
        claim = _describe_effect(scored, estimates, fitted)
        verdict = Support.INDISTINGUISHABLE if equivalent else Support.SUPPORTED
        reason = Reason(ReasonKind.EXPLAINS, (before.rms, rms), (scored.name, *equivalent), claim)
    elif scored.implausible:
        reason = scored.implausible
    elif scored.alone.rms > (1.0 - MIN_GAIN) * before.rms:
        reason = Reason(ReasonKind.LITTLE, (rms, before.rms))
    if function := diagnosis.unexplained.spurious.get(scored.name):
        reason = Reason(ReasonKind.RESEMBLES, names=(function.name,))
    deployed = None if refit is None else DeployedError.of(refit.fit.model, diagnosis.data.poses, refit.blocks)
    return RankedCandidate(scored, verdict, rms, fitted, estimates, equivalent, claim, reason, deployed)


def _estimates(scored: ScoredCandidate) -> tuple[Estimate, ...]:
    """Estimates of the linear screening."""
    return tuple(
        Estimate(p.name, float(theta * p.typical / p.si), float(error * p.typical / p.si))
        for p, theta, error in zip(scored.candidate.parameters, scored.alone.theta, scored.alone.error, strict=True)
    )


def _fitted_estimates(scored: ScoredCandidate, fitted: Fit) -> tuple[Estimate, ...]:
    """Estimates of the refit, with the shape parameters that it holds."""
    effect, model = scored.candidate.effect, fitted.model
    errors = dict(zip(model.free, fitted.standard_error, strict=True))
    return tuple(
        Estimate(p.name, model.value(key) / p.si, float(errors.get(key, 0.0)) / p.si)
        for key, p in zip(effect.keys, effect.parameters, strict=True)
        if key in errors or p.fixed is not None
    )


def _describe_effect(scored: ScoredCandidate, estimates: Sequence[Estimate], fitted: Fit | None) -> str:
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
    acting = [one for one in estimates if one.value]
    further = [one for one in acting if one.name not in sentence]
    if effect.variant_of:  # coefficients of a curve mean nothing to a reader
        return claim
    if any(one not in further for one in acting if one.error) or not further or len(further) > TOO_MANY:
        return claim
    surest = sorted(further, key=lambda one: -abs(one.value) / max(one.error, 1e-300))[:MOST_ESTIMATES]
    shown = [name for name in words if name in {one.name for one in surest}]
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


def _hint(diagnosis: Diagnosis, first: Sequence[ScoredCandidate]) -> str:
    """One sentence on which poses would distinguish the first supported effect, if any, from its equivalents."""
    kinds = {scored.name: scored.candidate.effect for scored in diagnosis.scored}
    names = [name for one in first for name in (one.name, *diagnosis.equivalent[one.name])]
    if not names:
        return "Repeat a few poses to know the noise, and measure in random order with two loads."
    plain = [name for name in names if name in kinds]
    needs = dict.fromkeys(kinds[name].about.needs for name in plain if kinds[name].about.needs)
    what = "; ".join(needs) or "several loads, joint angles that vary independently, a random order"
    if len(names) > 1 or kinds[names[0]].variant_of:
        return f"Measure poses that distinguish the possible causes: {what}."
    return "Add the best candidate, refit everything, and diagnose again."
