"""What machines read: the same figures as on the screen, units in every key."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lrm_ident.compare import Comparison, Factor, Group, HeldOut
from lrm_ident.dataset import Measurements
from lrm_ident.figures_of_merit import ErrorFigures, figures
from lrm_ident.fit import Fit
from lrm_ident.identifiability import Unidentifiable
from lrm_math.model import Model


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
