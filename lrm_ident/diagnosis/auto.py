"""`auto`: stepwise addition of confirmed effects, each followed by a new diagnosis, until none is confirmed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.diagnosis.attribution import StepAttribution, attribute_steps, term_of, unexplained_mean_square
from lrm_ident.diagnosis.candidate_trial import Refit
from lrm_ident.diagnosis.confirm import ConfirmedDiagnosis, confirm
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, report_of
from lrm_ident.diagnosis.evidence import NO_EVIDENCE, Evidence
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.reason import Reason
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.deployment.deployable import deployable
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_math.effects import CATALOGUE, Effect, variants
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.model.step_name import ADD, LEAVE_OUT, StepName


@dataclass(frozen=True, eq=False)
class AutoRun(ShownInNotebook):
    """A run of `auto`: its steps, and the confirmed diagnosis after the last one."""

    steps: tuple[Step, ...]
    confirmed: ConfirmedDiagnosis

    def __repr__(self) -> str:
        taken = ", ".join(step.added for step in self.steps if step.added) or "nothing added"
        return f"<Run of auto on {self.model.arm.name}: {taken}; {self.verdict}>"

    @property
    def model(self) -> Model:
        """The model after the last step."""
        return self.steps[-1].fit.model

    @property
    def diagnosis(self) -> Diagnosis:
        """The last diagnosis."""
        return self.confirmed.diagnosis

    @property
    def verdict(self) -> Verdict:
        """Verdict of the last diagnosis, as its report states it."""
        return self.report.verdict

    @cached_property
    def report(self) -> DiagnosisReport:
        """Report of the last diagnosis."""
        classes = {step.added: step.evidence.equivalent for step in self.steps if step.added}
        return replace(report_of(self.confirmed), indistinguishable=classes)

    @property
    def explained(self) -> tuple[float, ...]:
        """Held-out mean square (m²) that each step after the start took away, at the poses that it was chosen on."""
        return tuple(step.evidence.explained for step in self.steps[1:])

    @property
    def attributions(self) -> tuple[StepAttribution, ...]:
        """Attributions of the steps after the start: whether each shows a cause (mean squares in m²)."""
        present, misspecified = {effect.name for effect in self.model.effects}, self.report.misspecified
        evidence = [
            replace(
                step.evidence,
                of_present=bool(present & {*step.evidence.refines}),
                misspecified=step.added in misspecified,
            )
            for step in self.steps[1:]
        ]
        steps = list(zip(self.explained, evidence, strict=True))
        return attribute_steps(steps, unexplained_mean_square(self.report))


def run_auto(
    model: Model,
    data: Measurements,
    max_effects: int = MAX_EFFECTS,
    catalogue: Iterable[type[Effect]] = CATALOGUE,
    on_step: Callable[[Step], object] = lambda _: None,
    loss: Loss = SQUARED,
    progress: OnProgress = silent,
    rates: EffectRates | None = None,
    on_confirmed: Callable[[Refit], object] = lambda _: None,
) -> AutoRun:
    """Stepwise selection: diagnoses, adds the confirmed effect, and diagnoses again.

    An effect with which the model cannot be diagnosed is refused, and the next one is tried.

    Args:
        rates: how often arms of this kind have each effect, where that is known (`diagnose`).
        on_confirmed: called with the refit of an effect before the diagnosis with it, which its step waits for.

    Raises:
        LrmError: the first diagnosis fails.
    """
    kinds = tuple(catalogue)
    latest = confirm(diagnose(model, data, kinds, progress, loss, rates))
    refused: tuple[str, ...] = ()
    doubted: dict[str, Reason] = {}
    steps = [_start(model, latest)]
    on_step(steps[0])
    while latest.first is not None and latest.refit is not None and len(steps) <= max_effects:
        on_confirmed(latest.refit)
        effect, evidence, beside = latest.first.name, _evidence(latest, latest.first), latest.beside
        last, refit, poses, blocks = steps[-1].fit.model, latest.refit, latest.diagnosis.data.pose, latest.blocks
        # of the last step everything is stated as it is beside all effects
        doubted = doubted | latest.refused_as_deployed if len(steps) < max_effects else {}
        del latest  # a diagnosis holds the columns of every candidate: one at a time
        try:
            same_fit = refit.fit if np.array_equal(poses, data.pose) else None
            diagnosis = diagnose(refit.fit.model, data, kinds, progress, loss, rates, same_fit)
            same_blocks = refit.blocks if np.array_equal(diagnosis.data.pose, poses) else ()
            latest = confirm(diagnosis, same_blocks, refused=refused, tested=beside, doubted=doubted)
        except LrmError:  # no diagnosis with it: it is refused, and the steps before stay
            refused = (*refused, effect)
            latest = confirm(diagnose(last, data, kinds, progress, loss, rates), blocks, refused=refused)
            continue
        steps.append(_step(StepName(ADD, effect), evidence, last, latest, refit.fit))
        on_step(steps[-1])
    return _with_candidates(AutoRun(tuple(steps), latest))


def _with_candidates(run: AutoRun) -> AutoRun:
    """The run, whose last model states which of its effects are no identified causes."""
    terms = {
        step.added: term_of(attribution.kind, step.evidence.equivalent)
        for step, attribution in zip(run.steps[1:], run.attributions, strict=True)
    }
    *before, last = run.steps
    fit = last.fit
    if fit.model.within is None:
        return run
    stated_before = (name for name in fit.model.candidates if name not in terms)
    candidates = (*stated_before, *(name for name, term in terms.items() if term != "identified cause"))
    model = replace(fit.model, within=replace(fit.model.within, candidates=candidates))
    stated = replace(fit, model=model, equilibrium=replace(fit.equilibrium, model=model))
    return replace(run, steps=(*before, replace(last, fit=stated)))


def _evidence(before: ConfirmedDiagnosis, chosen: ScoredCandidate) -> Evidence:
    """What speaks for the effect that a diagnosis chose."""
    equivalent = before.diagnosis.equivalent[chosen.name]
    return Evidence(
        equivalent,
        rivals=before.rivals,
        refitted=tuple(name for name in before.rivals if name in before.refits),
        refines=variants(chosen.candidate.effect),
        explained=before.explained,
        share=before.share,
        describes=before.describes,
        replicates=before.replicates,
    )


def _start(model: Model, first: ConfirmedDiagnosis) -> Step:
    """The start of a run: the model as it is, or a step of its own where it was refitted without outliers."""
    if first.diagnosis.outliers:
        return _step(StepName(LEAVE_OUT), NO_EVIDENCE, model, first)
    return _step(None, NO_EVIDENCE, None, first)


def _step(
    name: StepName | None, evidence: Evidence, start: Model | None, after: ConfirmedDiagnosis, stated: Fit | None = None
) -> Step:
    """The step with the results of the diagnosis after it. `stated`: the fit before that, which is deployable."""
    fit, data = after.diagnosis.fit, after.diagnosis.data
    deployed = fit if fit is stated else deployable(fit, data)  # a diagnosis fits anew where it finds outliers
    held_out = HeldOutResidual(after.held_out, deployed=after.deployed)
    return Step(name, deployed, data, start, held_out=held_out, evidence=evidence)
