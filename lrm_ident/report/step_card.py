"""Cards of the steps that were taken: what each found, how sure, how far the error fell, and what else it could be."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import arrow, in_mm
from lrm_ident.diagnosis.claim import with_unit
from lrm_ident.diagnosis.contradiction import can_be_contradicted
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.report.diagnosis.conclusion import Conclusion
from lrm_ident.report.document import Document
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.plots.interactive.group_means import explained_by_means, joints_of, of_law, shown_most
from lrm_ident.residual.better_prediction import share_of_excess
from lrm_ident.residual.covariates import Covariate
from lrm_ident.residual.picture.error_field import ErrorField
from lrm_math.arrays import Array
from lrm_math.effects import FREE_FORMS, Effect, EffectRef, variants
from lrm_math.model.model import Model
from lrm_math.model.model_file import HistoryTable, ModelFile

RIVALS_KEPT = 4
AS_WELL = 0.05
"""Share of an effect's error by which another that explains as much may leave more."""


@dataclass(frozen=True)
class EarlierDiagnosis:
    """Diagnosis of a model before a step was taken: its verdict, and the sentence on every candidate by its name."""

    verdict: str
    why: Mapping[str, str]


@dataclass(frozen=True)
class ErrorFall:
    """Fall of the RMS error in a step (mm), on the open data; `held_out`: on poses that no fit has seen."""

    before: float
    after: float
    held_out: bool

    def share_of_excess(self, floor: float | None) -> float | None:
        """Share of the mean square above the noise floor (mm) that the step took away; None where that is not known."""
        if floor is None or self.before <= floor:
            return None
        return float(np.clip(share_of_excess(self.after, self.before, floor), 0.0, 1.0))

    @property
    def words(self) -> str:
        """Both errors, in mm."""
        return arrow(self.before * 1e-3, self.after * 1e-3)

    @property
    def explained(self) -> float:
        """Mean square (mm²) that the step took away."""
        return self.before**2 - self.after**2


@dataclass(frozen=True)
class StepCard:
    """Record of a step that was taken.

    Attributes:
        number: of the step in the history. name: `effect@place`, or the step's own. title: the same in plain words.
        claim: the sentence with its estimates. estimate: the one number of an effect that has one, else "".
        estimates: all of them. joint: from 0, driver: name of the covariate, that its motion follows.
        evidence: for it. It only describes if it is a form of other effects, or these angles could not contradict its
            formula.
    """

    number: int
    name: str
    title: str
    claim: str
    estimate: str
    estimates: tuple[str, ...]
    joint: int
    driver: str
    evidence: Evidence

    def unrivalled(self, after: float) -> bool:
        """Whether no other effect alone would have left about as little as was left `after` the step (mm, held out)."""
        if self.evidence.rivals is None or self.evidence.equivalent:
            return False
        return all(left * 1e3 > (1.0 + AS_WELL) * after for left in self.evidence.rivals.values())


def judgement(diagnosis: Document) -> EarlierDiagnosis:
    """Record of a diagnosis once an effect has been added."""
    ranking: Sequence[Mapping[str, str]] = diagnosis.values["ranking"]  # type: ignore[assignment]
    why = {str(EffectRef(one["effect"], one["place"])): str(one["why"]) for one in ranking}
    return EarlierDiagnosis(cast(Conclusion, diagnosis.values["conclusion"]).headline, why)


def rivals(card: StepCard, judged: EarlierDiagnosis | None) -> tuple[tuple[str, str], ...]:
    """The effects that came next to a step's own, and why they were not taken; with what could not be told apart first.

    Without a judgement it is known what these alone would have left, of steps that kept it.
    """
    why = _alone(card.evidence.rivals or {}) if judged is None else judged.why
    names = dict.fromkeys((*card.evidence.equivalent, *why))
    others = [name for name in names if name != card.name][:RIVALS_KEPT]
    return tuple((name, why.get(name, "these poses cannot distinguish it")) for name in others)


def _alone(rivals: Mapping[str, float]) -> dict[str, str]:
    free = {kind.id for kind in FREE_FORMS}
    curve = {
        name: "; a smooth curve (spline), with more parameters" if EffectRef.parse(name).id in free else ""
        for name in rivals
    }
    return {name: f"alone it would have left {in_mm(left)} mm{curve[name]}" for name, left in rivals.items()}


def error_fall(file: ModelFile, field: ErrorField, number: int, sha256: str) -> ErrorFall:
    """Fall in a step.

    Held out where both errors are of the open data, else of the models as they are on these.
    """
    if len(file.history) == len(field.steps) and number > 0:
        before, after = file.history[number - 1], file.history[number]
        if before.held_out_rms_mm and after.held_out_rms_mm and of_data(before, sha256) and of_data(after, sha256):
            return ErrorFall(before.held_out_rms_mm, after.held_out_rms_mm, held_out=True)
    start = field.steps[number - 1].error.rms if number else error_stats(field.nominal_residual).rms
    return ErrorFall(start * 1e3, field.steps[number].error.rms * 1e3, held_out=False)


def of_data(entry: HistoryTable, sha256: str) -> bool:
    """Whether a step's errors are of the data with this hash."""
    return entry.provenance is not None and entry.provenance.data_sha256 == sha256


def step_cards(
    file: ModelFile, models: Sequence[Model], field: ErrorField, known: Sequence[Covariate], q: Array
) -> tuple[StepCard, ...]:
    """A card for every step after the first. `known`: covariates at the drawn poses. `q`: (N, n), commands (rad)."""
    present = {effect.name for effect in models[-1].effects}
    return tuple(
        _card(number, file.history[number], models[number - 1 : number + 1], field, known, present, q)
        for number in range(1, len(file.history))
    )


def _card(
    number: int,
    entry: HistoryTable,
    models: Sequence[Model],
    field: ErrorField,
    known: Sequence[Covariate],
    present: Collection[str],
    q: Array,
) -> StepCard:
    before, after = ({effect.name: effect for effect in model.effects} for model in models)
    added = [effect for name, effect in after.items() if name not in before]
    numbers = {name: words for effect in added for name, words in _estimates(effect, entry).items()}
    evidence = Evidence(
        tuple(entry.indistinguishable),
        rivals=None if entry.rivals_mm is None else {name: left * 1e-3 for name, left in entry.rivals_mm.items()},
        of_present=any(name in present for effect in added for name in variants(effect)),
        describes=any(effect.is_free_form or not can_be_contradicted(effect, q) for effect in added),
    )
    free = sum(key in entry.sigma for effect in added for key in effect.keys)
    followed = of_law(added[0], known) if added else known
    joint, driver = _shown(added[0].place if added else "", field, number, followed)
    return StepCard(
        number=number,
        name=entry.name.added or str(entry.name),
        title=_capital(step_title(entry.name)),
        claim=_claim(added, numbers),
        estimate=next(iter(numbers.values())) if free == 1 else "",
        estimates=tuple(f"{name} = {words}" for name, words in numbers.items()),
        joint=joint,
        driver=driver,
        evidence=evidence,
    )


def _shown(place: str, field: ErrorField, number: int, known: Sequence[Covariate]) -> tuple[int, str]:
    """The joint and the driver whose chart shows most of what a step took away; of an effect at a joint, that joint."""
    joints = joints_of(place, len(field.lever))
    before, after = field.steps[number - 1].turns, field.steps[number].turns
    taken = [
        explained_by_means(before, field.lever, one.values) - explained_by_means(after, field.lever, one.values)
        for one in known
    ]
    return shown_most(taken, known, joints) if known else (joints[0], "")


def _estimates(effect: Effect, entry: HistoryTable) -> dict[str, str]:
    """Numbers of an effect; none of what names no cause, of which none means anything alone."""
    if not effect.names_a_cause:
        return {}
    return {
        parameter.name: with_unit(entry.parameters[key], entry.sigma.get(key), parameter.unit)
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
        if key in entry.parameters
    }


def _claim(added: Sequence[Effect], numbers: Mapping[str, str]) -> str:
    """The sentence of the effect that was added; nothing where several were."""
    if len(added) != 1 or not (sentence := added[0].about.claim):
        return ""
    words = {p.name: numbers.get(p.name, "0") for p in added[0].parameters}
    return _capital(sentence.format(place=added[0].place_in_words, **words))


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
