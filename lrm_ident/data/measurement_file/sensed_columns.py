"""Optional columns of a measured pose: scatter, orientation, joint feedback, distance from a fixed point.

Distances are those of a string potentiometer, or of a telescoping ball bar; positions may be missing beside them.
Goswami, Quaid & Peshkin 1993 (ball bar); Driels & Swayze 1994 (single wire draw).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np

from lrm_ident.data.csv_table import FEEDBACK, KnownColumns, NumberTable, columns_of_joints
from lrm_ident.data.measurement_file.metadata import Metadata
from lrm_ident.data.measurement_table import POSITION
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.pose_table import pose_columns
from lrm_ident.data.weights.rotations import rotation_matrix
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError

AXES, TURNS = "xyz", "uvw"
"""Coordinates of a pose's error: along x, y, z (mm), and the rotation vector about them (deg)."""
PER_AXIS = ("sx_mm", "sy_mm", "sz_mm")
POSITION_COVARIANCE = tuple(f"c{a}{b}_mm2" for a, b in combinations_with_replacement(AXES, 2))
CROSS_COVARIANCE = tuple(f"c{a}{u}_mmdeg" for a in AXES for u in TURNS)
TURN_COVARIANCE = tuple(f"c{u}{w}_deg2" for u, w in combinations_with_replacement(TURNS, 2))
TURN_SD = "srot_deg"
QUATERNION = ("qw", "qx", "qy", "qz")
DISTANCE, DISTANCE_SD = "distance_mm", "distance_sd_mm"
UNIT_TOLERANCE = 0.01  # of a quaternion's length
DEG = float(np.radians(1.0))
TOGETHER = {
    POSITION: "position",
    **dict.fromkeys((PER_AXIS, POSITION_COVARIANCE, CROSS_COVARIANCE, TURN_COVARIANCE), ""),
    QUATERNION: "quaternion",
}
"""Columns that are stated all or none, and what they are if a row states all of them or none."""


def measured_columns(arm: Arm, header: Sequence[str]) -> KnownColumns:
    """Columns of a measurement file with this header: beside a distance, a position may be empty."""
    commanded, feedback = pose_columns(arm), columns_of_joints(FEEDBACK, arm.dof)
    alone = {TURN_SD, DISTANCE, DISTANCE_SD, "supply_v", "sd_mm", "repeat_of"}
    together = {**commanded.together, **TOGETHER, feedback: ""}
    names = {*commanded.names, *alone, *(name for group in together for name in group)}
    may_be_empty = {*QUATERNION, *feedback, DISTANCE, "repeat_of", *(POSITION if DISTANCE in header else ())}
    return KnownColumns(names, may_be_empty, together, commanded.plausible)


def with_sensed(data: Measurements, table: NumberTable, metadata: Metadata) -> Measurements:
    """Positions with their scatter and what was measured beside them; notices say what is not used, and why.

    Raises `FileError`.
    """
    sd = table.columns["sd_mm"] * MM if "sd_mm" in table else None
    known = sd if sd is not None or data.noise_sd is None else np.full(len(table), data.noise_sd)
    covariance = _covariance(table, known)
    weighed, notices = covariance is not None or known is not None, list[str]()
    distance, distance_sd = _distance(table, metadata, data.tcp, weighed)
    if DISTANCE in table and distance is None:
        notices.append("the distances are not used: state distance_sd_mm, and the positions' sd_mm or noise_sd_mm")
    start = metadata.distance_from_mm
    if distance is not None and start is None:
        words = "the point that distances are measured from is not stated (distance_from_mm): it is estimated"
        notices.append(words)
    if not len(data.positions):
        notices.append("no positions: every error is that of a distance")
        covariance, known, sd, weighed = None, None, distance_sd, distance_sd is not None
    feedback, attitude, feedback_sd = read_feedback(table, data.poses.q), _attitude(table), metadata.feedback_sd_deg
    if attitude is not None and (covariance is None or np.isnan(covariance[0, 3, 3])):
        attitude = None
        notices.append("the orientation is not used: state its standard deviation in a column srot_deg")
    if feedback is not None and (feedback_sd is None or not weighed):
        feedback = None
        needed = "state feedback_sd_deg in the file beside the data, and the positions' standard deviation"
        notices.append(f"the joint feedback is not used: {needed} (sd_mm, noise_sd_mm)")
    beside = feedback is not None or distance is not None
    sd, covariance = _scatter(data.tcp, sd, distance_sd, known if beside else None, covariance)
    return replace(
        data,
        sd=sd,
        covariance=covariance,
        attitude=attitude,
        feedback=feedback,
        feedback_sd=None if feedback is None or feedback_sd is None else float(np.radians(feedback_sd)),
        distance=distance,
        distance_sd=distance_sd,
        distance_from=None if distance is None or start is None else np.array(start) * MM,
        notices=(*data.notices, *notices),
    )


def _scatter(
    tcp: Array, sd: Array | None, distance_sd: Array | None, alike: Array | None, covariance: Array | None
) -> tuple[Array | None, Array | None]:
    """Standard deviation (N,) and covariance (N, 6, 6) of positions `tcp` (N, 3), of lone distances else.

    `alike`: (N,), standard deviation along every axis, where a covariance is needed and may not be stated.
    """
    if covariance is None and alike is not None:
        covariance = np.full((len(alike), 6, 6), np.nan)
        covariance[:, :3, :3] = alike[:, None, None] ** 2 * np.eye(3)
    if covariance is None:
        return sd, None
    sd = np.sqrt(np.einsum("nii->n", covariance[:, :3, :3]) / 3.0)
    return sd if distance_sd is None else np.where(np.isnan(tcp[:, 0]), distance_sd, sd), covariance


def _distance(table: NumberTable, metadata: Metadata, tcp: Array, weighed: bool) -> tuple[Array | None, Array | None]:
    """Distances (N,) (m), NaN where not measured, None if not to be used, and their standard deviation (N,) or None.

    `weighed`: whether the positions `tcp` (N, 3) have a standard deviation. Raises `FileError`: rows with neither
    position nor distance, or of both kinds without their standard deviations.
    """
    sd = None if metadata.distance_sd_mm is None else np.full(len(table), metadata.distance_sd_mm * MM)
    if DISTANCE_SD in table:
        sd = table.columns[DISTANCE_SD] * MM
    if DISTANCE not in table:
        return None, None
    distance, gone = table.columns[DISTANCE] * MM, np.isnan(tcp[:, 0])
    table.cells.reject(np.isnan(distance) & gone, DISTANCE, "empty, and the row has no position either")
    if gone.all() or (sd is not None and weighed):
        return distance, sd
    if gone.any():
        right = "state the standard deviation of both: distance_sd_mm, and sd_mm or noise_sd_mm"
        raise FileError(table.cells.path, "header", "some rows have a position, others only a distance", right)
    return None, None


def _covariance(table: NumberTable, sd: Array | None) -> Array | None:
    """(N, 6, 6), covariance of position and rotation vector (m, rad) of each pose; None if no column states any.

    `sd`: (N,), m per axis, of the column sd_mm or the file beside the data. Rows and columns of what is not stated are
    NaN. Raises `FileError`: half a covariance, or one that is not positive definite.
    """
    parts, N = table.together, len(table)
    position = turn = None
    if POSITION_COVARIANCE in parts:
        position = _symmetric(parts[POSITION_COVARIANCE] * MM**2)
    elif PER_AXIS in parts:
        position = np.einsum("ni,ij->nij", (parts[PER_AXIS] * MM) ** 2, np.eye(3))
    if TURN_COVARIANCE in parts:
        turn = _symmetric(parts[TURN_COVARIANCE] * DEG**2)
    elif TURN_SD in table:
        turn = np.einsum("n,ij->nij", (table.columns[TURN_SD] * DEG) ** 2, np.eye(3))
    if position is None and turn is None:
        return None
    if position is None:
        if sd is None:
            what = "the orientation has a standard deviation, the position has none"
            right = "give sd_mm, sx_mm …, or noise_sd_mm in the file beside the data"
            raise FileError(table.cells.path, "header", what, right)
        position = sd[:, None, None] ** 2 * np.eye(3)
    out = np.full((N, 6, 6), np.nan)
    out[:, :3, :3] = position
    size = 3
    if turn is not None:
        size = 6
        out[:, 3:, 3:] = turn
        out[:, :3, 3:] = parts.get(CROSS_COVARIANCE, np.zeros((N, 9))).reshape(-1, 3, 3) * MM * DEG
        out[:, 3:, :3] = out[:, :3, 3:].transpose(0, 2, 1)
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", out[:, :size, :size]), 1e-300))
    least = np.linalg.eigvalsh(out[:, :size, :size] / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    if not (least > 1e-9).all():
        where = table.cells.at(int(np.argmin(least)), table.cells.header[0])
        raise FileError(table.cells.path, where, "its covariance is not positive definite")
    return out


def _symmetric(upper: Array) -> Array:
    """(N, 3, 3), matrices from their upper triangles (N, 6)."""
    out = np.empty((len(upper), 3, 3))
    for k, (i, j) in enumerate(combinations_with_replacement(range(3), 2)):
        out[:, i, j] = out[:, j, i] = upper[:, k]
    return out


def _attitude(table: NumberTable) -> Array | None:
    """(N, 3, 3), rotation of the tool's frame, NaN where all four cells are empty; None without such columns.

    Raises `FileError`: a quaternion that is not of length one.
    """
    values = table.together.get(QUATERNION)
    if values is None:
        return None
    length = np.linalg.norm(values, axis=1)
    table.cells.reject(np.abs(length - 1.0) > UNIT_TOLERANCE, "qw", "the quaternion's length is not one")
    return rotation_matrix(values / length[:, None])


def read_feedback(table: NumberTable, q: Array) -> Array | None:
    """(N, n), what the joints' encoders read (rad), NaN where a cell is empty; None without such columns.

    An encoder that counts from 0 to 360 deg is read in the turn of the command `q` (N, n).
    """
    columns = table.together.get(columns_of_joints(FEEDBACK, q.shape[1]))
    if columns is None:
        return None
    read, turn = np.radians(columns), 2.0 * np.pi
    return np.asarray(read + turn * np.round((q - read) / turn))
