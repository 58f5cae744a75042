"""What is to be made of a candidate of a diagnosis: one label of it for terminal, page, report and JSON."""

from __future__ import annotations

from enum import StrEnum

from lrm_ident.diagnosis.attribution import attribution_of
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.report.diagnosis.cause_facts import explains_part
from lrm_ident.report.step_card import AS_WELL


class Standing(StrEnum):
    """Labels, in the order of a list."""

    FOUND = "identified cause"
    CANDIDATE = "candidate cause"
    EMPIRICAL = "empirical term"
    LIKE = "indistinguishable"
    BESIDE = "missing, too"
    IMITATES = "imitates the first, with more parameters"
    AS_WELL = "explains it as well"
    PARTLY = "explains part of it"
    NOTHING = "no evidence"
    REFUSED = "cannot be the cause"


FIRST = {Support.FINDING: Standing.FOUND, Support.DESCRIPTION: Standing.EMPIRICAL}


def standing_of(report: DiagnosisReport, candidate: RankedCandidate) -> Standing:
    """The label of one of a report's candidates."""
    first = report.ranking[0]
    if candidate.verdict != Support.NO_EVIDENCE:
        attribution = attribution_of(report) if candidate is first else None
        if attribution != Support.DESCRIPTION and candidate.verdict == Support.INDISTINGUISHABLE:
            return Standing.LIKE
        if attribution is not None:
            return FIRST.get(attribution, Standing.CANDIDATE)
        return Standing.EMPIRICAL if candidate.effect.is_free_form else Standing.BESIDE
    if candidate.scored.implausible or candidate.name in report.diagnosis.unexplained.spurious:
        return Standing.REFUSED
    if first.verdict == Support.NO_EVIDENCE:
        return Standing.NOTHING
    if candidate.held_out_rms > (1.0 + AS_WELL) * first.held_out_rms:
        return Standing.PARTLY if explains_part(candidate.held_out_rms, report.held_out.rms) else Standing.NOTHING
    return Standing.IMITATES if len(candidate.estimates) > len(first.estimates) else Standing.AS_WELL
