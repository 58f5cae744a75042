"""All that is known of one model on one data set: what the workbench and the report show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import decimals, enumerate_words
from lrm_ident.diagnosis.attribution import StepAttribution, attribute_steps, term_of
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.fitting.typical_prior import TYPICAL
from lrm_ident.report.diagnosis.conclusion import LACKS, Conclusion
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_ident.report.document import Document, ResultTable
from lrm_ident.report.fit import comparison_document, estimate_table
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.plots.interactive.candidate_view import candidate_view
from lrm_ident.report.step_card import StepCard, of_data, step_cards
from lrm_ident.report.story import Story, story_of
from lrm_ident.report.text.next_steps import UNKNOWN_FILES, CommandNames
from lrm_ident.report.text.notices import prior_words
from lrm_ident.report.text.residuals import where
from lrm_ident.residual.better_prediction import takes_little
from lrm_ident.residual.covariates import Covariate
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.residual.gravity_loads import known_covariates
from lrm_ident.residual.picture.error_field import ErrorField, error_field
from lrm_ident.study.model_history import models_of_history
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.effects import marked
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import HistoryTable, ModelFile, to_model

POSES_SHOWN = 20
ERRORS = {"fit_rms_mm": "fit", "held_out_rms_mm": "held out", "deployed_rms_mm": "as deployed"}
"""Errors of a step in a model file, and their titles."""
HASH_SHOWN = 8
"""Digits of a data set's SHA-256 that are shown: enough to tell data sets of one person apart."""
CANDIDATES = 12


def data_of(entry: HistoryTable) -> str:
    """First digits of the SHA-256 of the data that a step's errors are of; "" where that is not known."""
    return "" if entry.provenance is None else entry.provenance.data_sha256[:HASH_SHOWN]


def done(entry: HistoryTable) -> str:
    """What a step did, in plain words: `fit`, `add backlash in joint 2`."""
    return f"{'add ' if entry.name.added else ''}{step_title(entry.name)}"


def history_table(file: ModelFile) -> ResultTable:
    """Every step of a model's history with its error in the fit and held out, and the data that these are of."""
    errors = [[getattr(entry, error) for error in ERRORS] for entry in file.history]
    spec = f".{decimals(*(value for row in errors for value in row if value))}f"
    rows = [
        (number, done(entry), *row, data_of(entry))
        for number, (entry, row) in enumerate(zip(file.history, errors, strict=True))
    ]
    columns = ["|", "step", *(f"{title} RMS mm|{spec}" for title in ERRORS.values()), "data (SHA-256)|"]
    if any(entry.deployed_poses for entry in file.history):
        columns.append("deployed: of poses|")
        rows = [(*row, entry.deployed_poses or "all") for row, entry in zip(rows, file.history, strict=True)]
    return ResultTable(columns, rows, "Steps")


def history_values(file: ModelFile) -> list[dict[str, object]]:
    """History for JSON, unrounded."""
    return [
        {
            "step": str(entry.name),
            "indistinguishable_from": entry.indistinguishable,
            **entry.model_dump(include={*ERRORS, "deployed_poses"}),
            "data_sha256": None if entry.provenance is None else entry.provenance.data_sha256,
        }
        for entry in file.history
    ]


def provenance_table(file: ModelFile) -> ResultTable:
    """Provenance of a model: data, tool, date, how it was fitted."""
    provenance = file.provenance
    said: dict[str, object] = {"arm": file.arm, "effects": ", ".join(map(marked, file.effects))}
    if provenance is not None:
        reading = {} if provenance.reading is None else provenance.reading.said()
        said |= {
            "data": provenance.data,
            "SHA-256 of the data": provenance.data_sha256,
            "SHA-256 of the arm": provenance.arm_sha256,
            "poses fitted": str(provenance.poses),
            "loss": provenance.loss,
            "tool": provenance.tool,
            "date": provenance.date,
            "prior": provenance.prior,
            "poses left out": enumerate_words(list(map(str, provenance.left_out)), POSES_SHOWN) or None,
            **{f"read with {name}": str(value) for name, value in reading.items()},
            "effects file": provenance.effects_file,
            "its SHA-256": provenance.effects_sha256,
        }
    rows = [(what, value) for what, value in said.items() if value is not None]
    return ResultTable(("what", "value"), rows, "Where the model comes from")


@dataclass(frozen=True, eq=False)
class ModelReport:
    """A model on measurements, as plain values that go between processes.

    Attributes:
        file: the model with its history. poses: the drawn poses of the measurements; `field` says of how many.
        field: the error field of every step. covariates: what errors may follow, at the drawn poses.
        comparison, diagnosis: what the commands of these names print; None as long as they are not done.
        candidates: the best ones beside the data (`candidate_view`), in the order of the ranking.
        marked: numbers of the poses to look at, by why: worst, outliers, far poses, regimes of larger error.
        cards: of the steps after the first. judged: by number of the step, the verdict that came after it.
    """

    file: ModelFile
    poses: Measurements
    field: ErrorField
    covariates: tuple[Covariate, ...]
    parameters: ResultTable
    comparison: Document | None = None
    diagnosis: Document | None = None
    candidates: tuple[Mapping[str, Any], ...] = ()
    marked: Mapping[str, tuple[int, ...]] | None = None
    cards: tuple[StepCard, ...] = ()
    judged: Mapping[int, str] | None = None

    @property
    def verdict(self) -> str:
        """The diagnosis's verdict in words; nothing as long as there is none."""
        return "" if self.conclusion is None else self.conclusion.headline

    @property
    def conclusion(self) -> Conclusion | None:
        """The diagnosis's conclusion, where there is one."""
        return None if self.diagnosis is None else cast(Conclusion, self.diagnosis.values["conclusion"])

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Labelled facts of the conclusion, how often the effects were chosen again, and what these poses lack.

        A diagnosis is of a model with typical sizes as prior: what it shows of a fit with another one is said.
        """
        if self.conclusion is None:
            return ()
        again, provenance = self._fall, self.file.provenance
        prior = None if provenance is None else provenance.prior
        other = [] if prior in (None, TYPICAL) else [("prior", prior_words(str(prior)))]
        lack = [(LACKS, "; ".join(self.conclusion.reasons))] if self.conclusion.reasons else []
        return (*self.conclusion.facts, *other, *(() if again is None else again.certainty), *lack)

    @property
    def floor_mm(self) -> float | None:
        """RMS of the noise floor, where a diagnosis knows one."""
        floor = None if self.diagnosis is None else self.diagnosis.values["noise_floor_rms_mm"]
        return floor if isinstance(floor, float) else None

    @property
    def attributions(self) -> tuple[StepAttribution | None, ...]:
        """What the step of every card shows; of errors that are not held out, only that it shows no cause.

        None of a step that added nothing.
        """
        floor, story = self.floor_mm or 0.0, self._fall
        if self.diagnosis is None or story is None or not story.held_out:
            no_cause = StepAttribution(Support.DESCRIPTION, 0.0)
            return tuple(no_cause if card.evidence.describes else None for card in self.cards)
        misspecified, steps = cast(tuple[str, ...], self.diagnosis.values["misspecified"]), []
        for card, fall in zip(self.cards, story.later, strict=True):
            if card.adds:
                describes = card.evidence.describes or takes_little(fall.rms_mm, fall.before_rms_mm, floor)
                evidence = replace(card.evidence, describes=describes, misspecified=card.name in misspecified)
                steps.append((fall.explained, evidence))
        shown = iter(attribute_steps(steps, float(str(self.diagnosis.values["unexplained_mean_square_mm2"]))))
        return tuple(next(shown) if card.adds else None for card in self.cards)

    @property
    def story(self) -> Story | None:
        """How the error fell on these data; None of a model without a history."""
        shown = zip(self.cards, self.attributions, strict=True)
        kinds = {card.number: term_of(is_.kind, card.evidence.equivalent) for card, is_ in shown if is_ is not None}
        return None if self._fall is None else self._fall.showing(kinds)

    @property
    def _fall(self) -> Story | None:
        """The story before the diagnosis says what its steps show."""
        if not self.file.history:
            return None
        held = [
            entry.held_out_rms_mm if of_data(entry, self.poses.source.sha256) else None for entry in self.file.history
        ]
        here = [field_step.error.rms * 1e3 for field_step in self.field.steps]
        nominal = error_stats(self.field.nominal_residual).rms * 1e3
        bound = None if self.diagnosis is None else cast(float | None, self.diagnosis.values["noise_bound_rms_mm"])
        return story_of(self.file.history, held, here, nominal, self.floor_mm, bound)

    def document(self) -> Document:
        """Values of `lrm-ident report`, schema `lrm/report/2`: those of `compare` and `diagnose`, and the history."""
        values = {
            "comparison": None if self.comparison is None else self.comparison.values,
            "diagnosis": None if self.diagnosis is None else self.diagnosis.values,
            "story": self.story,
            "history": history_values(self.file),
            "parameters": self.file.parameters,
            "sigma": self.file.sigma,
            "provenance": None if self.file.provenance is None else self.file.provenance.model_dump(exclude_none=True),
        }
        return Document([], "lrm/report/2", values)


def models_of_steps(study: Study) -> list[tuple[str, Model]]:
    """The model after each step of a study's history, by its name. Raises `FileError`."""
    steps, arm = models_of_history(study.file), study.model.arm
    return [(name, to_model(study.data.source.path, step_model, arm, study.catalogue)) for name, step_model in steps]


def models_on_data(study: Study) -> list[tuple[str, Model]]:
    """The same, each as far as it applies to the study's data (`model_for_data`)."""
    path, sha256 = study.data.source.path, study.data.source.sha256
    return [(name, model_for_data(step_model, path, sha256)[0]) for name, step_model in models_of_steps(study)]


def quick_report(study: Study) -> ModelReport:
    """Report that costs no refit: error field and parameters. Raises `FileError`, `NoEquilibrium`."""
    file, model, data = study.file, study.model, study.data
    models = models_of_steps(study)
    arrows = error_field(data, models_on_data(study))
    rest = solve_equilibrium(model, data.poses)
    drawn = tuple(covariate.take(arrows.rows) for covariate in known_covariates(data, rest))
    return ModelReport(
        file=file,
        poses=data.take(arrows.rows),
        field=arrows,
        covariates=drawn,
        parameters=estimate_table(models[-1][1], file.sigma, rest=rest),
        cards=tuple(step_cards(file, [step_model for _, step_model in models], arrows, drawn, rest)),
    )


def after_step(report: ModelReport, before: ModelReport) -> ModelReport:
    """A report of a model after a step from another, whose verdict is kept beside the step."""
    return replace(report, judged={**(before.judged or {}), len(before.file.history) - 1: before.verdict})


def with_comparison(report: ModelReport, compared: ModelComparison) -> ModelReport:
    """Adds the result of `compare`."""
    worst = tuple(int(compared.data.pose[row]) for row in compared.worst)
    marked = {**(report.marked or {}), "worst": worst}
    return replace(report, comparison=comparison_document(compared), marked=marked)


def with_diagnosis(
    model_report: ModelReport, report: DiagnosisReport, names: CommandNames = UNKNOWN_FILES
) -> ModelReport:
    """Adds the result of `diagnose`. `names`: of the files in the commands to copy."""
    diagnosis = report.diagnosis
    fitted, data = diagnosis.screening.subset
    row_of = {number: row for row, number in enumerate(data.pose.tolist())}
    rows = np.array([row_of.get(number, -1) for number in model_report.poses.pose.tolist()])
    known = known_covariates(data, fitted.equilibrium)
    views = tuple(candidate_view(candidate, diagnosis, known, rows) for candidate in report.ranking[:CANDIDATES])
    numbers = diagnosis.data.pose
    regimes = {
        f"regime {where(regime)}": tuple(report.patterns.pose[regime.rows].tolist())
        for regime in report.patterns.regimes
    }
    far = tuple(int(numbers[row]) for row in report.far_rows)
    marked = {**(model_report.marked or {}), "outliers": diagnosis.outliers, "far poses": far, **regimes}
    return replace(model_report, diagnosis=diagnosis_document(report, names), candidates=views, marked=marked)
