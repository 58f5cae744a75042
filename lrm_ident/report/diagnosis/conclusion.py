"""Conclusion of a diagnosis: what is missing, its figures, how certain that is, and what to do next.

The one source of a verdict in words: terminal, page, report and notebook show these lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lrm_ident.data.wording import arrow
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.report.diagnosis.advice import advice_of
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.diagnosis.cause_facts import acts_most_like, certainty, indistinguishable_causes, stands_for
from lrm_ident.report.diagnosis.error_facts import bounds_noise, deployed_error, held_out_error, may_hide, rounding
from lrm_ident.report.diagnosis.headline import headline
from lrm_ident.report.diagnosis.next_steps import next_steps
from lrm_ident.report.diagnosis.pose_facts import far_poses, left_out, not_tested, order, valid_where
from lrm_ident.report.document import COLUMNS, Block, CommandLine, Facts, heading, section
from lrm_ident.report.plain_names import enumerate_effects, plain_name, with_id
from lrm_ident.report.text.advice import hopeless_words
from lrm_ident.report.text.claims import claim_sentence
from lrm_ident.report.text.next_steps import UNKNOWN_FILES, CommandNames, NextStep, labelled
from lrm_ident.report.text.poses import influential_poses_sentence, limitation_sentence, where_measured
from lrm_ident.report.text.residuals import predictable_brief, regime_brief, scale_sentence, shifted_sentence
from lrm_ident.residual.data_audit import LimitationKind
from lrm_ident.residual.scale_uncertainty import scale_uncertainty

LISTED, IN_HEADLINE, REASONS, REASONS_SHOWN = 4, 2, 3, 2
LACKS = "what these poses lack"
FIRST = (
    "estimate", "as deployed", "add as well", "certainty", "empirical term", "could be", "acts most like",
    "in the model", "chosen again", LACKS,
)  # fmt: skip
"""Facts that page and report show before the others are unfolded."""
FOLDED = ("black-box model",)
"""Facts that a terminal shows with `--all` only."""


@dataclass(frozen=True)
class Conclusion:
    """A verdict for people.

    Attributes:
        headline: one sentence. facts: labelled figures, among them how certain the headline is.
        reasons: why these poses determine no more, where that matters. next: what to do, the best first.
    """

    headline: str
    facts: tuple[tuple[str, str], ...]
    reasons: tuple[str, ...]
    next: tuple[NextStep, ...]

    def blocks(self) -> list[Block]:
        """The conclusion on a terminal."""
        why = section(LACKS[0].upper() + LACKS[1:], self.reasons[:REASONS_SHOWN])
        shown = tuple(fact for fact in self.facts if fact[0] not in FOLDED)
        steps = [heading("Next"), *next_blocks(self.next)] if self.next else []
        return [heading(self.headline), Facts(shown), *why, *steps]

    def as_json(self) -> dict[str, object]:
        """The table `conclusion`."""
        return {
            "headline": self.headline,
            "facts": dict(self.facts),
            "reasons": self.reasons,
            "next": [
                {"label": label, "do": step.words, "commands": step.commands} for label, step in labelled(self.next)
            ],
        }


def next_blocks(steps: Sequence[NextStep]) -> Iterator[Block]:
    """Steps on a terminal; a single command that fits stands in the line of its words."""
    for label, step in labelled(steps):
        words, commands = f"  {label} {step.sentence}", step.commands
        if commands and len(together := f"{words} {commands[0]}") <= COLUMNS and len(commands) == 1:
            words, commands = together, ()
        yield words
        yield from (CommandLine(f"     {command}") for command in commands)


def conclude(report: DiagnosisReport, names: CommandNames = UNKNOWN_FILES) -> Conclusion:
    """The conclusion of a diagnosis. `names`: of the files in its commands."""
    assessment = Assessment.of(report)
    facts = tuple((label, words) for label, words in _facts(assessment) if words)
    return Conclusion(
        headline=headline(assessment),
        facts=facts,
        reasons=tuple(_lacks(assessment, "order" in dict(facts)))[:REASONS],
        next=tuple(next_steps(assessment, names)),
    )


def _lacks(assessment: Assessment, order_is_said: bool) -> Iterator[str]:
    """Why these poses determine no more, where something is missing whose cause they do not show alone."""
    alone = assessment.identified and assessment.cause is not None and not assessment.cause.equivalent
    if assessment.quiet or alone:
        return
    advice = advice_of(assessment.report)
    if advice is not None and not advice.helps:
        yield hopeless_words(advice)
    for limitation in assessment.report.limitations:
        if limitation.kind is not LimitationKind.ORDER or not order_is_said:
            yield limitation_sentence(limitation)


def _facts(assessment: Assessment) -> Iterator[tuple[str, str]]:
    """Labelled facts; those without words are left out."""
    report, cause, term = assessment.report, assessment.cause, assessment.term
    if cause is not None:
        yield "estimate", "" if cause.claim is None else claim_sentence(cause.claim)
    yield "held-out error", held_out_error(assessment)
    yield "as deployed", deployed_error(report)
    if report.beside:
        both = "only with both does the model surely predict later poses better"
        yield "add as well", f"{with_id(report.beside)}: {both}"
    refitted = None if assessment.first is None else assessment.first.fit
    yield "tracker's scale", scale_sentence(scale_uncertainty(refitted or report.diagnosis.fit))
    if cause is not None:
        yield "certainty", certainty(assessment, cause)
    if term is not None:
        yield "empirical term", f"{plain_name(term.name)}: {arrow(report.held_out.rms, term.held_out_rms)} mm RMS"
        yield "could be", stands_for(report, term)
    if assessment.quiet:
        yield "certainty", indistinguishable_causes(assessment)
    if not assessment.identified and not bounds_noise(report):
        yield "black-box model", predictable_brief(report.patterns.predictable)
    if report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        yield "acts most like", acts_most_like(report)
    yield "order", order(assessment)
    yield "where", regime_brief(report.patterns.regimes[0]) if report.patterns.regimes else ""
    yield "far off", " ".join(far_poses(report))
    if cause is None and report.influential is not None:
        yield "influential", influential_poses_sentence(report.influential, report.diagnosis.data.pose)
    rows = map(shifted_sentence, report.diagnosis.shifted)
    yield "rows", " ".join(f"{words[0].upper()}{words[1:]}." for words in rows)
    yield "left out", left_out(report.diagnosis)
    if assessment.quiet and len(assessment.causes) > IN_HEADLINE:
        yield "in the model", enumerate_effects(assessment.causes, LISTED)
    yield "rounding", rounding(report)
    if assessment.quiet:
        yield "hidden at most", may_hide(report)
        yield "valid", where_measured(valid_where(report))
        yield "not tested", not_tested(report)
