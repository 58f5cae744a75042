"""What machines read: the same figures as on the screen, units in every key."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import Course
from lrm_ident.diagnosis.diagnosis_report import Advice, Report
from lrm_ident.diagnosis.inject_recover import Trial
from lrm_ident.fit.error_breakdown import Comparison, Factor, Group, HeldOut
from lrm_ident.fit.identifiability import Unidentifiable
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_math.model.model import Model

RANKED = 30


def fit_json(
    fit: Fit, held: tuple[Unidentifiable, ...], nominal: ErrorFigures, held_out: HeldOut, data: Measurements
) -> dict[str, Any]:
    """Result of `lrm-ident fit`, schema `lrm/fit/1`."""
    return {
        "schema": "lrm/fit/1",
        "poses": len(data),
        "parameters": len(fit.model.free),
        "error": _errors(nominal, figures(fit.residual), held_out),
        "residual_sd_per_axis_mm": fit.sigma * 1e3,
        "steps": fit.steps,
        "estimates": {key: _estimate(fit, j) for j, key in enumerate(fit.model.free)},
        "correlation": {"keys": list(fit.model.free), "matrix": np.round(fit.correlation, 6).tolist()},
        "held_at_zero": [_held(fit.model, parameter) for parameter in held],
        "outliers": [
            {"pose": int(data.pose[row]), "error_mm": float(np.linalg.norm(fit.residual[row]) * 1e3)}
            for row in fit.outliers
        ],
    }


def comparison_json(comparison: Comparison, data: Measurements) -> dict[str, Any]:
    """Result of `lrm-ident compare`, schema `lrm/comparison/1`."""
    return {
        "schema": "lrm/comparison/1",
        "poses": len(data),
        "parameters": len(comparison.rest.model.free),
        "error": _errors(comparison.nominal, comparison.error, comparison.held_out),
        "factors": [_factor(factor) for factor in comparison.factors],
        "worst_poses": [
            {
                "pose": int(data.pose[row]),
                "q_deg": np.round(np.degrees(data.poses.q[row]), 6).tolist(),
                "payload_g": float(data.poses.payload[row] * 1e3),
                "error_mm": float(np.linalg.norm(comparison.residual[row]) * 1e3),
                "residual_mm": (comparison.residual[row] * 1e3).tolist(),
            }
            for row in comparison.worst
        ],
    }


def text(tables: dict[str, Any]) -> str:
    """JSON text without NaN."""
    return json.dumps(tables, indent=1, allow_nan=False) + "\n"


def _errors(nominal: ErrorFigures, fitted: ErrorFigures, held_out: HeldOut) -> dict[str, Any]:
    out: dict[str, Any] = {"nominal": nominal.as_json(), "fit": fitted.as_json()}
    out["held_out"] = None if held_out.error is None else held_out.error.as_json()
    return out | ({"held_out_reason": held_out.reason} if held_out.error is None else {})


def _estimate(fit: Fit, j: int) -> dict[str, Any]:
    key = fit.model.free[j]
    unit = fit.model.parameters[fit.model.position(key)].si
    bound = key in fit.at_bound
    error = None if bound else float(fit.standard_error[j] / unit)
    return {"value": fit.model.value(key) / unit, "se": error, "at_bound": bound}


def _held(model: Model, parameter: Unidentifiable) -> dict[str, Any]:
    unit = model.parameters[model.position(parameter.key)].si
    error = None if np.isinf(parameter.standard_error) else parameter.standard_error / unit
    return {
        "parameter": parameter.key,
        "survival": parameter.survival,
        "se_if_fitted": error,
        "moves_the_tcp_like": dict(parameter.combination),
    }


def _factor(factor: Factor) -> dict[str, Any]:
    groups = [_group(group) for group in factor.groups]
    return {"kind": factor.kind, "name": factor.name, "share": factor.share, "groups": groups}


def _group(group: Group) -> dict[str, Any]:
    bias = [component * 1e3 for component in group.bias]
    turn = {} if group.acts_like is None else {"acts_like_deg": float(np.degrees(group.acts_like))}
    return {"label": group.label, "poses": group.count, **group.error.as_json(), "bias_mm": bias, **turn}


def diagnosis_json(report: Report, catalogue_size: int = RANKED) -> dict[str, Any]:
    """Result of `lrm-ident diagnose`, schema `lrm/diagnosis/1`."""
    found = report.diagnosis
    return {
        "schema": "lrm/diagnosis/1",
        "poses": len(found.data),
        "parameters": len(found.fit.model.free),
        "error": {"fit": report.fit.as_json(), "held_out": report.held_out.as_json()},
        "noise_floor_rms_mm": None if found.floor.rms is None else found.floor.rms * 1e3,
        "noise_floor_source": found.floor.source,
        "structure": {
            "moran_i": found.structure.moran_i,
            "p_value": found.structure.p_value,
            "order_p_value": found.structure.order_p_value,
        },
        "verdict": report.verdict,
        "ranking": [_advice(rank, advice, report) for rank, advice in enumerate(report.ranking[:catalogue_size], 1)],
        "unexplained": [{"acts_like": f.name, "joint": f.joint + 1, "follows": list(f.follows)} for f in found.free],
        "anatomy": [
            {"joint": function.joint + 1, "follows": list(function.follows), "held_out_rms_mm": rms * 1e3}
            for function, rms in found.anatomy
        ],
        "outliers": list(found.outliers),
        "audit": list(report.traps),
        "not_testable": [
            {
                "effect": e.id,
                "place": e.place,
                "reason": why,
                "would_need": e.needs or "poses where it moves the TCP more",
            }
            for e, why in found.not_testable
        ],
        "next_poses_hint": report.hint,
    }


def _advice(rank: int, advice: Advice, report: Report) -> dict[str, Any]:
    effect = advice.scored.candidate.effect
    return {
        "rank": rank,
        "effect": effect.id,
        "place": effect.place,
        "verdict": advice.verdict,
        "held_out_rms_mm": advice.held_out_rms * 1e3,
        "approximate": not advice.exact,
        "gain_mm": (report.held_out.rms - advice.held_out_rms) * 1e3,
        "p_value": min(1.0, report.diagnosis.adjusted[advice.scored.name]),
        "parameters": {name: {"value": value, "se": error} for name, value, error in advice.estimates},
        "indistinguishable_from": list(advice.rivals),
        "online": effect.online,
        "why": advice.why,
    }


def before_and_after(
    was: ErrorFigures, left_before: HeldOut, now: ErrorFigures, left_after: HeldOut
) -> dict[str, dict[str, Any]]:
    """Errors of one step."""
    return {
        name: {"fit": fitted.as_json(), "held_out": None if left.error is None else left.error.as_json()}
        for name, fitted, left in (("before", was, left_before), ("after", now, left_after))
    }


def course_json(course: Course, held_out: HeldOut, nested: HeldOut) -> dict[str, Any]:
    """Result of `lrm-ident auto`, schema `lrm/course/1`."""
    return {
        "schema": "lrm/course/1",
        "steps": [
            {
                "added": step.added,
                "indistinguishable_from": list(step.rivals),
                "parameters": len(step.fit.model.free),
                "fit_rms_mm": figures(step.fit.residual).rms * 1e3,
            }
            for step in course.steps
        ],
        "verdict": course.last.verdict,
        "held_out_effects_fixed": None if held_out.error is None else held_out.error.as_json(),
        "held_out": None if nested.error is None else nested.error.as_json(),
    }


def trial(trial: Trial) -> dict[str, Any]:
    """One injection of `lrm-ident selftest`."""
    moved = None if np.isnan(trial.moved) else trial.moved * 1e3
    return {"truth": trial.truth, "moved_rms_mm": moved, "outcome": trial.outcome, "named": list(trial.named)}
