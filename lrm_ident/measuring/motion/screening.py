"""What a joint's motion misses: every effect of the catalogue beside those that it has, judged at held-out moves.

Thresholds are those of the verdicts on poses (`lrm_ident.residual.thresholds`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, stdtr

from lrm_ident.diagnosis.judgement import Support
from lrm_ident.measuring.motion.joint_fit import SCREENING_EVALUATIONS, JointFit, fit_joint
from lrm_ident.residual.thresholds import (
    EQUIVALENT_GAIN,
    MIN_GAIN,
    PROMISING,
    SIGNIFICANCE,
    Z_THRESHOLD,
)
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.motion_model import MotionCatalogue

BY_CHANCE = float(ndtr(-Z_THRESHOLD))
FEWEST_RANKED, LEAST_SQUARE = 14, 1e-15
"""Moves from which on ranks that all agree show one of ninety effects: 2⁻¹³ times 90 exceeds `SIGNIFICANCE`. The other
keeps a logarithm finite (rad² or m²)."""
TRIED_FROM = 1.05
"""Held-out error over the noise from which on effects are tried: the noise is measured at stops, to about 5 %. It
saves time; what is named has to predict better by more than chance in any case."""


@dataclass(frozen=True, eq=False)
class MotionCandidate:
    """An effect that a joint's model may miss.

    Attributes:
        fit: with it. held_out: rad RMS with it; None: its gain in the sample was too small to cross-validate it.
        p_value: of a gain at held-out moves by chance (one-sided, paired by moves, times the number tried).
    """

    effect: MotionEffect
    fit: JointFit
    held_out: float | None
    p_value: float
    verdict: Support


@dataclass(frozen=True, eq=False)
class JointScreening:
    """Candidates of one joint, the best first.

    Attributes:
        before: the fit without any. noise: of a reading (rad). not_testable: effects, and why not.
        equivalent: names of candidates that these moves cannot distinguish from the best.
    """

    before: JointFit
    noise: float
    candidates: tuple[MotionCandidate, ...]
    not_testable: tuple[tuple[MotionEffect, str], ...]
    equivalent: tuple[str, ...] = field(default=())

    @property
    def first(self) -> MotionCandidate | None:
        """The effect to add; None if none is supported."""
        best = self.candidates[0] if self.candidates else None
        return best if best is not None and best.verdict == Support.SUPPORTED else None

    @property
    def saved(self) -> float:
        """Held-out mean square (rad²) that the first would take away; 0 without one."""
        candidate = self.first
        return (
            0.0
            if candidate is None or candidate.held_out is None
            else self.before.held_out_rms**2 - candidate.held_out**2
        )


def screen_joint(before: JointFit, noise: float, catalogue: MotionCatalogue, tried: int) -> JointScreening:
    """Tries every effect that the joint does not have. `tried`: effects at all joints, which the p values pay for."""
    data, arm, place = before.data, before.effects[0].arm, before.effects[0].place
    present = {effect.id for effect in before.effects}
    others = [kind(arm, place) for kind in catalogue if kind.id not in present]
    reasons = [(effect, effect.missing_excitation(data.drive)) for effect in others]
    refused = tuple((effect, reason) for effect, reason in reasons if reason is not None)
    if before.held_out_rms <= TRIED_FROM * noise:
        return JointScreening(before, noise, (), refused)
    ordered = _ordered([_candidate(before, effect, tried) for effect, reason in reasons if reason is None])
    best = ordered[0] if ordered and ordered[0].verdict == Support.SUPPORTED else None
    alike = () if best is None else _equivalent(before, best, ordered[1:])
    return JointScreening(before, noise, tuple(ordered), refused, alike)


def _ordered(candidates: Sequence[MotionCandidate]) -> list[MotionCandidate]:
    """The best first; a term that names no cause goes before causes only where it predicts better than all of them."""
    order = sorted(
        candidates, key=lambda candidate: (candidate.verdict != Support.SUPPORTED, candidate.held_out or np.inf)
    )
    causes = [candidate for candidate in order if candidate.effect.names_a_cause]
    terms = [candidate for candidate in order if not candidate.effect.names_a_cause]
    if not causes or causes[0].verdict != Support.SUPPORTED:
        return order
    better = [
        candidate
        for candidate in terms
        if candidate.verdict == Support.SUPPORTED and is_worse(causes[0].fit, candidate.fit)
    ]
    return [*better, *causes, *(candidate for candidate in terms if candidate not in better)]


def with_effect(before: JointFit, effect: MotionEffect) -> JointFit:
    """The fit with a further effect, from the values before; fitted to its end if it explains anything."""
    order, data = (*before.effects, effect), before.data
    fit = fit_joint(order, data, data.start(before.by_key, effect), SCREENING_EVALUATIONS)
    return fit_joint(order, data, fit.by_key) if _explains(fit, before) else fit


def _explains(fit: JointFit, before: JointFit) -> bool:
    """Whether it leaves enough less in the sample to be cross-validated."""
    least = PROMISING * (1.0 - (1.0 - MIN_GAIN) ** 2)
    return fit.squares <= (1.0 - least) * before.squares


def without_effect(before: JointFit, effect: MotionEffect) -> JointFit:
    """The fit without an effect."""
    kept = tuple(effect_kept for effect_kept in before.effects if effect_kept.name != effect.name)
    return fit_joint(kept, before.data, before.by_key)


def _candidate(before: JointFit, effect: MotionEffect, tried: int) -> MotionCandidate:
    fit = with_effect(before, effect)
    if not _explains(fit, before):
        return MotionCandidate(effect, fit, None, 1.0, Support.NO_EVIDENCE)
    p_value = min(1.0, tried * p_of_gain(before, fit))
    supported = fit.held_out_rms < (1.0 - MIN_GAIN) * before.held_out_rms and p_value < SIGNIFICANCE
    plausible = Support.SUPPORTED if is_plausible(fit, effect) else Support.IMPLAUSIBLE
    verdict = plausible if supported else Support.NO_EVIDENCE
    return MotionCandidate(effect, fit, fit.held_out_rms, p_value, verdict)


def is_plausible(fit: JointFit, effect: MotionEffect) -> bool:
    """Whether the effect's values are such as occur, and surely not none."""
    values, sigma = fit.by_key, fit.sigma
    rows = list(zip(effect.keys, effect.parameters, strict=True))
    size = rows[0][0]
    certain = abs(values[size]) > Z_THRESHOLD * sigma[size]
    return certain and all(abs(values[key]) <= parameter.plausible.largest for key, parameter in rows)


def p_of_gain(before: JointFit, after: JointFit) -> float:
    """One-sided p value that `after` predicts no better than `before`.

    By signed ranks of the moves (Wilcoxon 1945): a few quick ones hold most of the error. By Student's test of the
    logarithm of their errors' ratio, where moves are so few that no ranks could convince."""
    if len(before.held_out) < FEWEST_RANKED:
        gain = np.diff(np.log([np.maximum(fit.held_out, LEAST_SQUARE) for fit in (after, before)]), axis=0)[0]
        spread = np.std(gain, ddof=1) / np.sqrt(len(gain))
        return float(stdtr(len(gain) - 1, -np.mean(gain) / max(spread, LEAST_SQUARE)))
    from scipy.stats import wilcoxon  # takes a second to load

    return float(wilcoxon(before.held_out, after.held_out, alternative="greater").pvalue)


def is_worse(after: JointFit, than: JointFit) -> bool:
    """Whether a fit predicts held-out moves worse, by more than chance and by enough to matter."""
    return p_of_gain(after, than) < BY_CHANCE and after.held_out_rms > (1.0 + MIN_GAIN) * than.held_out_rms


def _equivalent(before: JointFit, best: MotionCandidate, others: Sequence[MotionCandidate]) -> tuple[str, ...]:
    assert best.held_out is not None
    least = EQUIVALENT_GAIN * (before.held_out_rms**2 - best.held_out**2)
    return tuple(
        candidate.effect.name
        for candidate in others
        if candidate.verdict == Support.SUPPORTED
        and candidate.effect.names_a_cause
        and candidate.held_out is not None
        and before.held_out_rms**2 - candidate.held_out**2 >= least
        and not is_worse(candidate.fit, best.fit)
    )
