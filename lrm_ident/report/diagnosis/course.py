"""Reports of `auto`, `add` and `propose`: every step and what it took away, the whole course; the proposed law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import UNSEEN, change_words, enumerate_words, in_mm, p_words, poses_words
from lrm_ident.diagnosis.attribution import term_of
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.candidate_trial import objection_to_estimates, objection_to_prediction
from lrm_ident.diagnosis.confirm import ConfirmedDiagnosis
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.diagnosis.step import Step
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document, left_values
from lrm_ident.report.document import Block, Document, Facts, ResultTable, heading
from lrm_ident.report.effects import WHAT_A_FIELD_IS
from lrm_ident.report.fit import diagnose_next, error_blocks, error_values, parameter_table
from lrm_ident.report.plain_names import enumerate_effects, plain_name, with_id
from lrm_ident.report.story import ANEW, Story, at_poses
from lrm_ident.report.text.claims import chosen_again, empirical_words, in_words, stated
from lrm_ident.report.text.next_steps import UNKNOWN_FILES, CommandNames
from lrm_ident.report.text.reasons import no_law_words, reason_words
from lrm_ident.report.text.residuals import (
    WHY_OFF,
    error_raised_sentence,
    law_may_be_wrong_sentence,
    other_outliers_sentence,
    scale_sentence,
)
from lrm_ident.report.text.verdicts import explains_words, no_cause, why_candidate
from lrm_ident.residual.error_breakdown import HeldOutResidual, NestedResidual
from lrm_ident.residual.gravity_loads import usual_turns
from lrm_ident.residual.noise_floor import noise_floor
from lrm_ident.residual.scale_uncertainty import scale_left_open
from lrm_ident.study.model_on_data import ErrorSummary
from lrm_math.effects import EffectRef, ModelPart, effect_of
from lrm_math.model.covariance import Covariance, implausible_estimates
from lrm_math.model.deployed_model import field_of
from lrm_math.model.model_file import AttributionTerm

if TYPE_CHECKING:
    from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal

RIVALS_SHOWN, REFUSED_SHOWN, BAR, BLOCK = 4, 3, 12, "█"
SHOWN = 8
TRACKERS_SCALE = "tracker's scale"
STILL_OPEN = ("empirical term", "could be", "acts most like", "where", "repair", "rounding", "hidden at most", "valid")
"""Facts of the last diagnosis that stand below the course."""
LAST = "all of the last diagnosis"


def step_blocks(taken: Sequence[Step], nominal: float | None = None) -> Iterator[Block]:
    """The last of the steps of `auto` that were taken so far: errors, rival effects, and what was freed.

    Its bar is relative to that of the start; that of the `nominal` arm (m), where it is known, is cut short.
    """
    number, step = len(taken) - 1, taken[-1]
    held_out, before = step.held_out_rms, taken[0].held_out_rms
    bar = BLOCK * int(np.clip(round(BAR * held_out / max(before, 1e-12)), 1, BAR))
    if not number:
        yield heading(f"step  effect added                    mm RMS  held out (bar: 0 to {in_mm(before)} mm)")
        if nominal is not None:
            cut = f" … {nominal / before:.0f} times as long" if nominal > 1.5 * before else ""
            yield f"   –  {'nominal arm, before any fit':30s} {in_mm(nominal):>7s}  {BLOCK * BAR}{cut}"
    deployed = None if step.held_out is None else step.held_out.deployed
    on_the_arm = in_mm(held_out if deployed is None else deployed.now.rms)
    part = at_poses(None if deployed is None else deployed.fewer)
    there = "" if on_the_arm == in_mm(held_out) else f"  as deployed {on_the_arm}{part}"
    begun = "start: fitted model" if step.name is None else f"start: {step.name}"
    yield f"{number:4d}  {step.added or begun:30s} {in_mm(held_out):>7s}  {bar}{there}"
    if step.name is not None and not step.added:
        yield Text(f"      left out: {poses_words(step.data.source.left_out)}. {WHY_OFF}", style="dim")
    if step.evidence.equivalent:
        rivals = enumerate_words(step.evidence.equivalent, RIVALS_SHOWN)
        yield Text(f"      or {rivals}: these poses cannot distinguish them", style="dim")
    if step.added:
        noise_known = noise_floor(step.data, step.fit.equilibrium).rms is not None
        present = {effect.name: effect for effect in step.fit.model.effects}
        why_none = no_cause(present[step.added], step.data.poses.q, present) if step.evidence.describes else ""
        yield Text(
            f"      {explains_words(step.evidence.share, noise_known)}{why_none and '; '}{why_none}", style="dim"
        )
        if words := other_outliers_sentence(step.data.source.left_out, taken[-2].data.source.left_out):
            yield Text(f"      {words}", style="dim")
        if scale := scale_left_open(step.added, step.fit):
            yield f"      scale {scale_sentence(scale)}"
    if step.freed:
        yield Text(f"      now identifiable: {enumerate_words(step.freed, RIVALS_SHOWN)}", style="dim")


def step_document(
    effect: str,
    step: Step,
    before: ErrorSummary,
    after: ErrorSummary,
    covariance: Covariance | None = None,
    files: Sequence[str] = (),
) -> Document:
    """Result of `lrm-ident add`, schema `lrm/step/1`.

    Args:
        covariance: of the parameters before the step.
        files: the new model and the data, for the next command.
    """
    free, count = len(step.start.free if step.start else ()), len(step.fit.model.free)
    earlier = error_blocks(before, f"Before: {free} parameters")
    said = effect if field_of(step.fit.model) is None else f"{effect}, {WHAT_A_FIELD_IS}"
    table = error_blocks(after, f"With {said}: {count} parameters")
    errors = {"before": before, "after": after}
    stats = {name: {"fit": error.fitted, "held_out": error.held_out.error} for name, error in errors.items()}
    values: dict[str, object] = {"added": effect, "parameters": count, **stats}
    verdict = verdict_on(effect, step, before, after, covariance)
    values |= {"verdict": verdict or None}
    facts = (("verdict", verdict), (TRACKERS_SCALE, scale_sentence(scale_left_open(effect, step.fit))))
    stated = tuple((label, words) for label, words in facts if words)
    told = [Facts(stated)] if stated else []
    blocks: list[Block] = [*told, *table, *diagnose_next(files)]
    if before.held_out.error is not None and after.held_out.error is not None:
        change = change_words(before.held_out.error.rms, after.held_out.error.rms)
        blocks.insert(0, heading(f"With {plain_name(effect)} the RMS error {UNSEEN} {change}."))
    about = "the errors before, every parameter"
    return Document(blocks, "lrm/step/1", values, details=[*earlier, parameter_table(step.fit)], about=about)


def verdict_on(
    effect: str, step: Step, before: ErrorSummary, after: ErrorSummary, covariance: Covariance | None
) -> str:
    """Whether the data support an effect that was added, in words; empty where no held-out error tells."""
    without, with_it, start = before.held_out, after.held_out, step.start
    if start is None or without.residual is None or with_it.residual is None or not (without.blocks and with_it.blocks):
        return ""
    kind = EffectRef.parse(effect).id
    added_keys = [
        key for key in step.fit.model.free if key not in start.free and EffectRef.parse(effect_of(key)).id == kind
    ]
    if len(without.residual) != len(with_it.residual) or not added_keys:
        return ""
    objection = objection_to_estimates(step.fit, added_keys, implausible_estimates(start, covariance))
    if objection := objection or objection_to_prediction(without.blocks, with_it.blocks):
        return f"no evidence for it: {reason_words(objection)}. Undo the step unless you know the cause."
    if step.evidence.equivalent:
        rivals = enumerate_effects(step.evidence.equivalent, RIVALS_SHOWN)
        return f"supported, but these poses cannot distinguish it from {rivals}."
    return "supported: the model surely predicts better with it. That alone does not identify it: see diagnose."


def course_document(
    course: AutoRun,
    held_out: HeldOutResidual,
    nested: NestedResidual,
    with_prior: ErrorSummary | None,
    with_field: ErrorSummary | None = None,
    names: CommandNames = UNKNOWN_FILES,
    story: Story | None = None,
    tables: Sequence[Block] = (),
) -> Document:
    """Result of `lrm-ident auto`, schema `lrm/course/1`: the nested held-out error and the last diagnosis.

    with_prior: errors of the last fit, together with a prior, if there was one. with_field: with a residual field, if
    one was added. names: of the files in the commands to copy. story: of its
    model file. tables: errors of the last model, for the details.
    """
    report, attributed = course.report, course.attributions
    values = {
        "steps": [
            {
                "added": step.added,
                "indistinguishable_from": step.evidence.equivalent,
                "form_of": step.evidence.refines,
                "share_of_excess": step.evidence.share,
                **({"is": attributed[number - 1].kind} if number else {}),
                "freed": step.freed,
                "parameters": len(step.fit.model.free),
                "fit_rms_mm": error_stats(step.fit.residual).rms * 1e3,
                "held_out_rms_mm": step.held_out_rms * 1e3,
                "left_out": step.data.source.left_out,
                "as_deployed": None if step.held_out is None else step.held_out.deployed,
            }
            for number, step in enumerate(course.steps)
        ],
        "verdict": report.verdict,
        "story": story,
        "refused_as_deployed": {
            name: {"without_mm": before * 1e3, "with_mm": after * 1e3}
            for name, (before, after) in course.confirmed.worse_deployed.items()
        },
        **left_values(report.patterns),
        "held_out_effects_fixed": held_out.error,
        "held_out": nested.error,
        "as_deployed_effects_fixed": held_out.deployed,
        "as_deployed": nested.deployed,
        "chosen_in_folds": nested.frequency,
        **({} if with_prior is None else {"with_prior": error_values(with_prior)}),
        **({} if with_field is None else {"with_residual_field_not_a_cause": error_values(with_field)}),
    }
    fell = _last_errors(course, nested) if story is None else (("error", story.sentence), *story.facts)
    again = () if nested.error is None else (("chosen again", chosen_again(nested.frequency, len(nested.chosen))),)
    why_not = () if nested.error is not None else (("nested error", f"not computed: {nested.reason}"),)
    warnings = *error_raised_on_the_arm(course), *laws_that_may_be_wrong(course)
    facts = Facts((*_sizes(course), *fell, *warnings, *again, *why_not))
    told = [*attribution_blocks(course), facts, *refused_blocks(course.confirmed), ""]
    rest, last = diagnosis_document(report, names), conclude(report, names)
    open_facts = tuple(fact for fact in last.facts if fact[0] in STILL_OPEN)
    sure = any(attribution.kind == Support.FINDING for attribution in attributed)
    blocks: list[Block] = [*told, *replace(last, facts=open_facts, reasons=() if sure else last.reasons).blocks()]
    details: list[Block] = [*tables, *last.blocks(), *rest.details]
    return Document(blocks, "lrm/course/1", values, details=details, about=f"errors of the last model, {LAST}")


def _last_errors(course: AutoRun, nested: NestedResidual) -> tuple[tuple[str, str], ...]:
    """Errors where the model's file tells no story."""
    again = () if nested.error is None else (("nested", f"{in_mm(nested.error.rms)} mm RMS, {ANEW}"),)
    return (("error", f"{in_mm(course.steps[-1].held_out_rms)} mm RMS {UNSEEN}"), *again)


def _sizes(course: AutoRun) -> Iterator[tuple[str, str]]:
    """Estimates of the causes that were found, by the last fit; those of other effects are among the details."""
    fit = course.steps[-1].fit
    errors = dict(zip(fit.model.free, fit.standard_error.tolist(), strict=True))
    present = {effect.name: effect for effect in fit.model.effects}
    label = "estimate"
    for step, attribution in zip(course.steps[1:], course.attributions, strict=True):
        effect = present.get(step.added)
        if attribution.kind != Support.FINDING or effect is None or effect.is_free_form or not effect.about.claim:
            continue
        turns = usual_turns(effect, fit.equilibrium)
        words = {
            p.name: in_words(p, fit.model.value(key) / p.si, errors.get(key, 0.0) / p.si, turns.get(p.name))
            for key, p in zip(effect.keys, effect.parameters, strict=True)
        }
        yield label, stated(effect, words, turns)
        label = ""


def error_raised_on_the_arm(course: AutoRun) -> Iterator[tuple[str, str]]:
    """The error on the arm, where what was added raises it; none beside an effect of the tracker, whose own error its
    points have."""
    ends = course.steps[0].held_out, course.steps[-1].held_out
    first, last = (None if end is None else end.deployed for end in ends)
    of_tracker = any(effect.part is ModelPart.MEASUREMENT for effect in course.model.effects)
    if first is not None and last is not None and not of_tracker and (words := error_raised_sentence(first, last)):
        yield "on the arm", words


def laws_that_may_be_wrong(course: AutoRun) -> Iterator[tuple[str, str]]:
    """Laws that the daemon follows from its record, where more than a known noise is left."""
    state = course.model.state
    if state is not None and course.diagnosis.above_floor:
        followed = [plain_name(name) for name in (*state.warming, *state.memory)]
        yield from (("law", words) for words in [law_may_be_wrong_sentence(followed)] if words)


def refused_blocks(confirmed: ConfirmedDiagnosis) -> Iterator[Block]:
    """The effects that predict this session better, and were not added since the arm would get a worse model."""
    rises = [
        f"{name} ({in_mm(before)} → {in_mm(after)} mm)" for name, (before, after) in confirmed.worse_deployed.items()
    ]
    if rises:
        yield f"Not added, since the error on the arm would rise: {enumerate_words(rises, REFUSED_SHOWN)}"


def attribution_blocks(course: AutoRun) -> Iterator[Block]:
    """What a run added: the identified causes and those that the data cannot distinguish, or that no cause is certain;
    then the candidate causes with the reason why they are no more, and the empirical terms."""
    steps = list(zip(course.steps[1:], course.attributions, course.explained, strict=True))

    def named(term: AttributionTerm) -> list[Step]:
        return [step for step, attribution, _ in steps if term_of(attribution.kind, step.evidence.equivalent) == term]

    identified, several, terms = named("identified cause"), named("indistinguishable cause"), named("empirical term")
    if identified:
        title = "Identified cause" if len(identified) == 1 else "Identified causes"
        yield heading(f"{title}: {enumerate_words([with_id(step.added) for step in identified], len(identified))}")
    for step in several:
        others = enumerate_effects(step.evidence.equivalent, RIVALS_SHOWN)
        yield heading(f"Indistinguishable with these poses: {with_id(step.added)}, or {others}")
    if steps and not identified and not several:
        yield heading("No cause is certain. What was added corrects the error; it may stand for other causes.")
    misspecified, noise_known = course.report.misspecified, course.report.diagnosis.floor.rms is not None
    candidates = [
        f"{with_id(step.added)}: "
        + why_candidate(
            step.evidence.replicates, step.added in misspecified, explained, attribution.unexplained, noise_known
        )
        for step, attribution, explained in steps
        if attribution.kind == Support.POSSIBLE_CAUSE
    ]
    listed = enumerate_effects((step.added for step in terms), RIVALS_SHOWN)
    empirical = [f"{listed}: {empirical_words(len(terms))}"] if terms else []
    if rows := (*_labelled("candidate cause", candidates), *_labelled("empirical term", empirical)):
        yield Facts(rows)


def _labelled(label: str, lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Facts of which only the first has the label."""
    return ((label if number == 0 else "", words) for number, words in enumerate(lines))


def proposal_document(proposal: LawProposal) -> Document:
    """Result of `lrm-ident propose`, schema `lrm/proposal/2`."""
    judged = (
        f"{proposal.tried} formulas were tried at all joints. Held out, the model alone has "
        f"{in_mm(proposal.before.rms)} mm; with a formula chosen anew in every block (nested) about "
        f"{in_mm(proposal.nested)} mm. Against pure noise: p {p_words(proposal.p_value)}."
    )
    best = proposal.best
    values: dict[str, object] = {
        "laws_tried": proposal.tried,
        "p_value": proposal.p_value,
        "held_out_before": proposal.before,
        "nested_held_out_rms_mm": proposal.nested * 1e3,
        "proposed": None if best is None else {"joint": best.law.joint + 1, "formula": best.law.formula},
        "held_out": None if best is None else best.error,
        "reason": proposal.reason,
        "why": no_law_words(proposal),
        "indistinguishable_from": [
            {"joint": law.joint + 1, "formula": law.formula, "held_out_rms_mm": rms * 1e3}
            for law, rms in proposal.equivalent
        ],
        "next_poses_deg": None if proposal.next_poses is None else np.degrees(proposal.next_poses).round(1),
    }
    if best is None:
        return Document(
            [heading(f"No formula is proposed: {no_law_words(proposal)}."), judged], "lrm/proposal/2", values
        )
    blocks: list[Block] = [
        heading(f"Proposed: {best.law.formula}"),
        judged,
        f"Refitted with everything else, it leaves {in_mm(best.error.rms)} mm held out.",
    ]
    if proposal.equivalent:
        rows = [(law.formula, rms * 1e3) for law, rms in proposal.equivalent[:SHOWN]]
        blocks.append(ResultTable(("formula", "held out ≈ mm|.2f"), rows, "Indistinguishable with these poses"))
    if proposal.next_poses is not None and len(proposal.next_poses):
        columns = ("pose|", *(f"q{i + 1}|.0f" for i in range(proposal.next_poses.shape[1])))
        lines = [(number, *row) for number, row in enumerate(np.degrees(proposal.next_poses).tolist(), start=1)]
        blocks.append(ResultTable(columns, lines, "Poses (deg) at which they differ most"))
    return Document(blocks, "lrm/proposal/2", values)
