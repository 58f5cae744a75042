"""What a diagnosis leaves of a model, as values: the effect to add and what it shows, and what the model has already.

Headline, facts, next steps and advice are all drawn from these; none of them is words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from lrm_ident.diagnosis.attribution import attribution_of
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_math.effects import CATALOGUE, Effect


@dataclass(frozen=True, eq=False)
class Assessment:
    """Where a diagnosis leaves a model. Of `cause` and `term` at most one is there; none where nothing is to be added.

    Attributes:
        cause: the effect to add, where it is the cause or may be. identified: whether it is shown to be.
        term: the effect to add, where it only describes the error.
        causes: those that the model has already, by their names. terms: names of the empirical terms that it has.
        unsure: effects of the model that may be another one, which it has not, and which.
    """

    report: DiagnosisReport
    cause: RankedCandidate | None
    identified: bool
    term: RankedCandidate | None
    causes: Mapping[str, Effect]
    terms: Sequence[str]
    unsure: Mapping[str, Sequence[str]]

    @classmethod
    def of(cls, report: DiagnosisReport) -> Self:
        """That of a report."""
        support = attribution_of(report)
        present = {effect.name: effect for effect in report.diagnosis.fit.model.effects}
        rivals = report.indistinguishable.items()
        absent = {
            name: [other for other in others if other not in present] for name, others in rivals if name in present
        }
        return cls(
            report=report,
            cause=report.first if support in (Support.POSSIBLE_CAUSE, Support.FINDING) else None,
            identified=support == Support.FINDING,
            term=report.first if support == Support.DESCRIPTION else None,
            causes={name: effect for name, effect in present.items() if _may_be_missing(effect)},
            terms=[name for name, effect in present.items() if effect.is_free_form],
            unsure={name: others for name, others in absent.items() if others},
        )

    @property
    def first(self) -> RankedCandidate | None:
        """The effect to add, whatever it shows."""
        return self.cause or self.term

    @property
    def quiet(self) -> bool:
        """Whether nothing was found to be missing."""
        return self.report.verdict.quiet


def _may_be_missing(effect: Effect) -> bool:
    """Whether an effect is one of the catalogue that not every model has."""
    return type(effect) in CATALOGUE and effect.id not in DEFAULT_EFFECTS
