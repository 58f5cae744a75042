"""Confirmation of a diagnosis, for `diagnose` and `auto`: the best candidate refitted in full and cross-validated.

The first effect that the screening supports is tried (`candidate_trial`). Where that does not confirm it, effects are
selected again without it. What an earlier step of `auto` refused as deployed is tried last. Effects that the linear
screening underrates beside a confirmed one are refitted too (`underrated`): the least error leads.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType

from lrm_ident.data.error_stats import error_stats
from lrm_ident.diagnosis.candidate_trial import CandidateTrial, Refit, refit_trial
from lrm_ident.diagnosis.contradiction import NoCause, why_no_cause
from lrm_ident.diagnosis.diagnose import Diagnosis, select_without
from lrm_ident.diagnosis.forward_selection import moves_alike
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.replication import replicates
from lrm_ident.diagnosis.screening.bounded_fit import BoundedFit
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.specification_test import misspecified_effects
from lrm_ident.fitting.cross_validation import blocks_of_fit
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual, held_out_squares
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.residual.better_prediction import paired_z, share_of_excess, takes_little
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.deployment.forecast_error import forecast_error
from lrm_ident.residual.thresholds import EQUIVALENT_GAIN, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart

MOST_SPECIAL_CASES = 2
"""Special cases of an effect that are refitted: a bound on time."""
MOST_UNDERRATED = 2
"""Underrated effects that are refitted beside the first one: a bound on time."""
MOST_REFUSED = 8
"""Effects that are refused before the rest is left as structure: a bound on time."""
AS_DEPLOYED = (ReasonKind.WORSE_DEPLOYED, ReasonKind.NOT_BETTER_LATER)
"""Objections to the deployed model, which `auto` keeps from step to step."""


@dataclass(frozen=True, eq=False)
class ConfirmedDiagnosis:
    """A diagnosis with its best candidate refitted.

    Attributes:
        blocks: the model as it is, cross-validated.
        refit: with the first supported effect; None if nothing is supported.
        supported: the effects that the data support, the one to add first.
        refused: for each one whose refit did not confirm it, why.
        refuted: whether one of them was refitted; one that these poses cannot tell from the model does not count.
        worse_deployed: of those refused since the deployed model would be worse: its held-out RMS without, with it (m).
        beside: the effect beside which alone the deployed model with the first one is better; empty: it needs none.
        refits: of other effects that were refitted in place of the first one, and to which there is no objection.
    """

    diagnosis: Diagnosis
    blocks: tuple[HeldOutBlock, ...]
    refit: Refit | None
    supported: tuple[ScoredCandidate, ...]
    refused: Mapping[str, Reason]
    refuted: bool = False
    worse_deployed: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    beside: str = ""
    refits: Mapping[str, Refit] = field(default_factory=dict)

    @property
    def held_out(self) -> Array:
        """(N, 3), held-out residual of the model as it is (m)."""
        return held_out_residual(self.blocks)

    @cached_property
    def deployed(self) -> DeployedError:
        """Held-out error of the model as it is deployed."""
        fit, data = self.diagnosis.fit, self.diagnosis.data
        later = forecast_error(fit.model, data, fit.loss, fit.stated)
        return DeployedError.of(fit.model, data.poses, self.blocks, later, self.diagnosis.outliers_together)

    @property
    def refused_as_deployed(self) -> dict[str, Reason]:
        """Those of the refused effects with which the deployed model would not be better."""
        return {name: reason for name, reason in self.refused.items() if reason.kind in AS_DEPLOYED}

    @property
    def first(self) -> ScoredCandidate | None:
        """The effect to add, if any."""
        return self.supported[0] if self.supported else None

    @property
    def rivals(self) -> dict[str, float]:
        """Held-out RMS of the tip (m) that the next effects outside the class of the first one would leave alone, the
        least first; by their refits where there are some. Those that a refit refused are none."""
        first = [] if self.first is None else [self.first.name, *self.diagnosis.equivalent[self.first.name]]
        refitted = {name: refit.error.rms for name, refit in self.refits.items()}
        return self.diagnosis.rivals([*first, *self.refused], error_stats(self.held_out).rms, refitted)

    @cached_property
    def replicates(self) -> bool:
        """Whether the effect to add is chosen in both halves of the data; True where none is added as a cause."""
        if self.first is None or self.describes:
            return True
        compared = {*self.diagnosis.equivalent[self.first.name], *self.refits}
        return replicates(self.diagnosis.screening, self.first, compared)

    @cached_property
    def misspecified(self) -> tuple[str, ...]:
        """Causes of the model, and the effect to add, that fail the specification test of their place."""
        diagnosis = self.diagnosis
        plain = (effect for effect in diagnosis.fit.model.effects if effect.names_a_cause and not effect.is_free_form)
        present = [effect.name for effect in plain if effect.id not in DEFAULT_EFFECTS]
        wrong_effects = misspecified_effects(diagnosis.fit, diagnosis.data, present)
        if self.first is None or self.refit is None or self.describes:
            return wrong_effects
        return (*wrong_effects, *misspecified_effects(self.refit.fit, diagnosis.data, [self.first.name]))

    @property
    def explained(self) -> float:
        """Held-out mean square (m²) that the refit takes."""
        return 0.0 if self.refit is None else error_stats(self.held_out).rms ** 2 - self.refit.error.rms**2

    @property
    def share(self) -> float:
        """Share of the held-out mean square above the noise (of all, where that is unknown) that the refit takes."""
        if self.refit is None:
            return 0.0
        return share_of_excess(self.refit.error.rms, error_stats(self.held_out).rms, self.diagnosis.floor.rms or 0.0)

    @property
    def describes(self) -> bool:
        """Whether the refitted effect only describes: a form of an effect, one of small share while much stays, or one
        whose formula these angles could not contradict."""
        if self.first is None or self.refit is None:
            return False
        after, before = self.refit.error.rms, error_stats(self.held_out).rms
        little = takes_little(after, before, self.diagnosis.floor.rms or 0.0)
        effect, q = self.first.candidate.effect, self.diagnosis.data.poses.q
        return little or why_no_cause(effect, q) is not NoCause.LITTLE

    @property
    def verdict_by_refits(self) -> Verdict:
        """Verdict before the residual's patterns are looked at (`report_of`): that of the diagnosis, but
        `effect_describes` of a refit that shows no cause, and `unexplained_structure` where refits confirmed no
        selected effect, unless nothing is missing."""
        verdict = self.diagnosis.verdict
        if self.refuted and not self.supported and verdict != Verdict.NOTHING_MISSING:
            return Verdict.UNEXPLAINED_STRUCTURE
        return Verdict.EFFECT_DESCRIBES if self.describes else verdict


def confirm(
    diagnosis: Diagnosis,
    blocks: tuple[HeldOutBlock, ...] = (),
    on_progress: Callable[[str], object] = str,
    refused: Collection[str] = (),
    tested: str = "",
    doubted: Mapping[str, Reason] = MappingProxyType({}),
) -> ConfirmedDiagnosis:
    """Refits the first supported effect; while the refit does not confirm it, selects again without it.

    An effect that saves far less than a refused one promised in the screening is refused too: it only resembles that
    structure. Free forms promise nothing, since the screening does not penalise their roughness.

    Args:
        blocks: the model as it is, cross-validated on the diagnosis's poses, where that is known already.
        on_progress: called with what is being done.
        refused: effects (`effect@place`) left out from the start, since a model with them cannot be diagnosed.
        tested: the effect beside which the last one was added (`ConfirmedDiagnosis.beside`): of the two together it is
            known that the deployed model is better.
        doubted: effects refused as deployed beside fewer effects, and why. They count as refused as long as another is
            confirmed, and are refitted only where none is.
    """
    if not blocks:
        on_progress("cross-validating the model as it is")
        blocks = blocks_of_fit(diagnosis.fit, diagnosis.data)
    squares = held_out_squares(blocks)

    @cache
    def selected(without: frozenset[str]) -> Diagnosis:
        return select_without(diagnosis, without) if without else diagnosis

    @cache
    def tried(without: frozenset[str]) -> CandidateTrial:
        selection = selected(without)
        on_progress(f"refitting with {selection.supported[0].name}")
        return refit_trial(selection, selection.supported[0], blocks, tested)

    trials_by_name = dict[str, CandidateTrial]()

    def trial_of(selection: Diagnosis, scored: ScoredCandidate) -> CandidateTrial:
        """The trial of an underrated effect, which is made once, whichever effect it is set beside."""
        if scored.name not in trials_by_name:
            on_progress(f"refitting with {scored.name}")
            trials_by_name[scored.name] = refit_trial(selection, scored, blocks, tested)
        return trials_by_name[scored.name]

    def search(doubted: Mapping[str, Reason]) -> ConfirmedDiagnosis:
        """The first selection whose refit confirms it, `doubted` effects refused without one."""
        reasons = dict.fromkeys(refused, Reason(ReasonKind.NO_DIAGNOSIS))
        promised, rival, refuted, worse = 0.0, "", bool(refused), dict[str, tuple[float, float]]()
        while (selection := selected(frozenset(reasons))).supported and len(reasons) < MOST_REFUSED:
            scored = selection.supported[0]
            doubt = doubted.get(scored.name)
            trial = CandidateTrial(None, doubt) if doubt else tried(frozenset(reasons))
            led, best, others = selection, trial, dict[str, Refit]()
            if not doubt:
                led, best, others = _led_by_underrated(selection, trial, trial_of, squares, {*reasons, *doubted})
            trials = {scored.name: trial, **trials_by_name}
            worse |= {name: trial.worse_deployed for name, trial in trials.items() if trial.worse_deployed}
            if best.refit and _share_saved(best.refit.squares, squares) >= EQUIVALENT_GAIN * promised:
                led, best, special = _led_by_special_case(led, best, blocks, tested)
                refits = others | special
                kept, why = {led.supported[0].name, *refits}, _objections(selection, trials)
                reasons |= {name: reason for name, reason in why.items() if name not in kept}
                return ConfirmedDiagnosis(
                    led,
                    blocks,
                    best.refit,
                    tuple(effect for effect in led.supported if effect.name not in reasons),
                    reasons,
                    worse_deployed=worse,
                    beside=best.beside,
                    refits=refits,
                )
            refuted |= trial.fitted
            reason = trial.objection or Reason(ReasonKind.LESS_THAN_PROMISED, names=(rival,))
            reasons |= dict.fromkeys([scored.name, *selection.repetitions(scored)], reason)
            if trial.refit:
                break
            if trial.fitted and not scored.candidate.effect.is_free_form:
                saved = _share_saved(scored.alone.held_out, selection.screening.linear.baseline.held_out)
                promised, rival = max((promised, rival), (saved, scored.name))
        return ConfirmedDiagnosis(selection, blocks, None, (), reasons, refuted, worse)

    searched = search({name: doubt for name, doubt in doubted.items() if name != tested})
    return searched if searched.refit or searched.refused.keys().isdisjoint(doubted) else search({})


def _objections(selection: Diagnosis, trials: Mapping[str, CandidateTrial]) -> dict[str, Reason]:
    """Why trials refused effects; with the first one of the selection go those that repeat it."""
    objections = {name: trial.objection for name, trial in trials.items() if trial.objection}
    first = selection.supported[0]
    why = objections.get(first.name)
    return dict.fromkeys(selection.repetitions(first), why) | objections if why else objections


Leading = tuple[Diagnosis, CandidateTrial, dict[str, Refit]]
"""A diagnosis, the trial of its first effect, and the refits of others that do not lead."""


def _led_by_underrated(
    diagnosis: Diagnosis,
    trial: CandidateTrial,
    trial_of: Callable[[Diagnosis, ScoredCandidate], CandidateTrial],
    before: Array,
    refused: Collection[str],
) -> Leading:
    """The diagnosis led by an effect that the screening underrates and that is not `refused`, where it predicts better
    when refitted, or alone is confirmed.

    Refits that prediction cannot separate are one class, by the rule of the screening's classes. From a worse first
    effect and its class the better one is told apart, unless it moves the TCP as they do. Effects whose own trial has
    an objection are in no class.

    `before`: (N,), held-out squares without either.
    """
    first = diagnosis.supported[0]
    members, tried = diagnosis.equivalent[first.name], {first.name: trial}
    bounded, fitted = BoundedFit.of(diagnosis.screening), trial.refit.fit if trial.refit else None
    left_out = {*refused, *diagnosis.unexplained.spurious}
    promising = [
        candidate for candidate in bounded.underrated(first, members, fitted) if candidate.name not in left_out
    ]
    underrated = promising[:MOST_UNDERRATED]
    tried |= {candidate.name: trial_of(diagnosis, candidate) for candidate in underrated}
    refits = {name: trial.refit for name, trial in tried.items() if trial.refit}
    if not refits:
        return diagnosis, trial, {}
    best = min(refits, key=lambda name: float(refits[name].squares.mean()))
    alike = {name for name, refit in refits.items() if name != best and _as_good(refit, refits[best], before)}
    possible = [name for name in members if name not in tried or name in refits]
    if best == first.name:
        led = diagnosis.led_by(first, (*possible, *sorted(alike)))
    else:
        leader = next(candidate for candidate in underrated if candidate.name == best)
        whole = {*possible, *({first.name} & refits.keys())}
        near = [
            candidate.name
            for candidate in diagnosis.scored
            if candidate.name in whole and moves_alike(leader, candidate)
        ]
        others = possible if first.name in alike else near
        led = diagnosis.led_by(leader, (*sorted(alike), *others))
    return led, tried[best], {name: refit for name, refit in refits.items() if name != best}


def _as_good(refit: Refit, best: Refit, before: Array) -> bool:
    """Whether a refit saves more than `EQUIVALENT_GAIN` of what the best one does, and prediction cannot separate them.

    `before`: (N,), held-out squares without either.
    """
    saved = _share_saved(refit.squares, before)
    return saved > EQUIVALENT_GAIN * _share_saved(best.squares, before) and (
        paired_z(best.squares, refit.squares) < Z_THRESHOLD
    )


def _led_by_special_case(
    diagnosis: Diagnosis, trial: CandidateTrial, blocks: tuple[HeldOutBlock, ...], tested: str
) -> Leading:
    """The diagnosis led by a special case of the first effect where that predicts no worse when refitted, in the
    session and as deployed, and its trial.

    The screening is linear: it underrates an effect whose columns turn with its estimate, such as a direction.
    Of two errors of the tracker the session decides: the points that it moved do not judge the arm without them.
    """
    refits: dict[str, Refit] = {}
    for special in diagnosis.special_cases()[:MOST_SPECIAL_CASES]:
        leader = diagnosis.supported[0]
        of_tracker = all(scored.candidate.effect.part is ModelPart.MEASUREMENT for scored in (leader, special))
        instead = refit_trial(diagnosis, special, blocks, special.name if of_tracker else tested)
        if not trial.refit or not instead.refit:
            continue
        as_deployed = of_tracker or instead.refit.deploys_no_worse(trial.refit)
        if as_deployed and instead.refit.predicts_no_worse(trial.refit):
            refits[leader.name] = trial.refit
            diagnosis, trial = diagnosis.led_by(special, (leader.name, *diagnosis.equivalent[leader.name])), instead
        else:
            refits[special.name] = instead.refit
    return diagnosis, trial, refits


def _share_saved(after: Array, before: Array) -> float:
    """Share by which the mean of squares (N,) falls."""
    return 1.0 - float(after.mean() / before.mean())
