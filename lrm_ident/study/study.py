"""`Study`: a model on measurements of its arm, whose methods are the steps of an identification."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import NotebookPage, ShownInNotebook
from lrm_ident.data.weights.model_error import model_error_words
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.effect_plugins import Catalogue, catalogue_with
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED, Loss, loss_named
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, fit_bounds, fit_model, nominal_model
from lrm_ident.fitting.parameter_sets import default_keys
from lrm_ident.fitting.priors import EffectRates, load_prior, prior_name_for
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.fitting.typical_prior import TYPICAL
from lrm_ident.residual.deployment.deployable import deployable
from lrm_ident.residual.error_breakdown import ModelComparison, NestedResidual
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_ident.study.arguments import arm_named, effect_named, measurements_of, names_of
from lrm_ident.study.model_history import as_written, model_file, undo_step, write_model
from lrm_ident.study.model_on_data import ModelOnData
from lrm_ident.study.notices import Notice, NoticeKind, as_read
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.parameter_estimates import ParameterEstimate, parameter_estimates
from lrm_math.effects import CATALOGUE, ParameterRef, effects_at
from lrm_math.effects.memory import assumed_steps
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import named_part
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, to_model
from lrm_math.model.step_name import ADD, FIT, FREE, REFIT, StepName

if TYPE_CHECKING:  # loaded by the steps that need them: a fit does without
    from lrm_ident.diagnosis.auto import AutoRun
    from lrm_ident.diagnosis.candidate_trial import Refit
    from lrm_ident.diagnosis.diagnose import Diagnosis
    from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
    from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal
    from lrm_ident.study.transfer import Transfer


SUMMARY = "lrm_ident.report.summary"
"""The module above that writes a summary; it is looked up when a person asks, and not before."""


@dataclass(frozen=True, eq=False)
class Study(ModelOnData, ShownInNotebook):
    """A model on measurements of its arm, and the steps that led to it.

    Attributes:
        before: the study before the last step.
        notices: what a user should know of the files and the steps.
    """

    before: Study | None = None
    notices: tuple[Notice, ...] = ()

    def __repr__(self) -> str:
        steps, count = ", ".join(self._steps) or "nothing is fitted yet", len(self.model.free)
        return f"<Study of {self.model.arm.name}: {steps}; {count} free parameters, {len(self.data)} poses>"

    @staticmethod
    def of(
        data: Measurements,
        effects: str | Sequence[str] = DEFAULT_EFFECTS,
        catalogue: Catalogue | str | Path = CATALOGUE,
        progress: Progress = silent,
    ) -> Study:
        """The nominal arm of measurements, with these effects (`id` or `id@place`) at zero: nothing is fitted yet.

        `catalogue`: all effects, or a file with one's own. Raises `LrmError`: no arm, or an unknown effect.
        """
        arm = measurements_of(data).source.arm
        if arm is None:
            raise LrmError(f"{data.source.path}: no arm; give measurements that were loaded with one")
        effects_known = catalogue_with(catalogue) if isinstance(catalogue, str | Path) else catalogue
        model = nominal_model(arm, names_of(effects), effects_known)
        return Study(model, data, data.source.arm_name or arm.name, effects_known, progress=progress)

    def fit(
        self,
        parameters: str | Sequence[str] = "identifiable",
        loss: Loss | str = SQUARED,
        prior: str | None = None,
        unbounded: bool = False,
    ) -> Study:
        """Fits the model anew; arguments as of `fit_model`; `loss` or its name, `prior`: name of a shipped one or path.

        Raises `LrmError`: unknown names, too few poses, no convergence, or no identifiable parameter.
        """
        loss = loss_named(loss) if isinstance(loss, str) else loss
        stated_prior = None if prior is None else load_prior(prior, self.model, self.catalogue)
        result = fit_model(
            named_part(self.model), self.data, ",".join(names_of(parameters)), loss, unbounded, stated_prior
        )
        name = None if prior is None else prior_name_for(prior)
        bounds = fit_bounds(result.fit.model, unbounded)
        stated = deployable(result.fit, result.data)
        step = Step(StepName(FIT), stated, result.data, bounds=bounds, stated_prior=stated_prior, prior_name=name)
        notices = (*self.notices, *as_read(model_error_words(result.data)))
        return replace(self, loss=loss, notices=notices)._after(step, None)

    def screen(self, rates: EffectRates | None = None) -> Diagnosis:
        """Screens every effect at every place by the linearised fit, and finds outliers.

        Args:
            rates: frequency of each effect among arms of this kind, where known.
        """
        from lrm_ident.diagnosis.diagnose import diagnose

        study, tick = self.identifiable(), partial(self.progress, "trying every effect at every place")
        return diagnose(study.model, study.data, study.catalogue, tick, study.loss, rates)

    def diagnose(
        self,
        rates: EffectRates | None = None,
        screened: Diagnosis | None = None,
        compared: ModelComparison | None = None,
    ) -> DiagnosisReport:
        """Finds which effect the model misses.

        Args:
            screened, compared: results of `screen` and `compare`, where known already. Held-out errors are then those
                of the comparison, a picometre from those of a refit.
        """
        from lrm_ident.diagnosis.diagnosis_report import build_report

        comparison = compared if self.prior_name == TYPICAL else None
        report = build_report(screened or self.screen(rates), self._say, comparison)
        return replace(report, indistinguishable=self._indistinguishable, moved=self._moved(report.diagnosis.fit))

    def add(self, effect: str | RankedCandidate, screened: Diagnosis | None = None) -> Study:
        """Adds an effect (`id` or `id@place`) or candidate and refits everything, without the diagnosis's outliers.

        What names no cause is added by `add_field`, without a screening.

        Args:
            screened: result of `screen`; None: every effect is screened first. It states the outliers, where the
                effect's shape starts, and which others predict as well.

        Raises `LrmError`.
        """
        from lrm_ident.diagnosis.add_effect import add_effects

        effect = effect_named(effect)
        study = self.identifiable()
        added = effects_at(study.model.arm, effect, study.catalogue)
        if not all(each.names_a_cause for each in added):
            return self.add_field()
        diagnosis = screened or study.screen()
        names = tuple(each.name for each in added)
        shape = next((scored.shape for scored in diagnosis.scored if (scored.name,) == names), None)
        fitted = add_effects(study.model, diagnosis.data, added, shape, study.loss)
        left_out = Notice(NoticeKind.OUTLIERS, poses=tuple(diagnosis.outliers))
        notices = (*study.notices, left_out) if diagnosis.outliers else study.notices
        notices = (*notices, *as_read(assumed_steps(added, study.data.poses)))
        equivalent = diagnosis.equivalent.get(added[0].name, ()) if len(added) == 1 else ()
        before = study.held_out.error if diagnosis.data.several_kinds else None  # else as the screening has it
        rms_before = diagnosis.screening.linear.baseline.rms if before is None else before.rms
        evidence = Evidence(equivalent, diagnosis.rivals([*names, *equivalent], rms_before))
        step = Step(StepName(ADD, effect), fitted, diagnosis.data, study.model, evidence=evidence)
        return replace(study, notices=notices)._after(step, study)

    def add_field(self) -> Study:
        """Adds a residual field, or fits the present one anew: a function of the joint angles that names no cause.

        Raises `NoBetterPrediction` where the held-out error does not fall, `LrmError` without measured positions.
        """
        from lrm_ident.study.field_step import field_step

        study = self.named()
        step = field_step(study.model, study.data, study.loss, self.prior, partial(self.progress, "held-out error"))
        return study._after(replace(step, prior_name=self.prior_name), self)

    def auto(
        self,
        max_effects: int = MAX_EFFECTS,
        rates: EffectRates | None = None,
        on_step: Callable[[Step, Study], object] = lambda *_: None,
        on_confirmed: Callable[[Refit], object] = lambda _: None,
    ) -> tuple[AutoRun, Study]:
        """Diagnoses and adds effects until none is confirmed: the run, and the study after it.

        Args:
            on_step: called with the start, and with every step as soon as it is taken. on_confirmed: with the refit of
                an effect before the diagnosis with it, which its step waits for.
        """
        from lrm_ident.diagnosis.auto import run_auto

        study = latest = self.with_dimensions()

        def taken(step: Step) -> None:
            """Follows the run with a study."""
            nonlocal latest
            latest = study._after(step, latest)
            on_step(step, latest)

        tick = partial(self.progress, "looking for what is missing")
        run = run_auto(
            study.model, study.data, max_effects, study.catalogue, taken, study.loss, tick, rates, on_confirmed
        )
        if len(run.steps) > 1:
            latest = study._after(run.steps[-1], latest.before)
        return run, latest if latest._filed is None else latest.with_course(run, NestedResidual(None))

    def with_course(self, course: AutoRun, nested: NestedResidual) -> Study:
        """The study whose file also holds what the effects of a run are, and the nested held-out error."""
        from lrm_ident.study.course_table import with_course

        return replace(self, source=with_course(self.file, course, nested))

    def nested_held_out(
        self,
        executor: Executor,
        max_effects: int = MAX_EFFECTS,
        rates: EffectRates | None = None,
        left_out: Sequence[int] = (),
    ) -> NestedResidual:
        """Nested cross-validation: held-out residual of `auto`, effects selected anew in every fold, on an executor.

        `left_out`: numbers of the poses that `auto` left out, and at which it is not judged.
        """
        from lrm_ident.diagnosis.nested_cross_validation import nested_held_out

        study, tick = self.with_dimensions(), partial(self.progress, "choosing anew in every fold")
        return nested_held_out(
            study.model, study.data, executor, max_effects, study.catalogue, tick, study.loss, rates, left_out
        )

    def fit_all(self, prior: str) -> Study:
        """Fits all parameters of the model together with a prior (name or path). Raises `LrmError`."""
        start = named_part(self._fitted)
        stated_prior = load_prior(prior, start, self.catalogue)
        result = deployable(fit_model(start, self.data, "identifiable", self.loss, prior=stated_prior).fit, self.data)
        name = StepName(REFIT, stated_prior.name)
        step = Step(name, result, self.data, start, stated_prior=stated_prior, prior_name=prior_name_for(prior))
        return self._after(step, self)

    def transfer(self, to: str | Path, data: Measurements | None = None) -> Transfer:
        """Takes the arm's part of the model to another installation of the arm, identified from a few poses there.

        Args:
            to: name of a shipped arm or path of an arm file; only its base, tool, gravity and limits may differ.
            data: the few poses; None: the installation is the arm file's nominal one.

        Raises `LrmError`: another arm, or nothing is fitted yet.
        """
        from lrm_ident.study.transfer import identified, transfer_of

        arm_part = transfer_of(self.file, self.model, self.covariance, arm_named(to))
        return arm_part if data is None else identified(arm_part, measurements_of(data))

    def propose(self) -> LawProposal:
        """Proposes a law where no known effect fits, by symbolic regression at every joint."""
        from lrm_ident.diagnosis.symbolic_regression.proposal import propose_law

        study, tick = self.identifiable(), partial(self.progress, "trying every law at every joint")
        return propose_law(study.model, study.data, tick, self._say, study.loss)

    def undo(self) -> Study:
        """Takes the last step back. Raises `LrmError` if there is none."""
        filed = self._filed
        before = None if filed is None or filed.before is None else filed.before._filed
        if before is not None:
            return before
        file = undo_step(self.file)
        of = self.data.source
        model = to_model(of.path, file, self.model.arm, self.catalogue)
        return replace(self, model=model_for_data(model, of.path, of.sha256)[0], source=file, step=None)

    def _moved(self, judged: Fit) -> float:
        """RMS distance (m) of the positions that a fit's model predicts from those of the model that is saved."""
        saved = self if self._filed is None else self._filed
        before, rows = batch_equilibrium(named_part(saved.model), judged.equilibrium.poses)
        return math.sqrt(np.mean(np.sum((before.tcp - judged.equilibrium.tcp[rows]) ** 2, axis=1)))

    def identifiable(self) -> Study:
        """The study without a residual field, fitted with typical sizes as all steps are, not with another prior."""
        if self.prior_name in (None, TYPICAL):
            return self.named()
        model = named_part(self.model)
        fitted = fit_identifiable(model, self.data, model.free, self.loss).fit.model
        return self._instead(fitted, Notice(NoticeKind.OTHER_PRIOR, (self.prior_name,)))

    def with_dimensions(self) -> Study:
        """The study as a run of `auto` begins: as `identifiable`, with the offsets and compliances that its fit held.

        Every step fits those too. Where they are not fitted before it, what they explain looks like evidence for the
        effect that a step adds. Where they cannot be fitted, the model is as it was, and a notice says why.
        """
        study = self.identifiable()
        free, wanted = study.model.free, default_keys(study.model, study.data)
        held = tuple(key for key in wanted if key not in free and ParameterRef.parse(key).id in DEFAULT_EFFECTS)
        if not held or not free:
            return study
        dimensions = [key for key in study.model.keys if ParameterRef.parse(key).id in DEFAULT_EFFECTS]
        begin = study.model.with_values_of(dimensions, [0.0] * len(dimensions))  # what was fitted alone may be far off
        try:
            refitted = fit_identifiable(begin, self.data, [*free, *held], self.loss).fit
        except LrmError as error:
            return replace(study, notices=(*study.notices, Notice(NoticeKind.DIMENSIONS_KEPT, (*held, str(error)))))
        step = Step(StepName(FREE), deployable(refitted, self.data), self.data, study.model)
        notices = (*study.notices, Notice(NoticeKind.DIMENSIONS_HELD, held))
        return replace(study, notices=notices)._after(step, study)

    def named(self) -> Study:
        """The study without a residual field, which is no cause and may hide one."""
        model = named_part(self.model)
        if model is self.model:
            return self
        return self._instead(model, Notice(NoticeKind.FIELD_LEFT_OUT))

    @cached_property
    def file(self) -> ModelFile:
        """The model file, with the history of all steps. Raises `LrmError` if nothing was fitted or read."""
        filed = self._filed
        if filed is None:
            raise LrmError("nothing is fitted yet: there is no model to write")
        if filed is not self:
            return filed.file
        if self.source is not None:
            return self.source
        before = None if self.before is None else self.before._filed
        history, step = () if before is None else before.file.history, self.taken
        return model_file(
            step.fit,
            self.data,
            self.held_out,
            self.arm,
            step.name or StepName(FIT),
            history,
            step.file_prior,
            step.evidence,
        )

    def summary(self) -> str:
        """Summary of the model in some ten lines: how the error fell, its steps and parts."""
        return str(import_module(SUMMARY).summary_document(self.file, self.model).text())

    @property
    def parameters(self) -> dict[str, ParameterEstimate]:
        """Estimates of the last fit by key, in the units of the keys. Raises `LrmError` if nothing is fitted."""
        return parameter_estimates(self.taken.fit)

    def view(self) -> NotebookPage:
        """The page of `lrm-ident report` in a notebook: error field, diagnosis, cards of the steps."""
        return NotebookPage(self)

    def save(self, path: str | Path) -> None:
        """Writes the model file, which the command line and the daemon read. Raises `FileError`."""
        write_model(Path(path), self.file, self.arm)

    @property
    def _steps(self) -> tuple[str, ...]:
        """Names of the steps so far, as in the history of `file`."""
        if self.source is not None:
            return tuple(str(entry.name) for entry in self.source.history)
        before = () if self.before is None else self.before._steps
        return (*before, str(self.step.name)) if self.step is not None and self.step.name else before

    @property
    def _indistinguishable(self) -> dict[str, tuple[str, ...]]:
        """Of each effect that was added: those that the poses could not distinguish from it."""
        if self.source is not None:
            return {entry.name.added: tuple(entry.indistinguishable) for entry in self.source.history}
        before = {} if self.before is None else self.before._indistinguishable
        return before if self.step is None else before | {self.step.added: self.step.evidence.equivalent}

    @property
    def _filed(self) -> Study | None:
        """The last study, this one or before it, that has a model file of its own."""
        if self.source is not None or (self.step is not None and self.step.name):
            return self
        return None if self.before is None else self.before._filed

    def _instead(self, model: Model, notice: Notice) -> Study:
        """The study with another model before a step, and a notice of it."""
        return replace(self, model=model, source=None, step=None, before=self, notices=(*self.notices, notice))

    def _after(self, step: Step, before: Study | None) -> Study:
        """The study after a step, its model as read from its file, so that API and commands give the same results."""
        model = as_written(step.fit.model, self.arm)
        return replace(self, model=model, data=step.data, source=None, step=step, before=before)
