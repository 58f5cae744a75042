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


def verification_document(found: Verification, earlier: Mapping[str, Any] | None) -> Document:
    """Result of `lrm-ident verify`, schema `lrm/verification/1`; `earlier`: that of another model at the same goals."""
    now = values(found)
    rows = [(name, _model(of), *_figures(of)) for name, of in (("before", earlier), ("now", now)) if of is not None]
    title = f"Where the tip landed: {len(found.attained)} goals, mm from the goal"
    blocks: list[Block] = [ResultTable(("", "model", *FIGURES), rows, title)]
    if len(found.places) > 1:
        parts = [(place, found.at(place)) for place in found.places]
        by_place = [(place, len(part.attained), *_figures(values(part))) for place, part in parts]
        blocks.append(ResultTable(("at the", "goals|d", *FIGURES), by_place, "By place, mm from the goal"))
    if found.turn is not None:
        blocks.append(f"The tool is {degrees(found.turn):.2f} deg RMS off the orientation of its goals.")
    blocks += [f"not reached: goal {number}: {why}" for number, why in found.failed.items()]
    return Document([*blocks, *unlike_the_model(found)], "lrm/verification/1", now, goal_table(found.attained))


def unlike_the_model(found: Verification) -> list[str]:
    """A line if the tip landed far beyond what the model itself expects: its arm is not the one that moved."""
    if found.predicted is None or found.error.rms < UNLIKE * found.predicted:
        return []
    return [
        f"The tip lands {found.error.rms / found.predicted:.0f} times as far from its goals as the model predicts "
        f"({in_mm(found.error.rms)} mm RMS in place of {in_mm(found.predicted)}): an effect is missing from the "
        "model (lrm-ident diagnose), or this is not the arm that was measured any more: a servo without force, another "
        "load, a target or a base that moved."
    ]


def _model(found: Mapping[str, Any]) -> str:
    return found["model_sha256"][:12] or "nominal"


def _figures(found: Mapping[str, Any]) -> tuple[Any, ...]:
    """Cells of `FIGURES` from the values of the JSON file."""
    error = found["error"]
    return error["mean_mm"], error["rms_mm"], error["max_mm"], found["rounding_rms_mm"], found["predicted_rms_mm"]


def values(found: Verification) -> dict[str, Any]:
    """The values of the JSON file."""
    error, predicted = found.error, found.predicted
    return {
        "model": found.model,
        "model_sha256": found.model_sha256,
        "error": {f"{name}_mm": getattr(error, name) * MM_PER_M for name in ("mean", "rms", "max", "sd")},
        "rounding_rms_mm": found.rounding * MM_PER_M,
        "predicted_rms_mm": None if predicted is None else predicted * MM_PER_M,
        "angle_rms_deg": None if found.turn is None else degrees(found.turn),
        "goals": goal_table(found.attained).records(),
        "not_reached": {str(number): why for number, why in found.failed.items()},
    }


def goal_table(attained: Sequence[AttainedPosition]) -> ResultTable:
    """One row per goal: goal, tip and error in mm."""
    axes = [f"{what}{axis}_mm|.3f" for what in ("goal_", "") for axis in "xyz"]
    columns = ["goal|d", "place", *axes, "error_mm|.3f", "rounding_mm|.3f", "predicted_sd_mm|.3f", "measured_sd_mm|.3f"]
    rows: list[tuple[object, ...]] = [
        (
            one.number, one.place, *(MM_PER_M * v for v in (*one.goal, *one.tip)), MM_PER_M * one.error,
            MM_PER_M * one.rounding, None if one.sd is None else MM_PER_M * one.sd, MM_PER_M * one.spread,
        )
        for one in attained
    ]  # fmt: skip
    angles = [None if one.turn is None else degrees(one.turn) for one in attained]
    if any(angle is not None for angle in angles):
        columns = [*columns, "angle_deg|.3f"]
        rows = [(*row, angle) for row, angle in zip(rows, angles, strict=True)]
    return ResultTable(columns, rows)


def read_verification(path: Path) -> dict[str, Any]:
    """An earlier result. Raises `FileError`: no such file, or no result of `verify`."""
    content = read_content(path)
    try:
        found: dict[str, Any] = json.loads(content)
        if found["schema"] != "lrm/verification/1":
            raise KeyError("schema")
        _model(found), _figures(found)
    except (ValueError, KeyError, TypeError, IndexError):
        raise FileError(path, "", "is no result of lrm-ident verify --json") from None
    return found
