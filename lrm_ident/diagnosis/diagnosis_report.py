"""Report of a diagnosis: each candidate's verdict and estimates, the best ones refitted, and what to measure next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.diagnosis.candidate_trial import Refit
from lrm_ident.diagnosis.claim import claim_of, fitted_estimates, screened_estimates
from lrm_ident.diagnosis.confirm import ConfirmedDiagnosis, confirm
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.diagnosis.reason import Claim, Estimate, Reason, ReasonKind
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.held_out import deployed_residual
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.data_audit import Limitation, audit
from lrm_ident.residual.deployment.carried_states import rows_as_deployed
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.deployment.forecast_error import forecast_error
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.residual.free_functions import FreeFunction
from lrm_ident.residual.influential_poses import InfluentialPoses, influential_poses
from lrm_ident.residual.parameter_hints import ParameterHint, parameter_hints
from lrm_ident.residual.predictability import PredictableError
from lrm_ident.residual.residual_patterns import ResidualPatterns, residual_patterns
from lrm_ident.residual.thresholds import MIN_GAIN
from lrm_math.effects import Effect

WORDS = "lrm_ident.report.text.reasons"
"""The module above that writes reasons; it is looked up when a person asks, and not before."""


@dataclass(frozen=True, eq=False)
class RankedCandidate:
    """One candidate with its verdict.

    Attributes:
        held_out_rms: held-out RMS with it (m), by the linear screening unless `exact` (`Diagnosis.error_of_tip`).
        fit: with it, where it was refitted and cross-validated; else None. deployed: its held-out error as deployed;
        deployed_without: that of the model without it, at the same poses.
        equivalent: names of effects that the data cannot distinguish from it.
        claim: the effect with its estimates; None without evidence. reason: of the verdict.
    """

    scored: ScoredCandidate
    verdict: Support
    held_out_rms: float
    fit: Fit | None
    estimates: tuple[Estimate, ...]
    equivalent: tuple[str, ...]
    claim: Claim | None
    reason: Reason
    deployed: DeployedError | None = None
    deployed_without: ErrorStats | None = None

    def __repr__(self) -> str:
        return f"<{self.name}, {self.verdict}: {self.reason.kind}>"

    @property
    def name(self) -> str:
        """`id@place`, by which it is added."""
        return self.scored.name

    @property
    def effect(self) -> Effect:
        """The effect, with its parameters as they are in the catalogue."""
        return self.scored.candidate.effect

    @property
    def why(self) -> str:
        """The reason in one sentence."""
        words: str = import_module(WORDS).reason_words(self.reason)
        return words

    @property
    def exact(self) -> bool:
        """Whether it was refitted and cross-validated."""
        return self.fit is not None


@dataclass(frozen=True, eq=False)
class DiagnosisReport(ShownInNotebook):
    """A diagnosis with its ranking and the limitations of the data.

    Attributes:
        fitted, held_out: error of the model as it is, in the fit and cross-validated. deployed: as it is deployed.
        share: of the held-out mean square above the noise that the first candidate takes away.
        patterns: of the residual, without a name. hints: patterns of the estimates, which are no effects.
        replicates: whether the first candidate is chosen in both halves of the data.
        misspecified: causes of the model, and the first candidate, whose quantity moves the arm otherwise, too.
        indistinguishable: of effects of the model (`effect@place`), those that the poses could not distinguish from
            them when they were added.
        beside: the effect that the first candidate needs beside it to make the deployed model surely better, or empty.
        influential: poses that alone determine the model where they are, if most of the held-out error is theirs.
        moved: RMS distance (m) between the positions that the judged model and the file's predict at these poses: a
            diagnosis fits anew without outliers, and on other data.
    """

    diagnosis: Diagnosis
    verdict: Verdict
    fitted: ErrorStats
    held_out: ErrorStats
    deployed: DeployedError
    ranking: tuple[RankedCandidate, ...]
    share: float
    limitations: tuple[Limitation, ...]
    patterns: ResidualPatterns
    hints: tuple[ParameterHint, ...]
    replicates: bool = True
    misspecified: tuple[str, ...] = ()
    beside: str = ""
    indistinguishable: Mapping[str, Sequence[str]] = field(default_factory=dict)
    influential: InfluentialPoses | None = None
    moved: float = 0.0

    def __repr__(self) -> str:
        fit = self.diagnosis.fit
        count = f"{len(fit.residual)} poses, {len(self.ranking)} candidates"
        return f"<Diagnosis of {fit.model.arm.name}: {self.verdict}; {count}>"

    @property
    def first(self) -> RankedCandidate | None:
        """The effect to add, if any."""
        return self.ranking[0] if self.ranking and self.ranking[0].exact else None

    @property
    def functions(self) -> tuple[tuple[FreeFunction, float], ...]:
        """The best free functions, and the held-out RMS (m) that each would leave."""
        ranking = self.diagnosis.unexplained.ranking
        diagnosis, before = self.diagnosis, self.held_out.rms
        return tuple((function, diagnosis.error_of_tip(rms, before)) for function, rms in ranking)

    @property
    def far_rows(self) -> tuple[int, ...]:
        """Rows of the fit's outliers, the farthest first, where the error exceeds the noise and nothing predicts it."""
        structured = self.patterns.predictable.more_to_find or self.diagnosis.unexplained.functions
        if structured or self.verdict not in (Verdict.UNEXPLAINED_STRUCTURE, Verdict.UNPREDICTABLE):
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
    mine, other = compared.equilibrium.model, diagnosis.fit.model
    same = set(mine.keys) == set(other.keys) and set(mine.free) == set(other.free)
    refitted = compared.held_out.residual is not None
    return same and refitted and np.array_equal(compared.data.pose, diagnosis.data.pose)


def report_of(confirmed: ConfirmedDiagnosis, predictable: PredictableError | None = None) -> DiagnosisReport:
    """Report of a confirmed diagnosis: ranking of all candidates, patterns of the residual, what to measure next.

    Args:
        predictable: of the confirmed diagnosis's cross-validation, where that is known already.
    """
    diagnosis = confirmed.diagnosis
    patterns = residual_patterns(
        diagnosis.fit, diagnosis.data, confirmed.blocks, diagnosis.outlier_distances, predictable
    )
    before = error_stats(confirmed.held_out)
    return DiagnosisReport(
        diagnosis=diagnosis,
        verdict=final_verdict(confirmed.verdict_by_refits, patterns),
        fitted=error_stats(diagnosis.fit.residual),
        held_out=before,
        deployed=confirmed.deployed,
        beside=confirmed.beside,
        ranking=tuple(_rank(candidate, confirmed, before) for candidate in _order(confirmed, before)),
        share=confirmed.share,
        limitations=audit(diagnosis.data.poses, diagnosis.fit.equilibrium.joint_torque),
        patterns=patterns,
        hints=parameter_hints(diagnosis.fit),
        replicates=confirmed.replicates,
        misspecified=confirmed.misspecified,
        influential=influential_poses(diagnosis.fit.residual, confirmed.held_out),
    )


def final_verdict(by_refits: Verdict, patterns: ResidualPatterns) -> Verdict:
    """The verdict that a person reads: that of the screening (`Diagnosis.verdict`), changed by refits
    (`ConfirmedDiagnosis.verdict_by_refits`); what looks like noise to both has structure where a model without names
    predicts it, or where it is large in a regime."""
    predicted = patterns.predictable.more_to_find and (by_refits.quiet or by_refits == Verdict.UNPREDICTABLE)
    structure = predicted or (by_refits.quiet and patterns.regimes)
    return Verdict.UNEXPLAINED_STRUCTURE if structure else by_refits


def _order(confirmed: ConfirmedDiagnosis, before: ErrorStats) -> list[ScoredCandidate]:
    """Candidates in the order of the ranking: supported ones, those equivalent to the first, others by held-out RMS."""
    diagnosis, supported = confirmed.diagnosis, confirmed.supported
    equivalent = diagnosis.equivalent[supported[0].name] if supported else ()
    rest = [candidate for candidate in diagnosis.scored if candidate not in supported]
    rest.sort(
        key=lambda candidate: (
            candidate.name not in equivalent,
            bool(candidate.implausible),
            _rms_left(candidate, confirmed, before),
        )
    )
    return [*supported, *rest]


def _refit_of(scored: ScoredCandidate, confirmed: ConfirmedDiagnosis) -> Refit | None:
    """The refit with a candidate, if there is one."""
    return confirmed.refit if scored is confirmed.first else confirmed.refits.get(scored.name)


def _rms_left(scored: ScoredCandidate, confirmed: ConfirmedDiagnosis, before: ErrorStats) -> float:
    """Held-out RMS of the tip (m) with a candidate, by its refit or else by the screening; `before`: without it."""
    refit = _refit_of(scored, confirmed)
    return confirmed.diagnosis.error_of_tip(scored.alone.rms, before.rms) if refit is None else refit.error.rms


def _deployed(refit: Refit, data: Measurements) -> DeployedError:
    """Held-out error of a refitted model as it is deployed."""
    later = forecast_error(refit.fit.model, data, refit.fit.loss, refit.fit.stated)
    return DeployedError.of(refit.fit.model, data.poses, refit.blocks, later)


def _rank(scored: ScoredCandidate, confirmed: ConfirmedDiagnosis, before: ErrorStats) -> RankedCandidate:
    """A candidate with its verdict and the reason of it. `before`: held-out error without it."""
    diagnosis, supported = confirmed.diagnosis, confirmed.supported
    refit, rms = _refit_of(scored, confirmed), _rms_left(scored, confirmed, before)
    fitted = None if refit is None else refit.fit
    estimates = screened_estimates(scored) if fitted is None else fitted_estimates(scored, fitted)
    leaders = tuple(
        candidate.name for candidate in supported[:1] if scored.name in diagnosis.equivalent[candidate.name]
    )
    equivalent = leaders or (diagnosis.equivalent[scored.name] if scored in supported else ())
    verdict = Support.NO_EVIDENCE
    of_tip = refit is not None or not diagnosis.data.several_kinds  # else of all that was measured, weighted
    errors = (rms, before.rms) if of_tip else ()
    none = ReasonKind.UNCONFIRMED if confirmed.refused else ReasonKind.CHANCE
    other = Reason(ReasonKind.BEHIND if supported else none)
    reason = Reason(ReasonKind.REFUSED, errors[:1], because=confirmed.refused.get(scored.name, other))
    claim = None
    if equivalent or scored in supported:
        claim = claim_of(scored, estimates, fitted, diagnosis.fit.equilibrium)
        verdict = Support.INDISTINGUISHABLE if equivalent else Support.SUPPORTED
        reason = Reason(ReasonKind.EXPLAINS, errors[::-1], (scored.name, *equivalent), claim)
    elif scored.implausible:
        reason = scored.implausible
    elif rms > (1.0 - MIN_GAIN) * before.rms:
        reason = Reason(ReasonKind.LITTLE, errors)
    if function := diagnosis.unexplained.spurious.get(scored.name):
        reason = Reason(ReasonKind.RESEMBLES, subject=function)
    deployed = without = None
    if refit is not None and scored is confirmed.first:
        deployed = _deployed(refit, diagnosis.data)
        rows = rows_as_deployed(refit.fit.model, diagnosis.data.poses)
        without = error_stats(deployed_residual(confirmed.blocks)[rows])
    return RankedCandidate(scored, verdict, rms, fitted, estimates, equivalent, claim, reason, deployed, without)
