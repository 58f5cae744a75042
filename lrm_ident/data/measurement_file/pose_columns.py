"""Optional columns of a measured pose: scatter per axis or covariance, orientation, joint feedback."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from lrm_ident.data.number_table import NumberTable
from lrm_ident.data.pose_table import angle_columns, full_turns
from lrm_ident.data.weights.rotations import rotation_matrix
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array

AXES, TURNS = "xyz", "uvw"
"""Coordinates of a pose's error: along x, y, z (mm), and the rotation vector about them (deg)."""
PER_AXIS = ("sx_mm", "sy_mm", "sz_mm")
POSITION_COVARIANCE = tuple(f"c{a}{b}_mm2" for a, b in combinations_with_replacement(AXES, 2))
CROSS_COVARIANCE = tuple(f"c{a}{u}_mmdeg" for a in AXES for u in TURNS)
TURN_COVARIANCE = tuple(f"c{u}{w}_deg2" for u, w in combinations_with_replacement(TURNS, 2))
TURN_SD = "srot_deg"
QUATERNION = ("qw", "qx", "qy", "qz")
UNIT_TOLERANCE = 0.01  # of a quaternion's length
SCATTER = (*PER_AXIS, *POSITION_COVARIANCE, *CROSS_COVARIANCE, *TURN_COVARIANCE, TURN_SD)
DEG = float(np.radians(1.0))


def feedback_columns(arm: Arm) -> tuple[str, ...]:
    """The columns of joint feedback."""
    return tuple(f"q{i + 1}_meas_deg" for i in range(arm.dof))


def read_covariance(table: NumberTable, sd: Array | None) -> Array | None:
    """(N, 6, 6), covariance of position and rotation vector (m, rad) of each pose; None if no column states any.

    `sd`: (N,), m per axis, of the column sd_mm or the file beside the data. Rows and columns of what is not stated are
    NaN. Raises `FileError`: half a covariance, or one that is not positive definite.
    """
    per_pose, turn = _position(table), _turn(table)
    position = per_pose
    if per_pose is None and sd is not None:
        position = np.broadcast_to(sd[:, None, None] ** 2 * np.eye(3), (len(table), 3, 3))
    if turn is not None and position is None:
        right = "give sd_mm, sx_mm …, or noise_sd_mm in the file beside the data"
        raise table.fault("header", "the orientation has a standard deviation, the position has none", right)
    if position is None or (turn is None and per_pose is None):
        return None
    out = np.full((len(table), 6, 6), np.nan)
    out[:, :3, :3] = position
    if turn is not None:
        out[:, 3:, 3:] = turn
        out[:, :3, 3:] = _cross(table)
        out[:, 3:, :3] = out[:, :3, 3:].transpose(0, 2, 1)
    size = 6 if turn is not None else 3
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", out[:, :size, :size]), 1e-300))
    least = np.linalg.eigvalsh(out[:, :size, :size] / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    if not (least > 1e-9).all():
        cells, row = table.cells, int(np.argmin(least))
        raise table.fault(cells.at(row, cells.header[0]), "its covariance is not positive definite")
    return out


def _position(table: NumberTable) -> Array | None:
    if (upper := table.optional(POSITION_COVARIANCE)) is not None:
        return _symmetric(upper * MM**2)
    per_axis = table.optional(PER_AXIS)
    return None if per_axis is None else np.asarray(np.einsum("ni,ij->nij", (per_axis * MM) ** 2, np.eye(3)))


def _turn(table: NumberTable) -> Array | None:
    upper = table.optional(TURN_COVARIANCE)
    if upper is not None:
        return _symmetric(upper * DEG**2)
    if TURN_SD in table:
        return np.asarray(np.einsum("n,ij->nij", (table.columns[TURN_SD] * DEG) ** 2, np.eye(3)))
    return None


def _cross(table: NumberTable) -> Array:
    crossed = table.optional(CROSS_COVARIANCE)
    return np.zeros((len(table), 3, 3)) if crossed is None else crossed.reshape(-1, 3, 3) * MM * DEG


def _symmetric(upper: Array) -> Array:
    """(N, 3, 3), matrices from their upper triangles (N, 6)."""
    out = np.empty((len(upper), 3, 3))
    for k, (i, j) in enumerate(combinations_with_replacement(range(3), 2)):
        out[:, i, j] = out[:, j, i] = upper[:, k]
    return out


def read_attitude(table: NumberTable) -> Array | None:
    """(N, 3, 3), rotation of the tool's frame, NaN where all four cells are empty; None without such columns.

    Raises `FileError`: a quaternion that is not of length one.
    """
    values = table.optional(QUATERNION)
    if values is None:
        return None
    table.reject_gaps(QUATERNION, "quaternion")
    length = np.linalg.norm(values, axis=1)
    table.reject(np.abs(length - 1.0) > UNIT_TOLERANCE, "qw", "the quaternion's length is not one")
    return rotation_matrix(values / length[:, None])


def read_feedback(table: NumberTable, arm: Arm) -> Array | None:
    """(N, n), what the joints' encoders read (rad), NaN where a cell is empty; None without such columns.

    An encoder that counts from 0 to 360 deg is read in the turn of the command.
    """
    columns = table.optional(feedback_columns(arm))
    if columns is None:
        return None
    read, stated, turn = np.radians(columns), np.radians(table.stack(angle_columns(arm))), 2.0 * np.pi
    return np.asarray(read + turn * np.round((full_turns(stated, arm)[0] - read) / turn))


def covariance_columns(covariance: Array) -> list[tuple[str, Array, int]]:
    """The columns of a covariance (N, 6, 6), m and rad; those of the orientation only where it is stated."""
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
