"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS, read_joints, read_positions
from lrm_ident.data.csv_table import CsvTable, require
from lrm_ident.data.measurement_file.distance_columns import (
    DISTANCE,
    DISTANCE_SD,
    check_alike,
    read_anchor,
    read_distance,
    read_distance_sd,
    read_tcp,
)
from lrm_ident.data.measurement_file.metadata import Metadata, metadata_of
from lrm_ident.data.measurement_file.pose_columns import (
    QUATERNION,
    SCATTER,
    feedback_columns,
    read_attitude,
    read_covariance,
    read_feedback,
)
from lrm_ident.data.measurement_table import ANGLES, POSITION, numbered, read_measurement_table
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.output_files import is_something_else
from lrm_ident.data.pose_table import in_units, poses_of_table, read_angles, read_whole
from lrm_ident.data.weights.rotations import turned_covariance
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import schema_of

OPTIONAL = ("t_s", "session", "payload_g", "temp_c", "supply_v", "sd_mm", "repeat_of", "approach")


def load_measurements(path: Path, arm: Arm, reading: Reading | None = None) -> Measurements:
    """Reads measurements of an arm.

    Args:
        reading: how to read the numbers; what it leaves open, the file beside the data says, else the columns' names.

    Raises `FileError`: naming file, line and column of the first fault (`BeyondLimits`: of a joint).
    """
    metadata = metadata_of(path)
    how = (reading or AS_NAMED).over(metadata)
    table = in_units(numbered(read_measurement_table(path)), how)
    angles = _angle_columns(table, arm, how)
    require(table, ["pose", *angles, *(() if DISTANCE in table.header else POSITION)])
    pose = read_whole(table, "pose")
    _check_once(table, pose)
    q = read_angles(table, arm, how)
    known = {name: table.numbers(name) for name in OPTIONAL if name in table.header}
    start = _start(path, metadata, arm, how)
    sd = known.get("sd_mm")
    if sd is not None:
        table.reject(sd <= 0, "sd_mm", "not above zero")
    noise = None if metadata is None or metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM
    tcp = read_tcp(table, how)
    more, unused = _more_parts(table, arm, how, metadata, tcp, None if sd is None else sd * MM, noise)
    return Measurements(
        poses=poses_of_table(table, q, known, pose, start, how),
        pose=pose,
        tcp=tcp,
        noise_sd=noise,
        repeat_of=_repeats(table, pose),
        path=path,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        notices=(*_notices(table, [*angles, *_sides(arm), "pose", *POSITION, *OPTIONAL, *_pose_columns(arm)]), *unused),
        arm=arm,
        reading=Reading(**how.said()),
        stated=_stated(table, how),
        **more,
    )


def _pose_columns(arm: Arm) -> tuple[str, ...]:
    return (*SCATTER, *QUATERNION, *feedback_columns(arm), DISTANCE, DISTANCE_SD)


def _more_parts(
    table: CsvTable,
    arm: Arm,
    how: Reading,
    metadata: Metadata | None,
    tcp: Array,
    sd: Array | None,
    noise: float | None,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """What was measured beside positions `tcp` and their scatter, as attributes of measurements, and why some are not
    used.

    `sd`, `noise`: of the column sd_mm, and for all poses (m).
    """
    known = sd if sd is not None or noise is None else np.full(len(table.rows), noise)
    covariance, distance_sd = read_covariance(table, known), read_distance_sd(table, metadata)
    weighed = covariance is not None or known is not None
    distance, notices = _used_distance(table, metadata, tcp, weighed)
    if np.isnan(tcp).all():
        notices.append("no positions: every error is that of a distance")
        covariance, known, sd, weighed = None, None, distance_sd, distance_sd is not None
    attitude, of_attitude = _used_attitude(table, covariance)
    feedback, feedback_sd, of_feedback = _used_feedback(table, arm, how, metadata, weighed)
    if covariance is None and known is not None and (feedback is not None or distance is not None):
        covariance = np.full((len(known), 6, 6), np.nan)
        covariance[:, :3, :3] = known[:, None, None] ** 2 * np.eye(3)
    if covariance is not None:
        turn, _ = _frame_of(how)
        if np.linalg.det(turn) < 0 and attitude is not None:
            raise FileError(table.path, "", "an orientation in a mirrored frame", "no rotation does that; check --axes")
        covariance = turned_covariance(covariance, turn)
        attitude = None if attitude is None else turn @ attitude
        sd = np.sqrt(np.einsum("nii->n", covariance[:, :3, :3]) / 3.0)
        sd = sd if distance is None or distance_sd is None else np.where(np.isnan(tcp[:, 0]), distance_sd, sd)
    return {
        "sd": sd,
        "covariance": covariance,
        "attitude": attitude,
        "feedback": feedback,
        "feedback_sd": feedback_sd,
        "distance": distance,
        "distance_sd": None if distance is None else distance_sd,
        "distance_from": None if distance is None else read_anchor(metadata, how),
    }, (*notices, *of_attitude, *of_feedback)


def _used_distance(
    table: CsvTable, metadata: Metadata | None, tcp: Array, weighed: bool
) -> tuple[Array | None, list[str]]:
    """Distances (N,) (m), if there are any that can be weighed beside the positions `tcp`; and notices of them."""
    distance = read_distance(table, tcp)
    if distance is None:
        return None, []
    if not np.isnan(tcp).all() and (read_distance_sd(table, metadata) is None or not weighed):
        check_alike(table, tcp)
        return None, ["the distances are not used: state distance_sd_mm, and the positions' sd_mm or noise_sd_mm"]
    if metadata is None or metadata.distance_from_mm is None:
        return distance, [
            "the point that distances are measured from is not stated (distance_from_mm): it is estimated"
        ]
    return distance, []


def _used_attitude(table: CsvTable, covariance: Array | None) -> tuple[Array | None, list[str]]:
    """Orientations (N, 3, 3), if there are any of a known standard deviation; and notices of them."""
    attitude = read_attitude(table)
    if attitude is not None and (covariance is None or np.isnan(covariance[0, 3, 3])):
        return None, ["the orientation is not used: state its standard deviation in a column srot_deg"]
    return attitude, []


def _used_feedback(
    table: CsvTable, arm: Arm, how: Reading, metadata: Metadata | None, weighed: bool
) -> tuple[Array | None, float | None, list[str]]:
    """Measured joint angles (N, n) and their standard deviation (rad), if both are known; and notices of them."""
    feedback = read_feedback(table, arm, how)
    if feedback is None:
        return None, None, []
    if metadata is None or metadata.feedback_sd_deg is None or not weighed:
        needed = "state feedback_sd_deg in the file beside the data, and the positions' standard deviation"
        return None, None, [f"the joint feedback is not used: {needed} (sd_mm, noise_sd_mm)"]
    return feedback, float(np.radians(metadata.feedback_sd_deg)), []


def _frame_of(how: Reading) -> tuple[Array, Array]:
    """Rotation (3, 3), or mirror, and translation (3,), m, by which a reading turns positions."""
    origin, *unit = read_positions(how, np.concatenate([np.zeros((1, 3)), np.eye(3)]))
    return (np.array(unit) - origin).T, origin


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
    angles = [f"q{i + 1}_deg" for i in range(arm.dof)]
    more = [name for name in table.header if ANGLES.fullmatch(name) and name not in angles]
    if more:
        count = sum(1 for name in table.header if ANGLES.fullmatch(name))
        raise FileError(table.path, "header", f"{count} joints, {arm.name} has {arm.dof}", "is this another arm?")
    return angles


def _sides(arm: Arm) -> list[str]:
    return [f"approach{i + 1}" for i in range(arm.dof)]


def _start(path: Path, metadata: Metadata | None, arm: Arm, how: Reading) -> Array | None:
    """(n,), joint angles before the first pose (rad), or None. Raises `FileError`."""
    if metadata is None or metadata.start_q_deg is None:
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
    table = in_units(read_measurement_table(path), how)
    require(table, _angle_columns(table, arm, how))
    known: dict[str, Array] = {n: table.numbers(n) for n in ("t_s", "session", "temp_c") if n in table.header}
    number = read_whole(table, "pose") if "pose" in table.header else None
    return poses_of_table(table, read_angles(table, arm, how), known, number, None, how)


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""
    return bool({*POSITION, DISTANCE} & set(read_measurement_table(path).header))


def read_pose_feedback(path: Path, arm: Arm) -> tuple[Array | None, float | None]:
    """What the encoders read at the poses of a file, (N, n) in rad, and its standard deviation as stated (deg).

    Raises `FileError`.
    """
    metadata = metadata_of(path)
    how = AS_NAMED.over(metadata)
    feedback = read_feedback(in_units(read_measurement_table(path), how), arm, how)
    return feedback, None if metadata is None else metadata.feedback_sd_deg


def _check_once(table: CsvTable, pose: NDArray[np.int64]) -> None:
    first: dict[int, int] = {}
    for row, number in enumerate(pose.tolist()):
        if first.setdefault(number, row) != row:
            what = f"pose {number} stands in line {table.lines[first[number]]} already"
            right = "each row has its own number; name a repetition in the column repeat_of"
            raise FileError(table.path, table.at(row, "pose"), what, right)


def _repeats(table: CsvTable, pose: NDArray[np.int64]) -> NDArray[np.int64]:
    if "repeat_of" not in table.header:
        return pose
    j = table.header.index("repeat_of")
    rows = tuple(
        row if row[j].strip() else (*row[:j], str(own), *row[j + 1 :])
        for row, own in zip(table.rows, pose.tolist(), strict=True)
    )
    repeat = read_whole(replace(table, rows=rows), "repeat_of")
    unknown = ~np.isin(repeat, pose)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise FileError(table.path, table.at(row, "repeat_of"), f"there is no pose {repeat[row]}")
    return repeat


def _notices(table: CsvTable, known: list[str]) -> list[str]:
    unknown = [name for name in table.header if name and name not in known]
    notices = [f"columns not used: {', '.join(unknown)}"] if unknown else []
    taken = {ours: name for ours, name in table.stated.items() if ours in known and not name.lower().startswith(ours)}
    if taken:
        notices.append("read as: " + ", ".join(f"{ours} = '{name}'" for ours, name in taken.items()))
    sidecar = table.path.with_suffix(".toml")
    if sidecar.is_file() and is_something_else(sidecar):
        notices.append(f"{sidecar.name} beside it is {schema_of(sidecar)}, so it says nothing of these data")
    if not table.path.read_bytes().endswith(b"\n"):
        notices.append("the last line does not end; is the file complete?")
    return notices
