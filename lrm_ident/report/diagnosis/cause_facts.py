"""Facts on the cause: how certain it is, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.attribution import explained_by_first
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.reason import ReasonKind
from lrm_ident.report.diagnosis.advice import advice_of
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.plain_names import enumerate_effects, plain_name, with_id
from lrm_ident.report.text.variables import function_name, what_may_change
from lrm_ident.report.text.verdicts import why_candidate
from lrm_math.effects import variants

LISTED = 4
PART = 0.15
"""Share of the squared error from which an effect is said to explain part of it."""
NOT_LASTING = frozenset({ReasonKind.NOT_BETTER_LATER, ReasonKind.WORSE_DEPLOYED})
"""Reasons that refuse an effect for later poses, not for these."""


def certainty(assessment: Assessment, cause: RankedCandidate) -> str:
    """How certain the cause is that is to be added, and what it may be in its place."""
    report, rivals = assessment.report, enumerate_effects(cause.equivalent, LISTED)
    if not assessment.identified:
        explained, left = explained_by_first(report) or (0.0, 0.0)
        noise_known = report.diagnosis.floor.rms is not None
        why = why_candidate(report.replicates, cause.name in report.misspecified, explained, left, noise_known)
        return f"only a candidate cause: {why}.{f' These poses cannot distinguish it from {rivals}.' if rivals else ''}"
    if rivals:
        return f"it, or {rivals}: indistinguishable with these poses"
    unsure = "" if report.diagnosis.floor.rms is not None else "; how much stays unexplained is not known"
    return f"identified: {_runner_up(report, cause)}{unsure}"


def indistinguishable_causes(assessment: Assessment) -> str:
    """Which effects of the model may be which others, and whether no poses would tell; empty: all are sure."""
    unsure, advice = assessment.unsure, advice_of(assessment.report)
    either = (f"{plain_name(name)}, or {enumerate_effects(others, LISTED)}" for name, others in unsure.items())
    none = len(unsure) == 1 and advice is not None and advice.plan is not None and not advice.helps
    others = ", and with all others that were tried" if none else ""
    return f"{'; '.join(either)}: indistinguishable with these poses{others}" if unsure else ""


def _runner_up(report: DiagnosisReport, first: RankedCandidate) -> str:
    """What the next best effect leaves that could be the cause; splines, which follow any cause, are none."""
    variants_of_first = {first.name, *variants(first.effect)}
    others = [
        candidate
        for candidate in report.ranking
        if candidate is not first
        and candidate.effect.names_a_cause
        and not candidate.effect.is_free_form
        and candidate.name not in variants_of_first
        and not candidate.scored.implausible
    ]
    if not others:
        return "no other known cause explains any of it"
    best = min(others, key=lambda candidate: candidate.held_out_rms)
    least, mark = best.held_out_rms, "" if best.exact else "≈ "
    curves = (candidate for candidate in report.ranking if candidate is not first and candidate.effect.is_free_form)
    curve = min(curves, key=lambda candidate: candidate.held_out_rms, default=best)
    if curve.held_out_rms < least:
        smooth = f"a smooth curve, which names no cause, {'' if curve.exact else '≈ '}{in_mm(curve.held_out_rms)} mm"
        return f"other causes leave {mark}{in_mm(least)} mm or more; {smooth}"
    return f"every other known cause leaves {mark}{in_mm(least)} mm or more"


def stands_for(report: DiagnosisReport, term: RankedCandidate) -> str:
    """The causes that an empirical term may stand for."""
    present = {effect.name for effect in report.diagnosis.fit.model.effects}
    return enumerate_effects([name for name in variants(term.effect) if name not in present], LISTED)


def acts_most_like(report: DiagnosisReport) -> str:
    """What explains most of an unexplained error, if enough to be worth a word: a free function, or a known effect that
    is not named since later poses speak against it."""
    diagnosis, held_out = report.diagnosis.unexplained, report.held_out.rms
    errors_left = dict(report.functions)
    best = diagnosis.functions[0] if diagnosis.functions else next(iter(errors_left), None)
    function_left = errors_left.get(best, np.inf) if best is not None else np.inf
    best_cause = min(_passing(report), key=lambda candidate: candidate.held_out_rms, default=None)
    left = np.inf if best_cause is None else best_cause.held_out_rms
    if best_cause is not None and left < function_left and explains_part(left, held_out):
        of = f"{with_id(best_cause.name)}, which leaves ≈ {in_mm(left)} mm here"
        return f"{of}. Not named, since it does not surely help at later poses"
    if best is None or not explains_part(function_left, held_out):
        return ""
    question = what_may_change(best)
    return f"{function_name(best)}, which leaves {in_mm(function_left)} mm{question and f'. {question}'}"


def _passing(report: DiagnosisReport) -> Iterator[RankedCandidate]:
    """The known effects that fit the session, and are refused for what the arm does later."""
    for candidate in report.ranking:
        why = candidate.reason.because
        if why is not None and why.kind in NOT_LASTING and not candidate.effect.is_free_form:
            yield candidate


def explains_part(remaining: float, before: float) -> bool:
    """Whether an effect or a function that leaves one held-out RMS of another explains enough to be worth a word."""
    return 1.0 - (remaining / before) ** 2 >= PART
