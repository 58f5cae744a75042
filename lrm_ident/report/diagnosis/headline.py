"""Headline of a conclusion: what is missing, or that nothing is found, in one sentence."""

from __future__ import annotations

from lrm_ident.data.wording import enumerate_words
from lrm_ident.diagnosis.contradiction import NoCause, why_no_cause
from lrm_ident.diagnosis.diagnosis_report import RankedCandidate
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.plain_names import enumerate_effects, plain_name, with_id
from lrm_ident.report.text.verdicts import (
    CHANGES,
    HEADLINES,
    LEFT,
    MISSING,
    NONE_FOUND,
    NOT_IDENTIFIED,
    WHY_NO_CAUSE,
    WHY_NOT,
)
from lrm_math.effects import variants
from lrm_math.model.deployed_model import CORRECTED, on_rover

LISTED, NAMED = 4, 2


def headline(assessment: Assessment) -> str:
    """The headline of a conclusion."""
    if assessment.term is not None:
        return _of_term(assessment, assessment.term)
    if assessment.quiet:
        return _quiet(assessment)
    if assessment.cause is None:
        return _not_identified(assessment, WHY_NOT[assessment.report.verdict])
    what = with_id(assessment.cause.name)
    if not assessment.identified:
        return f"An effect is missing from the model. The best candidate: {what}"
    rivals = ", or another that these poses cannot distinguish from it" if assessment.cause.equivalent else ""
    return f"{MISSING}: {what}{rivals}"


def _not_identified(assessment: Assessment, why: str) -> str:
    """That no cause was identified: for what the causes leave that the model has already, if it has any."""
    return f"{NOT_IDENTIFIED}{' for the remaining error' if assessment.causes else ''}: {why}"


def _quiet(assessment: Assessment) -> str:
    """That nothing more is missing; what the model has already stands first, and whether it may be another cause.

    A diagnosis does not know how certain the steps before it were, so it does not call what it meets found.
    """
    causes, verdict = assessment.causes, assessment.report.verdict
    changes = assessment.report.deployed.among_measured is not None
    rest_words = f", {CHANGES}" if changes else f"; {LEFT[verdict]}"
    if not causes and assessment.terms:
        what = enumerate_effects(assessment.terms, NAMED)
        corrects = "an empirical term, corrects" if len(assessment.terms) == 1 else "empirical terms, correct"
        return f"{NOT_IDENTIFIED}; {what}, {corrects} the error{rest_words}"
    if not causes:
        return f"{NONE_FOUND} in this session, {CHANGES}" if changes else HEADLINES[verdict]
    unsure = assessment.unsure
    it = "it" if len(causes) == 1 else "them" if len(unsure) == len(causes) else enumerate_effects(unsure, NAMED)
    other = f", or another cause that these poses cannot distinguish from {it}" if unsure else ""
    all_corrected = all(on_rover(effect) in CORRECTED for effect in causes.values())
    return f"{'Corrected' if all_corrected else 'In the model'}: {enumerate_effects(causes, NAMED)}{other}{rest_words}"


def _of_term(assessment: Assessment, term: RankedCandidate) -> str:
    """Why an effect that only describes is no cause."""
    diagnosis = assessment.report.diagnosis
    present = {effect.name for effect in diagnosis.fit.model.effects}
    why = why_no_cause(term.effect, diagnosis.data.poses.q, present)
    if why is not NoCause.OTHER_FORM:
        return _not_identified(assessment, WHY_NO_CAUSE[why])
    refined = sorted(map(plain_name, present & set(variants(term.effect))))
    return f"No new cause: the formula of {enumerate_words(refined, LISTED)} is not exact."
