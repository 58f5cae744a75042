"""Measurements as CSV text."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.csv_table import csv_text
from lrm_ident.data.measurement_file.distance_columns import DISTANCE, DISTANCE_SD
from lrm_ident.data.measurement_file.pose_columns import QUATERNION, covariance_columns
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.pose_table import after_gap
from lrm_ident.data.weights.rotations import quaternions
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array


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


def _scatter_columns(data: Measurements) -> list[tuple[str, Array, int]]:
    """Optional columns of scatter, orientation, feedback and distance."""
    out: list[tuple[str, Array, int]] = []
    if data.covariance is not None:
        out += covariance_columns(data.covariance)
    elif data.sd is not None and len(data.positions):
        out.append(("sd_mm", data.sd / MM, 6))
    if data.attitude is not None:
        out += [(name, column, 9) for name, column in zip(QUATERNION, quaternions(data.attitude).T, strict=True)]
    if data.feedback is not None:
        out += [(f"q{i + 1}_meas_deg", np.degrees(column), 6) for i, column in enumerate(data.feedback.T)]
    if data.distance is not None:
        out.append((DISTANCE, data.distance / MM, 6))
        if data.distance_sd is not None:
            out.append((DISTANCE_SD, data.distance_sd / MM, 6))
    return out
