"""Report of where the tip landed that was sent to goals, before and after, in words, tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

from lrm_ident.data.wording import in_mm
from lrm_ident.design.observability import MM_PER_M
from lrm_ident.measuring.verification.goal_run import AttainedPosition, Verification
from lrm_ident.report.document import Block, Document, ResultTable
from lrm_math.errors import FileError
from lrm_math.text_file import read_content

FIGURES = ("mean|.2f", "RMS|.2f", "worst|.2f", "rounding, RMS|.2f", "predicted, RMS|.2f")
UNLIKE = 10.0
"""Ratio of the error at goals to the predicted one from which it is said; chosen, not fitted."""


def verification_document(verification: Verification, earlier: Mapping[str, Any] | None) -> Document:
    """Result of `lrm-ident verify`, schema `lrm/verification/1`; `earlier`: that of another model at the same goals."""
    current = values(verification)
    rows = [(name, _model(of), *_figures(of)) for name, of in (("before", earlier), ("now", current)) if of is not None]
    title = f"Where the tip landed: {len(verification.attained)} goals, mm from the goal"
    blocks: list[Block] = [ResultTable(("", "model", *FIGURES), rows, title)]
    if len(verification.places) > 1:
        parts = [(place, verification.at(place)) for place in verification.places]
        by_place = [(place, len(part.attained), *_figures(values(part))) for place, part in parts]
        blocks.append(ResultTable(("at the", "goals|d", *FIGURES), by_place, "By place, mm from the goal"))
    if verification.turn is not None:
        blocks.append(f"The tool is {degrees(verification.turn):.2f} deg RMS off the orientation of its goals.")
    blocks += [f"not reached: goal {number}: {why}" for number, why in verification.failed.items()]
    return Document(
        [*blocks, *unlike_the_model(verification)], "lrm/verification/1", current, goal_table(verification.attained)
    )


def unlike_the_model(verification: Verification) -> list[str]:
    """A line if the tip landed far beyond what the model itself expects: its arm is not the one that moved."""
    if verification.predicted is None or verification.error.rms < UNLIKE * verification.predicted:
        return []
    return [
        f"The tip lands {verification.error.rms / verification.predicted:.0f} times as far from its goals as the model "
        f"predicts ({in_mm(verification.error.rms)} mm RMS in place of {in_mm(verification.predicted)}): an effect is "
        "missing from the model (lrm-ident diagnose), or this is not the arm that was measured any more: "
        "a servo without force, another load, a target or a base that moved."
    ]


def _model(figures: Mapping[str, Any]) -> str:
    return figures["model_sha256"][:12] or "nominal"


def _figures(figures: Mapping[str, Any]) -> tuple[Any, ...]:
    """Cells of `FIGURES` from the values of the JSON file."""
    error = figures["error"]
    return error["mean_mm"], error["rms_mm"], error["max_mm"], figures["rounding_rms_mm"], figures["predicted_rms_mm"]


def values(verification: Verification) -> dict[str, Any]:
    """The values of the JSON file."""
    error, predicted = verification.error, verification.predicted
    return {
        "model": verification.model,
        "model_sha256": verification.model_sha256,
        "error": {f"{name}_mm": getattr(error, name) * MM_PER_M for name in ("mean", "rms", "max", "sd")},
        "rounding_rms_mm": verification.rounding * MM_PER_M,
        "predicted_rms_mm": None if predicted is None else predicted * MM_PER_M,
        "angle_rms_deg": None if verification.turn is None else degrees(verification.turn),
        "goals": goal_table(verification.attained).records(),
        "not_reached": {str(number): why for number, why in verification.failed.items()},
    }


def goal_table(attained: Sequence[AttainedPosition]) -> ResultTable:
    """One row per goal: goal, tip and error in mm."""
    axes = [f"{what}{axis}_mm|.3f" for what in ("goal_", "") for axis in "xyz"]
    columns = ["goal|d", "place", *axes, "error_mm|.3f", "rounding_mm|.3f", "predicted_sd_mm|.3f", "measured_sd_mm|.3f"]
    rows: list[tuple[object, ...]] = [
        (
            goal.number, goal.place, *(MM_PER_M * v for v in (*goal.goal, *goal.tip)), MM_PER_M * goal.error,
            MM_PER_M * goal.rounding, None if goal.sd is None else MM_PER_M * goal.sd, MM_PER_M * goal.spread,
        )
        for goal in attained
    ]  # fmt: skip
    angles = [None if goal.turn is None else degrees(goal.turn) for goal in attained]
    if any(angle is not None for angle in angles):
        columns = [*columns, "angle_deg|.3f"]
        rows = [(*row, angle) for row, angle in zip(rows, angles, strict=True)]
    return ResultTable(columns, rows)


def read_verification(path: Path) -> dict[str, Any]:
    """An earlier result. Raises `FileError`: no such file, or no result of `verify`."""
    content = read_content(path)
    try:
        figures: dict[str, Any] = json.loads(content)
        if figures["schema"] != "lrm/verification/1":
            raise KeyError("schema")
        _model(figures), _figures(figures)
    except (ValueError, KeyError, TypeError, IndexError):
        raise FileError(path, "", "is no result of lrm-ident verify --json") from None
    return figures
