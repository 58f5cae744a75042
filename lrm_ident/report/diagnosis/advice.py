"""The advice after a diagnosis: which poses would distinguish its candidate causes, or that none would."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from lrm_ident.design.advice import Advice, advise, advise_beside
from lrm_ident.design.expected_lead import CandidateCause
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_math.effects import Effect, variants

MOST_CAUSES = 4
"""That poses are sought for, the best first."""
BY_ORDER = frozenset({"time", "session"})
"""What only the order of measuring can tell, and no choice of poses; but a memory shows where poses are held."""


def causes_of(assessment: Assessment) -> Sequence[str]:
    """Candidate causes (`effect@place`) that poses to be measured could distinguish; the effect to add is the first, or
    the first of the model that may be another one."""
    effects, first = effects_of(assessment.report), assessment.first
    if first is None:
        name, others = next(iter(assessment.unsure.items()), ("", ())) if assessment.quiet else ("", ())
        names = [candidate for candidate in (name, *others) if candidate in effects]
        remembers = any(effects[cause].remembers for cause in names)
        causes = [cause for cause in names if remembers or _by_poses(effects[cause])][:MOST_CAUSES]
        return causes if causes[:1] == [name] else ()
    stands_for = (first.name,) if assessment.term is None else variants(first.effect)
    named = dict.fromkeys((*stands_for, *first.equivalent))
    return [name for name in named if name in effects and _by_poses(effects[name])][:MOST_CAUSES]


def _by_poses(effect: Effect) -> bool:
    """Whether a choice of poses can tell of it, or how long they are held."""
    return effect.remembers or BY_ORDER.isdisjoint(effect.depends_on)


def effects_of(report: DiagnosisReport) -> dict[str, Effect]:
    """The effects that were screened or are in the model, by their names."""
    screened = {scored.name: scored.candidate.effect for scored in report.diagnosis.scored}
    return screened | {effect.name: effect for effect in report.diagnosis.fit.model.effects}


@lru_cache(maxsize=1)
def advice_of(report: DiagnosisReport) -> Advice | None:
    """The advice of a diagnosis, computed once; None where it leaves nothing to distinguish."""
    names = causes_of(Assessment.of(report))
    if len(names) < 2:
        return None
    diagnosis = report.diagnosis
    measured, first = diagnosis.screening.subset[1].poses, report.first
    if first is None:
        present, *rivals = (effects_of(report)[name] for name in names)
        return advise_beside(diagnosis.fit.model, present, rivals, measured, _noise(diagnosis, diagnosis.fit))
    scored = {candidate.name: candidate.scored for candidate in report.ranking}
    to_explain = float(np.linalg.norm(first.scored.added))
    causes = [CandidateCause.found(scored[name], to_explain) for name in names]
    noise = _noise(diagnosis, first.fit or diagnosis.fit)
    return advise(diagnosis.fit.model, causes, measured, noise)


def _noise(diagnosis: Diagnosis, fit: Fit) -> float:
    """Noise (m per axis), known or as a fit leaves it."""
    return diagnosis.floor.sd or fit.sigma
