"""Values that `page/figures.js` draws, as plain JSON: rounded values in the units of the screen."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import UNSEEN, arrow, in_mm, p_words
from lrm_ident.diagnosis.attribution import StepAttribution, term_of, unexplained_ratio
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.report.diagnosis.conclusion import FIRST
from lrm_ident.report.diagnosis.standing import Standing
from lrm_ident.report.document import plain
from lrm_ident.report.model_report import ModelReport
from lrm_ident.report.plain_names import plain_name, step_title, words_of
from lrm_ident.report.plots.interactive.candidate_view import ANGLE, SHARE, UM, rounded
from lrm_ident.report.step_card import StepCard, of_data, rivals
from lrm_ident.report.story import GEOMETRY, Story, StoryStep
from lrm_ident.report.text.next_steps import UNKNOWN_FILES, labelled
from lrm_ident.report.text.residuals import arrows_caption
from lrm_ident.report.text.variables import axis_label, variable_name
from lrm_ident.residual.better_prediction import share_of_excess
from lrm_ident.residual.gravity_loads import LOCAL
from lrm_ident.residual.picture.error_field import COLOURS, ErrorField
from lrm_ident.residual.picture.group_means import explained_by_means, fair_rows, shown_most
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_math.arm.arm_file import MM
from lrm_math.effects.reference import EffectRef
from lrm_math.model.step_name import FIT

MARKS = dict(zip(Standing, "●◍◇◐●◌◌◔○✕", strict=True))
"""Of a candidate, before its label."""
UNKNOWN = "–"
"""For an error that is not known."""


def figure_values(report: ModelReport) -> dict[str, Any]:
    """The values that all figures of one model are drawn from."""
    diagnosis_values = {} if report.diagnosis is None else report.diagnosis.values
    following = () if report.conclusion is None else report.conclusion.next
    story, turns, lever = report.story, report.field.steps[-1].turns, report.field.lever
    shared = [covariate for covariate in report.covariates if covariate.kind not in LOCAL]
    explained = [explained_by_means(turns, lever, covariate.values) for covariate in shared]
    joint, driver = shown_most(explained, shared, range(len(lever)))
    drawn = {
        name
        for candidate in report.candidates
        for name in (candidate["driver"], candidate["second"], candidate["shown"]["driver"])
    }
    drawn |= {card.driver for card in report.cards} | {variable_name(covariate.variable) for covariate in shared}
    named = {variable_name(covariate.variable): covariate for covariate in report.covariates}
    cards = zip(report.cards, story.later if story else (), report.attributions, strict=True)
    return {
        **_drawn(report.field, report.poses),
        "drivers": [
            {"name": name, "label": axis_label(covariate.variable), "values": rounded(covariate.shown, 4)}
            for name, covariate in named.items()
            if name in drawn
        ],
        "verdict": report.verdict,
        "facts": [[label, words, label in FIRST] for label, words in report.facts],
        "steps": [_step(report, number) for number in range(len(report.field.steps))],
        "unseen": UNSEEN,
        "story": None if story is None else waterfall_values(story),
        "cards": [_card(report, story is not None and story.held_out, *each) for each in cards],
        "floor": report.floor_mm,
        "marked": {why: list(numbers) for why, numbers in (report.marked or {}).items()},
        # shown first: the chart that shows most of what the model leaves
        "fails": report.diagnosis is None or not Verdict(str(diagnosis_values["verdict"])).quiet,
        "where": {"joint": joint, "driver": variable_name(driver) if driver else ""},
        "next": [[label, step.sentence, list(filter(_copied, step.commands))] for label, step in labelled(following)],
        "ranking": _ranking(report, diagnosis_values.get("ranking", ())),
    }


def _copied(command: str) -> bool:
    """Whether a command is shown: not that of a button of the workbench, where the names of the files are not known."""
    return not command.startswith("lrm-ident") or UNKNOWN_FILES.model not in command.split()


def waterfall_values(story: Story) -> dict[str, Any]:
    """A story with the rows of its waterfall: the steps, the errors below these, the noise, each as it is printed."""

    def row(step: StoryStep) -> dict[str, Any]:
        return {**plain(step), "left": step.left}

    steps, ends, noise = map(row, story.steps), map(row, story.ends), story.noise and row(story.noise)
    told = {"sentence": story.sentence, "held_out": story.held_out, "longest": story.longest}
    return {**told, "steps": [*steps], "ends": [*ends], "noise": noise}


def _drawn(field: ErrorField, data: Measurements) -> dict[str, Any]:
    """The drawn poses, in degrees, g and mm; both arms at them; the scale of the arrows."""
    fair = fair_rows(field.steps[-1].residual, field.poses)
    return {
        "pose": data.pose.tolist(),
        "poses": field.poses,
        "data": data.source.sha256,
        "fair": None if fair is None else fair.tolist(),
        "q": rounded(np.degrees(data.poses.q), 2),
        "load": rounded(data.poses.payload * 1e3, 1),
        "session": None if data.poses.session is None else rounded(data.poses.session, 0),
        "tcp": rounded(np.where(np.isnan(data.tcp), field.bent[:, -1], data.tcp) * 1e3, UM),
        "nominal": rounded(field.nominal * 1e3, 1),
        "bent": rounded(field.bent * 1e3, 1),
        "solids": {
            "links": [[first, second, radius * 1e3] for first, second, radius in field.solids.links],
            "shaped": field.solids.shaped,
            "nominal": rounded(field.nominal_points * 1e3, 1),
            "bent": rounded(field.bent_points * 1e3, 1),
        },
        "scale": {
            "magnification": field.scale.magnification,
            "largest": field.scale.largest * 1e3,
            "words": arrows_caption(field.scale),
            "colours": COLOURS,
        },
    }


def values_text(values: Mapping[str, Any]) -> str:
    """JSON that may stand in a `<script>` element."""
    return json.dumps(values, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def _step(report: ModelReport, number: int) -> dict[str, Any]:
    """A step with its errors; `here`: whether these are of the open data; `held`: then the held-out one, as printed."""
    step, lever = report.field.steps[number], report.field.lever
    mean = lever.mean(axis=1, keepdims=True)  # a turn about a short lever is enormous for a small error
    entry = report.file.history[number] if report.file.history else None
    here = entry is not None and of_data(entry, report.poses.source.sha256)
    held = entry.held_out_rms_mm if entry is not None and here else None
    return {
        "name": step.name,
        "title": step.name if entry is None else GEOMETRY if entry.name.kind == FIT else step_title(entry.name),
        "verdict": (report.judged or {}).get(number, ""),
        "here": here,
        "rms": in_mm(step.error.rms),
        "held": "" if held is None else in_mm(held * 1e-3),
        "residual": rounded(step.residual * 1e3, UM),
        "turns": rounded(np.degrees(np.where(lever > SHARE**2 * mean, step.turns, np.nan)), ANGLE),
    }


def _card(
    report: ModelReport, held_out: bool, card: StepCard, fall: StoryStep, shown: StepAttribution | None
) -> dict[str, Any]:
    """A card with the errors of its step, and what that shows: an identified cause, a candidate, or none."""
    kind, floor, before, after = None if shown is None else shown.kind, report.floor_mm, fall.before_rms_mm, fall.rms_mm
    weighted = report.poses.several_kinds
    excess = None if floor is None or before <= floor else share_of_excess(after, before, floor)
    ratio = None if shown is None or report.diagnosis is None else unexplained_ratio(fall.explained, shown.unexplained)
    told = {key: value for key, value in plain(card).items() if key != "evidence"}  # what is shown of that stands below
    return {
        **told,
        "held_out": held_out,
        "fall": arrow(before * MM, after * MM),
        "sketch": words_of(card.name, "sketch"),
        "share": None if excess is None else min(max(excess, 0.0), 1.0),
        "shows": kind,
        "label": "" if kind is None else term_of(kind, card.evidence.equivalent),
        "ratio": ratio if ratio is not None and MAX_UNEXPLAINED_RATIO < ratio < math.inf else None,
        "rivals": [{"name": name, "title": plain_name(name), "why": why} for name, why in rivals(card, weighted)],
        "equivalent": [plain_name(name) for name in card.evidence.equivalent],
        "asked": card.evidence.rivals is not None,
        "unrivalled": kind == "finding" and held_out and not weighted and card.unrivalled(after),
    }


def _ranking(report: ModelReport, ranking: Any) -> list[dict[str, Any]]:
    """The candidates: the one that the verdict names, its rivals, others with support in the order of `diagnose`, then
    by the error that they would leave."""
    views, weighted, order = {view["name"]: view for view in report.candidates}, report.poses.several_kinds, [*Standing]
    named = [(str(EffectRef(advice["effect"], advice["place"])), advice) for advice in ranking]
    out = [_candidate(views[name], advice, weighted) for name, advice in named if name in views]
    top = 0 if not out or out[0]["verdict"] == Support.NO_EVIDENCE else 1
    left = {entry["name"]: entry["heldOut"] * (entry["standing"] != Standing.BESIDE) for entry in out}
    return out[:top] + sorted(out[top:], key=lambda entry: (order.index(entry["standing"]), left[entry["name"]]))


def _gain(advice: Mapping[str, Any], weighted: bool) -> float | None:
    """Part of the held-out error (mm) that it would take away; None where what it would leave is of something else."""
    return None if weighted and advice["approximate"] else float(advice["gain_mm"])


def _held(advice: Mapping[str, Any], weighted: bool) -> str:
    """A held-out error in mm; ≈ if not refitted, and none where more than positions was measured."""
    value = in_mm(advice["held_out_rms_mm"] * 1e-3)
    return value if not advice["approximate"] else UNKNOWN if weighted else f"≈ {value}"


def _candidate(view: Mapping[str, Any], advice: Mapping[str, Any], weighted: bool) -> dict[str, Any]:
    return {
        **view,
        "title": plain_name(view["name"]),
        "sketch": words_of(view["name"], "sketch"),
        "verdict": advice["verdict"],
        "standing": advice["standing"],
        "mark": f"{MARKS[advice['standing']]} {advice['standing']}",
        "held": _held(advice, weighted),
        "heldOut": advice["held_out_rms_mm"],
        "gain": _gain(advice, weighted),
        "why": advice["why"],
        "online": advice["online"],
        "p": p_words(advice["p_value"]),
    }
