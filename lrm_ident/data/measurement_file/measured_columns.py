"""Measured columns of poses: positions, scatter, orientation, joint feedback, distance from a fixed point.

Positions of a lost or frozen tracker are left out; what is not used, or cannot be meant, is said.

Distances are those of a string potentiometer, or of a telescoping ball bar; positions may be missing beside them.
Goswami, Quaid & Peshkin 1993 (ball bar); Driels & Swayze 1994 (single wire draw).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.commanded_poses import pose_words
from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.rigid_motion import rotation_matrix
from lrm_ident.data.weights.whitening import position_sd
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

FINEST = 1e-5
"""Share of the reach: no tracker that arms are measured with is so exact."""
MOVED = 0.05  # share of the reach


def with_sensed(data: Measurements, table: NumberTable, metadata: Metadata) -> Measurements:
    """Positions with their scatter and what was measured beside them; notices say what is not used, and why.

    Raises `FileError`.
    """
    sd = table.column("sd")
    known = sd if sd is not None or data.noise_sd is None else np.full(len(table), data.noise_sd)
    covariance = _covariance(table, known)
    weighed, notices = covariance is not None or known is not None, [*_noise(data, sd)]
    distance, distance_sd = _distance(table, metadata, data.tcp, weighed)
    if "distance" in table and distance is None:
        notices.append("the distances are not used: state distance_sd_mm, and the positions' sd_mm or noise_sd_mm")
    start = metadata.distance_from_mm
    if distance is not None and start is None:
        notices.append("where distances are measured from is not stated (distance_from_mm): it is estimated")
    if not len(data.positions):
        notices.append("no positions: every error is that of a distance")
        covariance, known, sd, weighed = None, None, distance_sd, distance_sd is not None
    feedback, attitude, feedback_sd = read_feedback(table), None, metadata.feedback_sd_deg
    if "quaternion" in table and (covariance is None or np.isnan(covariance[0, 3, 3])):
        notices.append("the orientation is not used: state its standard deviation in a column srot_deg")
    elif "quaternion" in table:
        attitude = rotation_matrix(table["quaternion"] / np.linalg.norm(table["quaternion"], axis=1, keepdims=True))
    if feedback is not None and (feedback_sd is None or not weighed):
        feedback = None
        needed = "state feedback_sd_deg in the file beside the data, and the positions' standard deviation"
        notices.append(f"the joint feedback is not used: {needed} (sd_mm, noise_sd_mm)")
    if covariance is None and known is not None and (feedback is not None or distance is not None):
        covariance = np.full((len(table), 6, 6), np.nan)
        covariance[:, :3, :3] = _alike(known)
    if covariance is not None:
        sd = position_sd(covariance)
        sd = sd if distance_sd is None else np.where(np.isnan(data.tcp[:, 0]), distance_sd, sd)
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
        source=data.source.noting(*notices),
    )


def _distance(table: NumberTable, metadata: Metadata, tcp: Array, weighed: bool) -> tuple[Array | None, Array | None]:
    """Distances (N,) (m), NaN where not measured, None if not to be used, and their standard deviation (N,) or None.

    `weighed`: whether the positions `tcp` (N, 3) have a standard deviation. Raises `FileError`: rows with neither
    position nor distance, or of both kinds without their standard deviations.
    """
    distance, sd, gone = table.column("distance"), table.column("distance_sd"), np.isnan(tcp[:, 0])
    if distance is None:
        return None, None
    if sd is None and metadata.distance_sd_mm is not None:
        sd = np.full(len(table), metadata.distance_sd_mm * MM)
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
    position, turn = _block(table, "position_covariance", "sd_per_axis"), _block(table, "turn_covariance", "turn_sd")
    if position is None and turn is None:
        return None
    position = _alike(sd) if position is None and sd is not None else position
    if position is None:
        what = "the orientation has a standard deviation, the position has none"
        right = "give sd_mm, sx_mm …, or noise_sd_mm in the file beside the data"
        raise FileError(table.cells.path, "header", what, right)
    out = np.full((len(table), 6, 6), np.nan)
    out[:, :3, :3], size = position, 3
    if turn is not None:
        out[:, 3:, 3:], size = turn, 6
        crossed = table["cross_covariance"] if "cross_covariance" in table else np.zeros((len(table), 9))
        out[:, :3, 3:] = crossed.reshape(-1, 3, 3)
        out[:, 3:, :3] = out[:, :3, 3:].transpose(0, 2, 1)
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", out[:, :size, :size]), 1e-300))
    least = np.linalg.eigvalsh(out[:, :size, :size] / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    if not (least > 1e-9).all():
        place = f"line {table.cells.lines[int(np.argmin(least))]}, column {table.cells.columns[0].stated}"
        raise FileError(table.cells.path, place, "its covariance is not positive definite")
    return out


def _alike(sd: Array) -> Array:
    """(N, 3, 3), covariances of three axes that vary alone by sd (N,), (N, 1) or (N, 3)."""
    return np.asarray(sd.reshape(len(sd), -1)[:, :, None] ** 2 * np.eye(3))


def _block(table: NumberTable, covariance: str, sd: str) -> Array | None:
    """(N, 3, 3), covariances from their upper triangles or standard deviations; None if neither is stated."""
    if covariance not in table:
        return _alike(table[sd]) if sd in table else None
    out, (i, j) = np.empty((len(table), 3, 3)), np.triu_indices(3)
    out[:, i, j] = out[:, j, i] = table[covariance]
    return out


def read_feedback(table: NumberTable) -> Array | None:
    """(N, n), what the joints' encoders read (rad), NaN where a cell is empty; None without such columns.

    An encoder that counts from 0 to 360 deg is read in the turn of the command.
    """
    if "feedback" not in table:
        return None
    read, turn = table["feedback"], 2.0 * np.pi
    return np.asarray(read + turn * np.round((table["angles"] - read) / turn))


def _noise(data: Measurements, sd: Array | None) -> Iterator[str]:
    """Doubts about standard deviations: of the column `sd` (N,), or else of the file beside the data."""
    name, usual = ("noise_sd_mm", data.noise_sd or 0.0) if sd is None else ("sd_mm", float(np.median(sd)))
    if data.source.arm is not None and 0.0 < usual < FINEST * reach(data.source.arm):
        mm = usual / MM
        yield f"{name} is {mm:.3g} mm: no tracker is so exact; were it in metres, it would be {mm * 1e3:.3g} mm"
    if sd is not None and data.noise_sd is not None:
        yield "noise_sd_mm of the file beside the data is not used: the column sd_mm says the noise of each position"


def without_lost(data: Measurements) -> Measurements:
    """The measurements without positions that are exactly 0, 0, 0: a tracker writes them while it sees nothing.

    Raises `FileError` if all are.
    """
    lost = (data.tcp == 0.0).all(axis=1)
    if not lost.any():
        return data
    if lost.all():
        raise data.source.fault("every position is 0, 0, 0", "was the tracker on?")
    count = f"{int(lost.sum())} positions are exactly 0, 0, 0, as of a lost tracker"
    return _left_out(data, lost, f"{count}, and left out")


def without_frozen(arm: Arm, data: Measurements) -> Measurements:
    """The measurements without positions that are, to the last digit, those of the row before, while the arm moved."""
    same = np.flatnonzero((np.diff(data.tcp, axis=0) == 0.0).all(axis=1)) + 1
    if not len(same):
        return data
    drawn = solve_equilibrium(model_of(arm, ()), data.poses.take(np.concatenate([same - 1, same]))).tcp
    away = np.linalg.norm(drawn[len(same) :] - drawn[: len(same)], axis=1) > MOVED * reach(arm)
    if not away.any():
        return data
    words = "the position stands still while the arm moves, as of a frozen tracker; left out"
    return _left_out(data, same[away], words)


def _left_out(data: Measurements, rows: NDArray[np.int64] | NDArray[np.bool_], why: str) -> Measurements:
    """The measurements without some rows, with a notice that says why and names their poses."""
    gone = data.pose[rows]
    return data.without(gone.tolist()).noting(f"{why}: {pose_words(gone)}")
