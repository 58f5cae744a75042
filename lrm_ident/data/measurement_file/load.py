"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.apply_reading import motion_of
from lrm_ident.data.csv_table import (
    ANGLE,
    FEEDBACK,
    KnownColumns,
    NumberTable,
    column_notices,
    columns_of_joints,
    read_numbers,
    without_bad_rows,
)
from lrm_ident.data.measurement_file.metadata import NOTHING_STATED, metadata_of, sidecar_notices, start_angles
from lrm_ident.data.measurement_file.row_checks import row_notices, without_lost
from lrm_ident.data.measurement_file.sensed_columns import DISTANCE, measured_columns, read_feedback, with_sensed
from lrm_ident.data.measurement_table import POSITION, joint_table, read_measurement_table, stated_units
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.pose_table import full_turns, numbered_rows, pose_columns, read_poses
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AS_NAMED, Reading


def load_measurements(path: Path, arm: Arm, reading: Reading = AS_NAMED, usual: Reading | None = None) -> Measurements:
    """Reads measurements of an arm.

    Args:
        reading: how to read the numbers; then the file beside the data says, then `usual`, then the columns' names.

    Raises `FileError`: naming file, line and column of the first fault (`BeyondLimits`: of a joint).
    """
    metadata, beside = metadata_of(path) or NOTHING_STATED, sidecar_notices(path)
    how = reading.over(metadata).over(usual)
    named = read_measurement_table(path, how, arm)
    tips = DISTANCE not in named.header or bool({*POSITION} & {*named.header})
    ordered, units = joint_table(named, arm, how, POSITION if tips else ()), stated_units(named)
    known, start = measured_columns(arm, named.header), start_angles(path, metadata, arm, how)
    turn, shift = motion_of(how)
    columns = column_notices(named, known)
    cells = without_bad_rows(ordered, known, how.bad_rows == "skip")
    table = read_numbers(cells, known)
    pose, repeat_of = numbered_rows(table)
    data = Measurements(
        poses=read_poses(table, arm, how, start),
        pose=pose,
        tcp=table.together[POSITION] * MM if tips else np.full((len(table), 3), np.nan),
        sd=None,
        noise_sd=None if metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM,
        repeat_of=repeat_of,
        path=path,
        sha256=cells.sha256,
        notices=(*columns, *beside, *cells.notices, *row_notices(table, arm, metadata)),
        arm=arm,
        arm_name=metadata.arm or None,
        reading=how,
        stated=Reading(**{**units, **how.said()}),
    )
    sensed = with_sensed(data, table, metadata)
    if np.linalg.det(turn) < 0 and sensed.attitude is not None:
        raise FileError(path, "", "an orientation in a mirrored frame", "no rotation does that; check --axes")
    placed = sensed.turned(turn, shift)
    return without_lost(placed, table) if tips else placed


def load_poses(file: str | Path, arm: Arm, reading: Reading = AS_NAMED) -> Poses:
    """Reads commanded poses: `q1_deg` …, optional `payload_g`, `t_s`, `session`, `temp_c`, `approach`.

    Args:
        reading: as in `load_measurements`.

    Raises `FileError`.
    """
    return load_pose_table(Path(file), arm, reading)[0]


def load_pose_table(
    path: Path, arm: Arm, reading: Reading = AS_NAMED, more: Collection[str] = ()
) -> tuple[Poses, NumberTable]:
    """Poses as `load_poses` reads them, and their table, with the columns `more` as far as they are there."""
    how, known = reading.over(metadata_of(path)), pose_columns(arm)
    cells = joint_table(read_measurement_table(path, how, arm), arm, how)
    table = read_numbers(cells, replace(known, names={*known.names, *more}))
    return read_poses(table, arm, how), table


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""
    return bool({*POSITION, DISTANCE} & {*read_measurement_table(path).header})


def read_pose_feedback(path: Path, arm: Arm) -> tuple[Array | None, float | None]:
    """Readings of the encoders at the poses of a file, (N, n) in rad, and its standard deviation as stated (deg).

    Raises `FileError`.
    """
    metadata = metadata_of(path) or NOTHING_STATED
    how = AS_NAMED.over(metadata)
    angles, feedback = (columns_of_joints(form, arm.dof) for form in (ANGLE, FEEDBACK))
    known = KnownColumns({*feedback, *angles}, feedback, {angles: "", feedback: ""})
    table = read_numbers(joint_table(read_measurement_table(path, how, arm), arm, how), known)
    q, _ = full_turns(np.radians(table.together[angles]), arm)
    return read_feedback(table, q), metadata.feedback_sd_deg
