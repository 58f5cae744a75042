"""Values that `figures.js` draws, as plain JSON: rounded values in the units of the screen."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from lrm_ident.data.wording import in_mm
from lrm_ident.report.diagnosis import MARKS
from lrm_ident.report.model_report import ModelReport
from lrm_ident.report.plots.interactive.candidate_view import CandidateView
from lrm_ident.residual.error_field import COLOURS, FieldStep
from lrm_math.arrays import Array

UM, ANGLE, SMALLEST_P = 3, 4, 1e-15
"""Decimals of millimetres and degrees in the drawing only, and the least p value that is printed."""


def figure_values(found: ModelReport) -> dict[str, Any]:
    """The values that all figures of one model are drawn from."""
    field, data = found.field, found.poses
    return {
        "pose": data.pose.tolist(),
        "poses": field.poses,
        "data": data.sha256,
        "compared": found.comparison is not None,
        "thinned": field.thinned,
        "q": rounded(np.degrees(data.poses.q), 2),
        "load": rounded(data.poses.payload * 1e3, 1),
        "tcp": rounded(np.where(np.isnan(data.tcp), field.bent[:, -1], data.tcp) * 1e3, UM),
        "nominal": rounded(field.nominal * 1e3, 1),
        "bent": rounded(field.bent * 1e3, 1),
        "scale": {
            "magnification": field.scale.magnification,
            "largest": field.scale.largest * 1e3,
            "words": field.scale.words,
            "colours": COLOURS,
        },
        "drivers": [
            {"name": one.name, "label": one.label, "values": rounded(one.shown, 4)} for one in found.covariates
        ],
        "steps": [_step(step) for step in field.steps],
        "history": [
            {"name": entry.step, "fit": entry.fit_rms_mm, "held": entry.held_out_rms_mm} for entry in found.file.history
        ],
        "floor": None if found.diagnosis is None else found.diagnosis.values["noise_floor_rms_mm"],
        "bound": None if found.diagnosis is None else found.diagnosis.values["noise_bound_rms_mm"],
        "marked": {why: list(numbers) for why, numbers in (found.marked or {}).items()},
        "where": _where(found),
        "ranking": [] if found.diagnosis is None else _ranking(found, found.diagnosis.values),
    }


def values_text(values: Mapping[str, Any]) -> str:
    """JSON that may stand in a `<script>` element."""
    return json.dumps(values, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def rounded(values: Array, decimals: int) -> Any:
    """Nested lists without NaN, which become null."""
    plain = np.round(values, decimals).astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _step(step: FieldStep) -> dict[str, Any]:
    return {
        "name": step.name,
        "rms": in_mm(step.error.rms),
        "residual": rounded(step.residual * 1e3, UM),
        "turns": rounded(np.degrees(step.turns), ANGLE),
    }


def _where(found: ModelReport) -> dict[str, Any]:
    """The joint and the driver that are shown first: those that the residual follows most."""
    factors = [] if found.comparison is None else found.comparison.values["factors"]
    names = {one.name: one for one in found.covariates}
    for factor in factors:  # type: ignore[attr-defined]
        driver = names.get(factor["name"])
        if driver is not None and driver.joint is not None:
            return {"joint": driver.joint, "driver": driver.name}
    return {"joint": 0, "driver": found.covariates[0].name if found.covariates else ""}


def _ranking(found: ModelReport, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    views = {view.name: view for view in found.candidates}
    out = []
    for advice in values["ranking"]:
        name = f"{advice['effect']}@{advice['place']}"
        if name in views:
            out.append(
                {
                    "name": name,
                    "verdict": advice["verdict"],
                    "mark": MARKS[advice["verdict"]],
                    "held": _held(advice, found.poses.several_kinds),
                    "heldOut": advice["held_out_rms_mm"],
                    "why": advice["why"],
                    "online": advice["online"],
                    "p": "< 1e-15" if advice["p_value"] < SMALLEST_P else f"= {advice['p_value']:.1g}",
                    "rivals": list(advice["indistinguishable_from"]),
                    "estimates": [
                        f"{key} = {one['value']:.4g}" + (f" ± {one['se']:.2g}" if one["se"] else "")
                        for key, one in advice["parameters"].items()
                    ],
                    **_candidate(views[name]),
                }
            )
    return out


def _held(advice: Mapping[str, Any], weighted: bool) -> str:
    """A held-out error in mm; ≈ if not refitted, then of all that was measured where that is more than positions."""
    value = in_mm(advice["held_out_rms_mm"] * 1e-3)
    return value if not advice["approximate"] else f"≈ {value} {'(all, weighted)' if weighted else ''}".rstrip()


def _candidate(view: CandidateView) -> dict[str, Any]:
    observable = view.observable
    return {
        "added": rounded(view.added * 1e3, UM),
        "turns": rounded(np.degrees(view.turns), ANGLE),
        "joint": view.joint,
        "driver": view.driver,
        "form": rounded(np.where(observable, np.degrees(view.form), np.nan), ANGLE),
        "around": rounded(np.where(observable, np.degrees(view.around), np.nan), ANGLE),
    }
