"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS, read_joints, read_positions, turn_of
from lrm_ident.data.csv_table import CsvTable, require
from lrm_ident.data.measurement_file.distance_columns import DISTANCE, DISTANCE_SD, read_distances
from lrm_ident.data.measurement_file.metadata import NOTHING_STATED, Metadata, metadata_of
from lrm_ident.data.measurement_file.pose_columns import (
    QUATERNION,
    SCATTER,
    feedback_columns,
    read_attitude,
    read_covariance,
    read_feedback,
)
from lrm_ident.data.measurement_file.row_checks import doubtful, without_lost
from lrm_ident.data.measurement_table import ANGLES, POSITION, in_joint_order, read_measurement_table
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.number_table import NumberTable, read_numbers, without_bad_rows
from lrm_ident.data.output_files import is_something_else
from lrm_ident.data.pose_table import angle_columns, pose_columns, read_poses
from lrm_ident.data.table_text.csv_dialect import encoding_of, is_workbook
from lrm_ident.data.weights.rotations import turned_covariance
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import schema_of

OWN = {*POSITION, *SCATTER, *QUATERNION, DISTANCE, DISTANCE_SD, "supply_v", "sd_mm", "repeat_of"}
"""Columns of measurements beside those of poses and of joint feedback."""


def load_measurements(path: Path, arm: Arm, reading: Reading | None = None) -> Measurements:
    """Reads measurements of an arm.

    Args:
        reading: how to read the numbers; what it leaves open, the file beside the data says, else the columns' names.

    Raises `FileError`: naming file, line and column of the first fault (`BeyondLimits`: of a joint).
    """
    metadata = metadata_of(path) or NOTHING_STATED
    how = (reading or AS_NAMED).over(metadata)
    cells = read_measurement_table(path, how, [joint.name for joint in arm.joints])
    positions = DISTANCE not in cells.header or bool({*POSITION} & {*cells.header})
    cells = require(cells, [*_angle_columns(cells, arm, how), *(POSITION if positions else ())])
    feedback = feedback_columns(arm)
    gaps = {*QUATERNION, *feedback, DISTANCE, "repeat_of", *(POSITION if DISTANCE in cells.header else ())}
    known = {*OWN, *pose_columns(arm), *feedback}
    start, notices, stated = _start(path, metadata, arm, how), _notices(cells, known), _stated(cells, how)
    cells = in_joint_order(cells, how)
    cells, skipped = without_bad_rows(cells, known, gaps, how.bad_rows == "skip")
    table = read_numbers(cells, known, gaps)
    pose = table.whole("pose")
    _check_once(table, pose)
    tcp = np.full((len(table), 3), np.nan)
    if positions:
        table.reject_gaps(POSITION, "position")
        tcp = read_positions(how, table.stack(POSITION) * MM)
    noise = None if metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM
    parts, unused = _sensed_parts(table, arm, how, metadata, tcp, noise)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    data = Measurements(
        poses=replace(read_poses(table, arm, how, start), sha256=sha256),
        pose=pose,
        tcp=tcp,
        noise_sd=noise,
        repeat_of=_repeats(table, pose),
        path=path,
        sha256=sha256,
        notices=(*notices, *skipped, *doubtful(table, arm, metadata), *unused),
        arm=arm,
        reading=Reading(**how.said()),
        stated=stated,
        **parts,
    )
    return without_lost(data, table) if positions else data


def _sensed_parts(
    table: NumberTable, arm: Arm, how: Reading, metadata: Metadata, tcp: Array, noise: float | None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Parts measured beside positions `tcp`, and all scatter, as attributes of measurements; why some are not used.

    `noise`: standard deviation of all positions (m).
    """
    sd = table.columns["sd_mm"] * MM if "sd_mm" in table else None
    known = sd if sd is not None or noise is None else np.full(len(table), noise)
    covariance = read_covariance(table, known)
    weighed = covariance is not None or known is not None
    found, notices = read_distances(table, metadata, how, tcp, weighed), list[str]()
    if np.isnan(tcp).all():
        notices.append("no positions: every error is that of a distance")
        covariance, known, sd, weighed = None, None, found.sd, found.sd is not None
    attitude, feedback, feedback_sd = read_attitude(table), read_feedback(table, arm), metadata.feedback_sd_deg
    if attitude is not None and (covariance is None or np.isnan(covariance[0, 3, 3])):
        attitude = None
        notices.append("the orientation is not used: state its standard deviation in a column srot_deg")
    if feedback is not None and (feedback_sd is None or not weighed):
        feedback = None
        needed = "state feedback_sd_deg in the file beside the data, and the positions' standard deviation"
        notices.append(f"the joint feedback is not used: {needed} (sd_mm, noise_sd_mm)")
    if covariance is None and known is not None and (feedback is not None or found.distance is not None):
        covariance = np.full((len(known), 6, 6), np.nan)
        covariance[:, :3, :3] = known[:, None, None] ** 2 * np.eye(3)
    if covariance is not None:
        turn = turn_of(how)
        if np.linalg.det(turn) < 0 and attitude is not None:
            raise table.fault("", "an orientation in a mirrored frame", "no rotation does that; check --axes")
        covariance = turned_covariance(covariance, turn)
        attitude = None if attitude is None else turn @ attitude
        sd = np.sqrt(np.einsum("nii->n", covariance[:, :3, :3]) / 3.0)
        if found.distance is not None and found.sd is not None:
            sd = np.where(np.isnan(tcp[:, 0]), found.sd, sd)
    return {
        "sd": sd,
        "covariance": covariance,
        "attitude": attitude,
        "feedback": feedback,
        "feedback_sd": None if feedback is None or feedback_sd is None else float(np.radians(feedback_sd)),
        "distance": found.distance,
        "distance_sd": None if found.distance is None else found.sd,
        "distance_from": found.start,
    }, (*found.notices, *notices)


def _stated(table: CsvTable, how: Reading) -> Reading:
    """The reading with the units of the columns where it names none."""
    units = {metres / MM: unit for unit, metres in LENGTH_UNITS.items()}
    turns = {radians / ANGLE_UNITS["deg"]: unit for unit, radians in ANGLE_UNITS.items()}
    unit, turn = units[table.factors.get("x_mm", 1.0)], turns[table.factors.get("q1_deg", 1.0)]
    return Reading(**{"unit": unit, "angle_unit": turn, **how.said()})


def _angle_columns(table: CsvTable, arm: Arm, how: Reading) -> list[str]:
    """The columns of the arm's joints. Raises `FileError` if the file or the reading has another number of joints."""
    for name, values in (("joint_sign", how.joint_sign), ("joint_order", how.joint_order)):
        if values is not None and len(values) != arm.dof:
            raise FileError(table.path, "", f"{name} has {len(values)} joints", f"{arm.name} has {arm.dof}")
    angles = angle_columns(arm)
    more = [name for name in table.header if ANGLES.fullmatch(name) and name not in angles]
    if more:
        count = sum(1 for name in table.header if ANGLES.fullmatch(name))
        raise FileError(table.path, "header", f"{count} joints, {arm.name} has {arm.dof}", "is this another arm?")
    return angles


def _start(path: Path, metadata: Metadata, arm: Arm, how: Reading) -> Array | None:
    """(n,), joint angles before the first pose (rad), or None. Raises `FileError`."""
    if metadata.start_q_deg is None:
        return None
    if len(metadata.start_q_deg) != arm.dof:
        what = f"{len(metadata.start_q_deg)} angles"
        raise FileError(path.with_suffix(".toml"), "start_q_deg", what, f"should be {arm.dof}")
    return read_joints(how, np.radians(metadata.start_q_deg))


def load_poses(file: str | Path, arm: Arm, reading: Reading | None = None) -> Poses:
    """Reads commanded poses: `q1_deg` …, optional `payload_g`, `t_s`, `session`, `temp_c`, `approach`.

    Args:
        reading: as in `load_measurements`.

    Raises `FileError`.
    """
    path = Path(file)
    how = (reading or AS_NAMED).over(metadata_of(path))
    cells = read_measurement_table(path, how, [joint.name for joint in arm.joints])
    table = read_numbers(in_joint_order(require(cells, _angle_columns(cells, arm, how)), how), pose_columns(arm))
    return replace(read_poses(table, arm, how), sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""
    return bool({*POSITION, DISTANCE} & set(read_measurement_table(path).header))


def read_pose_feedback(path: Path, arm: Arm) -> tuple[Array | None, float | None]:
    """Readings of the encoders at the poses of a file, (N, n) in rad, and its standard deviation as stated (deg).

    Raises `FileError`.
    """
    metadata, columns = metadata_of(path) or NOTHING_STATED, feedback_columns(arm)
    how = AS_NAMED.over(metadata)
    cells = in_joint_order(read_measurement_table(path, how), how)
    return read_feedback(read_numbers(cells, {*columns, *angle_columns(arm)}, columns), arm), metadata.feedback_sd_deg


def _check_once(table: NumberTable, pose: NDArray[np.int64]) -> None:
    first: dict[int, int] = {}
    for row, number in enumerate(pose.tolist()):
        if first.setdefault(number, row) != row:
            what = f"pose {number} stands in line {table.cells.lines[first[number]]} already"
            right = "each row has its own number; name a repetition in the column repeat_of"
            raise table.fault(table.cells.at(row, "pose"), what, right)


def _repeats(table: NumberTable, pose: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,), number of the pose that each row repeats; its own where the cell is empty."""
    if "repeat_of" not in table:
        return pose
    stated = table.columns["repeat_of"]
    repeat = np.where(np.isnan(stated), pose, np.nan_to_num(stated)).astype(np.int64)
    unknown = ~np.isin(repeat, pose)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise table.fault(table.cells.at(row, "repeat_of"), f"there is no pose {repeat[row]}")
    return repeat


def _converted(table: CsvTable, ours: str) -> str:
    factor = table.factors.get(ours, 1.0)
    return "" if factor == 1.0 else f" times {factor:.6g}"


def _notices(table: CsvTable, known: Collection[str]) -> list[str]:
    unknown = [name for name in table.header if name and name not in known]
    notices = [f"columns not used: {', '.join(unknown)}"] if unknown else []
    taken = {
        ours: f"{ours} = '{name}'{_converted(table, ours)}"
        for ours, name in table.stated.items()
        if ours in known and (table.factors.get(ours, 1.0) != 1.0 or not name.lower().startswith(ours))
    }
    if taken:
        notices.append("read as: " + ", ".join(taken.values()))
    sidecar = table.path.with_suffix(".toml")
    if sidecar.is_file() and is_something_else(sidecar):
        notices.append(f"{sidecar.name} beside it is {schema_of(sidecar)}, so it says nothing of these data")
    content = table.path.read_bytes()
    if is_workbook(content):
        return [*notices, "read from the first sheet of the workbook"]
    if encoding_of(content) == "cp1252":
        notices.append("read as Windows-1252 (Latin-1), as it is not UTF-8")
    if not content.endswith(b"\n"):
        notices.append("the last line does not end; is the file complete?")
    return notices
