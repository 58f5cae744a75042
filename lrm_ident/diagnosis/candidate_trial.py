"""Trial of one candidate: refitted in full beside everything else, cross-validated, and judged as it is deployed.

Screening (`diagnose`) is linear. An effect is confirmed if its own parameters differ from zero (Wald test), the
held-out error falls significantly (Vuong test) and the deployed model is not worse. What goes on after the session must
also predict later poses better from earlier ones.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.companion import companion_of, improves_beside
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.cross_validation import blocks_of_fit
from lrm_ident.fitting.held_out import HeldOutBlock, deployed_residual, held_out_residual, held_out_squares
from lrm_ident.fitting.levenberg_marquardt import Fit, implausible_of
from lrm_ident.residual.better_prediction import paired_z, predicts_better
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_ident.residual.deployment.rolling_origin import (
    allows_rolling_origin,
    changes_too_late,
    rolling_origin_forecasts,
    same_forecasts,
)
from lrm_ident.residual.thresholds import FLOOR_RATIO, MAX_WALD_P, MIN_GAIN, ONE_DEVIATION, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import Effect, ModelPart
from lrm_math.errors import LrmError
from lrm_math.model.covariance import ImplausibleEstimate
from lrm_math.model.deployed_model import as_deployed_with, followed_effects, memorised, of_a_session, on_the_way
from lrm_math.model.equilibrium import solve_equilibrium


@dataclass(frozen=True, eq=False)
class Refit:
    """A model with one candidate added, everything refitted, and cross-validated."""

    fit: Fit
    blocks: tuple[HeldOutBlock, ...]

    @property
    def held_out(self) -> Array:
        """(N, 3), its held-out residual (m)."""
        return held_out_residual(self.blocks)

    @cached_property
    def squares(self) -> Array:
        """(N,), its `held_out_squares`."""
        return held_out_squares(self.blocks)

    @property
    def error(self) -> ErrorStats:
        """Held-out error."""
        return error_stats(self.held_out)

    def predicts_no_worse(self, other: Refit) -> bool:
        """Whether its held-out mean square in the session is no larger than another's."""
        return bool(self.squares.mean() <= other.squares.mean())

    def deploys_no_worse(self, other: Refit) -> bool:
        """Whether its held-out mean square as deployed is no larger than another's."""
        deployed, others = ((deployed_residual(refit.blocks) ** 2).sum() for refit in (self, other))
        return bool(deployed <= others)


@dataclass(frozen=True, eq=False)
class CandidateTrial:
    """Trial of a candidate: its refit, or the objection to it.

    Attributes:
        fitted: whether the fit converged.
        worse_deployed: held-out RMS (m) of the deployed model without and with it, where that is the objection.
        beside: the effect beside which alone nothing speaks against its deployed model; empty: it needs none.
    """

    refit: Refit | None
    objection: Reason | None = None
    fitted: bool = True
    worse_deployed: tuple[float, float] | None = None
    beside: str = ""


def refit_trial(
    diagnosis: Diagnosis, scored: ScoredCandidate, blocks: tuple[HeldOutBlock, ...], tested: str = ""
) -> CandidateTrial:
    """Refits the model with a candidate; tests its parameters (Wald), held-out error (Vuong), and the deployed model.

    `tested`: an effect of which it is known already that the deployed model is better with it.
    """
    data, loss, effect = diagnosis.data, diagnosis.fit.loss, scored.candidate.effect
    try:
        fitted = add_effects(diagnosis.fit.model, data, [effect], scored.shape, loss)
        keys = [effect.keys[row] for row in scored.candidate.rows]
        if objection := objection_to_estimates(fitted, keys, implausible_of(diagnosis.fit)):
            return CandidateTrial(None, objection)
        if _shows_no_memory(effect, fitted, data):
            return CandidateTrial(None, Reason(ReasonKind.FOLLOWED_NO_BETTER))
        if _bends_what_it_measures(effect) and _leaves_more_than_noise(diagnosis, fitted):
            return CandidateTrial(None, Reason(ReasonKind.CURVED_IN_PART))
        refit = Refit(fitted, blocks_of_fit(fitted, data))
    except LrmError as error:
        return CandidateTrial(None, Reason(ReasonKind.NOT_REFITTED, said=str(error)), fitted=False)
    if objection := objection_to_prediction(blocks, refit.blocks):
        return CandidateTrial(None, objection)
    if scored.name == tested:
        return CandidateTrial(refit)
    objected = _objection_as_deployed(diagnosis, [effect], refit, blocks)
    if objected is None:
        return CandidateTrial(refit)
    beside = _beside_which_it_lasts(diagnosis, scored, refit, blocks)
    return CandidateTrial(refit, beside=beside) if beside else objected


def _objection_as_deployed(
    diagnosis: Diagnosis, effects: Sequence[Effect], refit: Refit, blocks: tuple[HeldOutBlock, ...]
) -> CandidateTrial | None:
    """What speaks against the deployed model of a refit with further effects; None where nothing does.

    Where a tracker's error is among them and nothing but noise is left, its points cannot judge the arm.
    """
    of_tracker = any(effect.part is ModelPart.MEASUREMENT for effect in effects)
    judges_arm = not of_tracker or _leaves_more_than_noise(diagnosis, refit.fit)
    if judges_arm and (worse := _worse_as_deployed(effects, refit, blocks)):
        return CandidateTrial(None, Reason(ReasonKind.WORSE_DEPLOYED), worse_deployed=worse)
    if later := _not_better_later(effects, diagnosis.fit, refit.fit, diagnosis.data):
        return CandidateTrial(None, Reason(ReasonKind.NOT_BETTER_LATER, later))
    return None


def _beside_which_it_lasts(
    diagnosis: Diagnosis, scored: ScoredCandidate, refit: Refit, blocks: tuple[HeldOutBlock, ...]
) -> str:
    """The plain effect (`companion_of`) beside which nothing speaks against the deployed model with this one, or empty.

    Two effects of the session hide each other: what one leaves unexplained spoils the forecasts of the other.
    """
    other = companion_of(diagnosis, scored)
    if other is None or not improves_beside(refit.fit, diagnosis.data, other):
        return ""
    effects = [scored.candidate.effect, other.candidate.effect]
    try:
        fitted = add_effects(refit.fit.model, diagnosis.data, effects[1:], other.shape, diagnosis.fit.loss)
        both = Refit(fitted, blocks_of_fit(fitted, diagnosis.data))
    except LrmError:
        return ""
    objected = objection_to_prediction(refit.blocks, both.blocks)
    return "" if objected or _objection_as_deployed(diagnosis, effects, both, blocks) else other.name


def _bends_what_it_measures(effect: Effect) -> bool:
    """Whether it is a free form of an effect of the measurement: it imitates much that the arm does."""
    return effect.part is ModelPart.MEASUREMENT and effect.is_free_form


def _shows_no_memory(effect: Effect, fitted: Fit, data: Measurements) -> bool:
    """Whether an effect with a memory fits no better, by two standard errors, than what is constant in its place.

    Where each pose was held for several of its time constants it is a spring, and at another pace it would be wrong.
    """
    model, poses = fitted.model, data.borne_by(fitted.model).poses
    followed = followed_effects(model, poses)
    if effect.name not in followed or effect.name not in memorised(model):
        return False
    others = [name for name in followed if name != effect.name]
    with_it, without = (
        np.asarray((data.position_error(solve_equilibrium(deployed, poses)) ** 2).sum(axis=1))
        for deployed in (as_deployed_with(model, [*names, *on_the_way(model)]) for names in (followed, others))
    )
    return paired_z(with_it, without) <= Z_THRESHOLD


def _leaves_more_than_noise(diagnosis: Diagnosis, fitted: Fit) -> bool:
    """Whether a refit leaves more than a known noise, beyond what that may be misstated."""
    return diagnosis.floor.sd is not None and fitted.sigma > FLOOR_RATIO * diagnosis.floor.sd


def _worse_as_deployed(
    effects: Sequence[Effect], refit: Refit, blocks: tuple[HeldOutBlock, ...]
) -> tuple[float, float] | None:
    """Held-out RMS (m) as deployed before and after a refit that is surely worse there, or of a form not better; else
    None.

    What it explains passes with the session, and what was traded against it would stay behind in the arm. A form of
    the arm shows no cause: it is worth its prediction alone.
    """
    rows = rows_as_deployed(refit.fit.model, refit.fit.equilibrium.poses)
    before, after = deployed_residual(blocks)[rows], deployed_residual(refit.blocks)[rows]
    forms = all(effect.is_free_form and not of_a_session(effect) for effect in effects)
    allowed = 0.0 if forms else ONE_DEVIATION
    if paired_z((before**2).sum(axis=1), (after**2).sum(axis=1)) <= allowed:
        return None
    return error_stats(before).rms, error_stats(after).rms


def _not_better_later(
    effects: Sequence[Effect], before: Fit, after: Fit, data: Measurements
) -> tuple[float, float] | None:
    """RMS (m) of later poses predicted from those before them, without and with effects of a session whose forecasts
    are not surely better; None where they are, or cannot judge them.

    Whether a state outlasts its session only later poses can tell. A law that a rover follows is wrong where the later
    poses are worse with it by more than one standard error, however well its state alone predicts them. Other effects,
    and a change about when the last forecast began or after, are judged by the cross-validation alone.
    """
    lasting = [effect for effect in effects if of_a_session(effect) and effect.part is not ModelPart.MEASUREMENT]
    if not lasting or not allows_rolling_origin(data):
        return None
    if any(changes_too_late(effect, after.model, data) for effect in lasting):
        return None
    without, with_it = rolling_origin_forecasts(before, data), rolling_origin_forecasts(after, data)
    if paired_z(without.followed, with_it.followed) > ONE_DEVIATION:
        return _rms(without.followed), _rms(with_it.followed)
    if same_forecasts(without.best, with_it.best) or paired_z(with_it.best, without.best) > Z_THRESHOLD:
        return None
    return _rms(without.best), _rms(with_it.best)


def _rms(squares: Array) -> float:
    return float(np.sqrt(squares.mean()))


def objection_to_estimates(
    fitted: Fit, keys: Collection[str], before: Collection[ImplausibleEstimate]
) -> Reason | None:
    """Why the estimates of a refit give no evidence for an effect with the parameters `keys`; None where they do.

    These may all be zero (Wald test), or the refit makes an estimate absurd that was not so `before`.
    """
    if wald_p_value(fitted, keys) > MAX_WALD_P:
        return Reason(ReasonKind.NEAR_ZERO)
    keys_before = {estimate.key for estimate in before}
    new = [estimate for estimate in implausible_of(fitted) if estimate.key not in keys_before]
    return Reason(ReasonKind.ABSURD, subject=new[0]) if new else None


def objection_to_prediction(before: Sequence[HeldOutBlock], after: Sequence[HeldOutBlock]) -> Reason | None:
    """Why cross-validations without and with an effect give no evidence for it (Vuong test); None where they do."""
    if predicts_better(held_out_squares(after), held_out_squares(before), MIN_GAIN):
        return None
    return Reason(ReasonKind.NOT_BETTER, tuple(error_stats(held_out_residual(each)).rms for each in (before, after)))


def wald_p_value(fitted: Fit, keys: Collection[str]) -> float:
    """p value of the Wald test (1943) that some parameters are all zero; 1 if none was fitted off its bounds."""
    rows = [row for row, key in enumerate(fitted.model.free) if key in keys and key not in fitted.at_bound]
    if not rows:
        return 1.0
    z = np.array([fitted.model.value(fitted.model.free[row]) for row in rows]) / fitted.standard_error[rows]
    return float(chdtrc(len(rows), z @ np.linalg.pinv(fitted.correlation[np.ix_(rows, rows)], hermitian=True) @ z))
