"""Reports of `auto`, `add` and `propose`: every step and what it took away, the whole course; the proposed law."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import enumerate_words, in_mm, p_words
from lrm_ident.diagnosis.auto import AutoRun, AutoStep
from lrm_ident.diagnosis.confirm import ConfirmedDiagnosis
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document, left_values, no_cause, took_words
from lrm_ident.report.document import Block, Document, ResultTable, heading
from lrm_ident.report.fit import error_blocks, parameter_table
from lrm_ident.residual.error_breakdown import HeldOutResidual, NestedResidual
from lrm_ident.residual.residual_structure import noise_floor
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_ident.study.field_step import WHAT_IT_IS
from lrm_ident.study.model_on_data import ErrorSummary
from lrm_ident.study.step import StudyStep
from lrm_math.model.deployed_model import field_of

if TYPE_CHECKING:
    from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal

RIVALS_SHOWN, BAR = 4, 20
SHOWN = 8


def step_blocks(number: int, step: AutoStep, start: AutoStep) -> Iterator[Block]:
    """One step of `auto`: errors, rival effects, and what was freed; its bar is relative to that of the `start`."""
    held_out, before = (error_stats(one.held_out).rms * 1e3 for one in (step, start))
    bar = "█" * int(np.clip(round(BAR * held_out / max(before, 1e-9)), 1, 2 * BAR))
    deployed = f"as deployed {in_mm(step.deployed.now.rms):>5s} mm"
    fitted = f"fit {in_mm(error_stats(step.fit.residual).rms):>5s}"
    errors = f"{fitted}  held out {in_mm(held_out * 1e-3):>5s}  {deployed} {bar}"
    yield f"{number:3d}  {step.added or 'start':27s} {len(step.fit.model.free):3d} parameters  {errors}"
    if step.equivalent:
        rivals = enumerate_words(step.equivalent, RIVALS_SHOWN)
        yield Text(f"       or {rivals}, or several of them: these data cannot tell", style="dim")
    if step.added:
        known = noise_floor(step.data, step.fit.equilibrium).rms is not None
        present = {effect.name: effect for effect in step.fit.model.effects}
        why_none = no_cause(present[step.added], step.data.poses.q, present, known) if step.describes else ""
        reason = f"; description: {why_none}" if why_none else ""
        yield Text(f"       {took_words(step.share, known)}{reason}", style="dim")
    if step.freed:
        yield Text(f"       can be determined now: {enumerate_words(step.freed, RIVALS_SHOWN)}", style="dim")


def step_document(effect: str, step: StudyStep, before: ErrorSummary, after: ErrorSummary) -> Document:
    """Result of `lrm-ident add`, schema `lrm/step/1`."""
    free, now = len(step.start.free if step.start else ()), len(step.fit.model.free)
    tables = [
        *error_blocks(before, f"before: {free} parameters"),
        *error_blocks(after, f"with {_said(step, effect)}: {now}"),
    ]
    errors = {"before": before, "after": after}
    values = {name: {"fit": error.fitted, "held_out": error.held_out.error} for name, error in errors.items()}
    return Document([*tables, parameter_table(step.fit)], "lrm/step/1", {"added": effect, "parameters": now, **values})


def _said(step: StudyStep, effect: str) -> str:
    """An effect that was added, and that it is no cause where it is none."""
    return f"{effect}, {WHAT_IT_IS}" if field_of(step.fit.model) is not None else effect


def course_document(
    course: AutoRun,
    held_out: HeldOutResidual,
    nested: NestedResidual,
    with_prior: ErrorSummary | None,
    with_field: ErrorSummary | None = None,
) -> Document:
    """Result of `lrm-ident auto`, schema `lrm/course/1`: the nested held-out error and the last diagnosis.

    with_prior: errors of the last fit, together with a prior, if there was one. with_field: with a residual field, if
    one was added.
    """
    report, attributed = course.report, course.attributions
    what = "Held out, effects chosen anew in every fold (nested):"
    last: list[Block] = [f"{what} none, because {nested.reason}"]
    if nested.error is not None:
        deployed = "" if nested.deployed is None else f"; as deployed RMS {in_mm(nested.deployed.now.rms)} mm"
        shown = f"{what} mean {in_mm(nested.error.mean)}, RMS {in_mm(nested.error.rms)} mm{deployed}"
        last = [heading(shown), _chosen(nested)]
    values = {
        "steps": [
            {
                "added": step.added,
                "indistinguishable_from": step.equivalent,
                "form_of": step.refines,
                "share_of_excess": step.share,
                **({"is": attributed[number - 1].kind} if number else {}),
                "freed": step.freed,
                "parameters": len(step.fit.model.free),
                "fit_rms_mm": error_stats(step.fit.residual).rms * 1e3,
                "held_out_rms_mm": error_stats(step.held_out).rms * 1e3,
                "as_deployed": step.deployed,
            }
            for number, step in enumerate(course.steps)
        ],
        "verdict": report.verdict,
        "refused_as_deployed": {
            name: {"without_mm": before * 1e3, "with_mm": after * 1e3}
            for name, (before, after) in course.confirmed.worse_deployed.items()
        },
        **left_values(report.left),
        "held_out_effects_fixed": held_out.error,
        "held_out": nested.error,
        "as_deployed_effects_fixed": held_out.deployed,
        "as_deployed": nested.deployed,
        "chosen_in_folds": nested.frequency,
        **({} if with_prior is None else {"with_prior": with_prior}),
        **({} if with_field is None else {"with_residual_field_not_a_cause": with_field}),
    }
    told = [*last, *attribution_blocks(course), *refused_blocks(course.confirmed)]
    return Document([*told, *diagnosis_document(report).blocks], "lrm/course/1", values)


def refused_blocks(confirmed: ConfirmedDiagnosis) -> Iterator[Block]:
    """The effects that predict this session better, and were not added since the arm would get a worse model."""
    rises = [
        f"{name} ({in_mm(before)} → {in_mm(after)} mm)" for name, (before, after) in confirmed.worse_deployed.items()
    ]
    if rises:
        yield f"Not added, because the deployed model would be worse (held-out RMS): {enumerate_words(rises, SHOWN)}"


def attribution_blocks(course: AutoRun) -> Iterator[Block]:
    """The causes that are shown, and those that may stand for another one, with what is left of it."""
    steps = list(zip([step.added for step in course.steps[1:]], course.attributions, course.explained, strict=True))
    if found := [name for name, one, _ in steps if one.kind == "finding"]:
        yield heading(f"Shown to be a cause, or one of its class: {enumerate_words(found, len(found))}")
    possible = [(name, one.unexplained, explained) for name, one, explained in steps if one.kind == "possible_cause"]
    ratios = [f"{name} ({left / explained if explained > 0.0 else np.inf:.1f})" for name, left, explained in possible]
    if ratios:
        yield (
            f"Possible causes: {enumerate_words(ratios, len(ratios))}. In brackets: the mean square without a cause, "
            "left at the end or taken by later steps that show none, over what the step took; above "
            f"{MAX_UNEXPLAINED_RATIO:.2f} another cause may stand behind it."
        )


def _chosen(nested: NestedResidual) -> str:
    """Number of folds in which each effect was chosen: what few choose is unstable."""
    often = [f"{name} {count}" for name, count in nested.frequency.items() if count > 1]
    once = sum(count == 1 for count in nested.frequency.values())
    words = [*often, *([f"{once} more once each" if often else f"{once} once each"] if once else [])]
    return f"In how many of the {len(nested.chosen)} folds each was chosen: {', '.join(words) or 'none in any'}"


def proposal_document(found: LawProposal) -> Document:
    """Result of `lrm-ident propose`, schema `lrm/proposal/1`."""
    judged = (
        f"{found.tried} laws were tried at all joints. Held out, the model alone has {in_mm(found.before.rms)} mm; "
        f"with a law chosen anew in every block (nested) about {in_mm(found.nested)} mm. Against pure noise: "
        f"p {p_words(found.p_value)}."
    )
    best = found.best
    values: dict[str, object] = {
        "laws_tried": found.tried,
        "p_value": found.p_value,
        "held_out_before": found.before,
        "nested_held_out_rms_mm": found.nested * 1e3,
        "proposed": None if best is None else {"joint": best.law.joint + 1, "formula": best.law.formula},
        "held_out": None if best is None else best.error,
        "reason": found.reason,
        "indistinguishable_from": [
            {"joint": law.joint + 1, "formula": law.formula, "held_out_rms_mm": rms * 1e3}
            for law, rms in found.equivalent
        ],
        "next_poses_deg": None if found.next_poses is None else np.degrees(found.next_poses).round(1),
    }
    if best is None:
        return Document([heading(f"No law is proposed: {found.reason}."), judged], "lrm/proposal/1", values)
    blocks: list[Block] = [
        heading(f"Proposed: {best.law.formula}"),
        judged,
        f"Refitted with everything else, it leaves {in_mm(best.error.rms)} mm held out.",
    ]
    if found.equivalent:
        rows = [(law.formula, rms * 1e3) for law, rms in found.equivalent[:SHOWN]]
        blocks.append(ResultTable(("law", "held out ≈ mm|.2f"), rows, "These data cannot tell it from"))
    if found.next_poses is not None and len(found.next_poses):
        columns = ("pose|", *(f"q{i + 1}|.0f" for i in range(found.next_poses.shape[1])))
        lines = [(number, *row) for number, row in enumerate(np.degrees(found.next_poses).tolist(), start=1)]
        blocks.append(ResultTable(columns, lines, "Poses (deg) at which they differ most"))
    return Document(blocks, "lrm/proposal/1", values)
