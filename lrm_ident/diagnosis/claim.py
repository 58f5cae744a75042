"""Claim of an effect: its estimates by the screening or by a refit, and how far it moves the tip."""

from __future__ import annotations

import numpy as np

from lrm_ident.diagnosis.reason import Claim, Estimate
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.gravity_loads import usual_turns
from lrm_math.effects import Effect
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium


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


def claim_of(scored: ScoredCandidate, estimates: tuple[Estimate, ...], fitted: Fit | None, rest: Equilibrium) -> Claim:
    """Claim of an effect with its estimates. `fitted`: the refit with it, if there is one. `rest`: of the model."""
    effect = scored.candidate.effect
    stated = effect.about.claimed & {parameter.name for parameter in effect.parameters}
    motion = None if fitted is None or stated else _largest_motion(fitted, effect)
    return Claim(effect, estimates, tuple(map(float, scored.shape)), motion, usual_turns(effect, rest))


def _largest_motion(fitted: Fit, effect: Effect) -> float:
    """Largest motion of the TCP by an effect of a fitted model at the measured poses (m)."""
    without = fitted.model.with_values_of([key for key in effect.keys if key in fitted.model.free], 0.0)
    moved = fitted.equilibrium.tcp - solve_equilibrium(without, fitted.equilibrium.poses, fitted.equilibrium).tcp
    return float(np.linalg.norm(moved, axis=1).max())
