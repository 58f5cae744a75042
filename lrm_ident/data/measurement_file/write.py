"""Measurements as CSV text, and the metadata beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import combinations_with_replacement

import numpy as np
import tomli_w

from lrm_ident.data.measurement_file.commanded_poses import after_gap
from lrm_ident.data.measurement_file.known_columns import (
    CROSS_COVARIANCE,
    DEG,
    DISTANCE,
    POSITION_COVARIANCE,
    QUATERNION,
    TURN_COVARIANCE,
)
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.rotations import quaternions
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array


def csv_text(columns: Iterable[tuple[str, Array, int]]) -> str:
    """CSV text of (name, values (N,), decimals)."""
    named = list(columns)
    head = ",".join(name for name, _, _ in named)
    lines = (
        ",".join(
            "" if math.isnan(value) else f"{value:.{decimals}f}"
            for value, (_, _, decimals) in zip(row, named, strict=True)
        )
        for row in zip(*(values for _, values, _ in named), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"


def measurements_csv(data: Measurements) -> str:
    """CSV text of measurements, with the optional columns that they have."""
    columns: list[tuple[str, Array, int]] = [("pose", data.pose.astype(np.float64), 0)]
    optional = (("t_s", data.poses.t, 1.0, 3), ("session", data.poses.session, 1.0, 0))
    columns += [(name, values / unit, digits) for name, values, unit, digits in optional if values is not None]
    columns.append(("payload_g", data.poses.payload / GRAM, 4))
    columns += [(f"q{i + 1}_deg", np.degrees(data.poses.q[:, i]), 9) for i in range(data.poses.q.shape[1])]
    if len(data.positions):
        columns += [(name, data.tcp[:, i] / MM, 6) for i, name in enumerate(("x_mm", "y_mm", "z_mm"))]
    if data.poses.temperature is not None:
        columns.append(("temp_c", data.poses.temperature, 3))
    columns += _scatter_columns(data)
    columns.append(("repeat_of", data.repeat_of.astype(np.float64), 0))
    if data.poses.direction is not None and after_gap(data.pose).any():  # what the rows alone do not say any more
        columns += [(f"approach{i + 1}", side, 0) for i, side in enumerate(data.poses.direction.T)]
    return csv_text(columns)


def metadata_toml(arm: str, source: str, **known: object) -> str:
    """Text of the file beside measurements of an arm; `known`: what else it states, None for what it does not."""
    about = {"schema": "lrm/measurements/1", "arm": arm, "source": source, **known}
    return tomli_w.dumps({key: value for key, value in about.items() if value is not None})


def _scatter_columns(data: Measurements) -> list[tuple[str, Array, int]]:
    """Optional columns of scatter, orientation, feedback and distance."""
    out: list[tuple[str, Array, int]] = []
    if data.covariance is not None:
        out += _covariance_columns(data.covariance)
    elif data.sd is not None and len(data.positions):
        out.append(("sd_mm", data.sd / MM, 6))
    if data.attitude is not None:
        out += [(name, column, 9) for name, column in zip(QUATERNION, quaternions(data.attitude).T, strict=True)]
    if data.feedback is not None:
        out += [(f"q{i + 1}_meas_deg", np.degrees(column), 6) for i, column in enumerate(data.feedback.T)]
    if data.distance is not None:
        out.append((DISTANCE, data.distance / MM, 6))
        if data.distance_sd is not None:
            out.append(("distance_sd_mm", data.distance_sd / MM, 6))
    return out


def _covariance_columns(covariance: Array) -> list[tuple[str, Array, int]]:
    """Columns of a covariance (N, 6, 6), m and rad; those of the orientation only where it is stated."""
    turns = not np.isnan(covariance[0, 3, 3])
    units = np.array([MM] * 3 + [DEG] * 3)
    scaled = covariance / np.outer(units, units)
    upper = list(combinations_with_replacement(range(3), 2))
    out = [(name, scaled[:, i, j], 9) for name, (i, j) in zip(POSITION_COVARIANCE, upper, strict=True)]
    if turns:
        crossed = [(i, 3 + j) for i in range(3) for j in range(3)]
        out += [(name, scaled[:, i, j], 9) for name, (i, j) in zip(CROSS_COVARIANCE, crossed, strict=True)]
        out += [(name, scaled[:, 3 + i, 3 + j], 9) for name, (i, j) in zip(TURN_COVARIANCE, upper, strict=True)]
    return out
