"""The advice after a diagnosis: which poses would distinguish its candidate causes, or that none would."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from lrm_ident.design.advice import Advice, advise
from lrm_ident.design.expected_lead import CandidateCause
from lrm_ident.diagnosis.attribution import attribution_of
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.judgement import Support
from lrm_math.effects import variants

MOST_CAUSES = 4
"""That poses are sought for, the best first."""
BY_ORDER = frozenset({"time", "session"})
"""What only the order of measuring can tell, and no choice of poses; but a memory shows where poses are held."""


def causes_of(report: DiagnosisReport) -> Sequence[str]:
    """Candidate causes (`effect@place`) that poses to be measured could distinguish; the effect to add is the first."""
    first, attribution = report.first, attribution_of(report)
    if first is None or attribution is None:
        return ()
    effects = {one.name: one.effect for one in report.ranking}
    known = {name for name, one in effects.items() if one.remembers or BY_ORDER.isdisjoint(one.depends_on)}
    stands_for = variants(first.effect) if attribution == Support.DESCRIPTION else (first.name,)
    return [name for name in dict.fromkeys((*stands_for, *first.equivalent)) if name in known][:MOST_CAUSES]


@lru_cache(maxsize=1)
def advice_of(report: DiagnosisReport) -> Advice | None:
    """The advice of a diagnosis, computed once; None where it leaves nothing to distinguish."""
    names = causes_of(report)
    if len(names) < 2:
        return None
    diagnosis = report.diagnosis
    scored = {one.name: one.scored for one in report.ranking}
    first = report.first
    to_explain = 0.0 if first is None else float(np.linalg.norm(first.scored.added))
    refit = None if first is None else first.fit
    noise = diagnosis.floor.sd or (diagnosis.fit if refit is None else refit).sigma
    causes = [CandidateCause.found(scored[name], to_explain) for name in names]
    return advise(diagnosis.fit.model, causes, diagnosis.screening.subset[1].poses, noise)
