"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.apply_reading import motion_of
from lrm_ident.data.measurement_file.column_names import arm_table, read_measurement_table, stated_units
from lrm_ident.data.measurement_file.commanded_poses import full_turns, numbered_rows, pose_notices, read_poses
from lrm_ident.data.measurement_file.known_columns import (
    DISTANCE,
    KNOWN,
    POSITION,
    commanded_quantities,
    measured_quantities,
    quantities_of_joints,
)
from lrm_ident.data.measurement_file.measured_columns import read_feedback, with_sensed
from lrm_ident.data.measurement_file.metadata import (
    NOTHING_STATED,
    beside_of,
    metadata_of,
    sidecar_notices,
    start_angles,
)
from lrm_ident.data.measurement_file.number_table import NumberTable, read_numbers, without_bad_rows
from lrm_ident.data.measurement_file.row_checks import row_notices, without_lost
from lrm_ident.data.measurements import Measurements
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
    metadata, beside, known = metadata_of(path) or NOTHING_STATED, sidecar_notices(path), measured_quantities(arm)
    how = reading.over(metadata).over(usual)
    cells = arm_table(path, arm, how, known)
    units, start = stated_units(cells), start_angles(path, metadata, arm, how)
    good = without_bad_rows(cells, known, how.bad_rows == "skip")
    table = read_numbers(good, known)
    pose, repeat_of = numbered_rows(table)
    poses, about_poses = read_poses(table, arm, how, start, beside_of(metadata)), pose_notices(table, arm)
    data = Measurements(
        poses=poses,
        pose=pose,
        tcp=table["position"] if "position" in table else np.full((len(table), 3), np.nan),
        sd=None,
        noise_sd=None if metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM,
        repeat_of=repeat_of,
        path=path,
        sha256=table.cells.sha256,
        notices=(*beside, *table.cells.notices, *about_poses, *row_notices(table, arm, metadata)),
        arm=arm,
        arm_name=metadata.arm or None,
        reading=how,
        stated=how.over(units),
    )
    sensed = without_lost(with_sensed(data, table, metadata))
    turn, shift = motion_of(how)
    if np.linalg.det(turn) < 0 and sensed.attitude is not None:
        raise FileError(path, "", "an orientation in a mirrored frame", "no rotation does that; check --axes")
    return sensed.turned(turn, shift)


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
    """Poses as `load_poses` reads them, and their table, with the quantities `more` as far as they are there."""
    how = reading.over(metadata_of(path))
    known = (*commanded_quantities(arm), *(replace(q, may_be_empty=False) for q in KNOWN if q.name in more))
    cells = arm_table(path, arm, how, known)
    table = read_numbers(cells, known)
    return read_poses(table, arm, how), table


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""
    return bool({*POSITION, DISTANCE} & {*read_measurement_table(path).header})


def read_pose_feedback(path: Path, arm: Arm) -> tuple[Array | None, float | None]:
    """Readings of the encoders at the poses of a file, (N, n) in rad, and its standard deviation as stated (deg).

    Raises `FileError`.
    """
    metadata, (angles, feedback, _) = metadata_of(path) or NOTHING_STATED, quantities_of_joints(arm.dof)
    known = (angles, feedback)
    table = read_numbers(arm_table(path, arm, AS_NAMED.over(metadata), known), known)
    return read_feedback(table, full_turns(table["angles"], arm)[0]), metadata.feedback_sd_deg
