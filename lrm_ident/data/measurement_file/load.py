"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.column_names import arm_columns, named_columns, stated_units, unused_columns
from lrm_ident.data.measurement_file.commanded_poses import perhaps_radians, pose_notices, read_poses, time_notices
from lrm_ident.data.measurement_file.conventions import conventions_of, motion_of
from lrm_ident.data.measurement_file.known_columns import (
    KNOWN,
    commanded_quantities,
    measured_quantities,
)
from lrm_ident.data.measurement_file.measured_columns import (
    out_of_reach,
    with_comparable,
    without_copies,
    without_lost,
)
from lrm_ident.data.measurement_file.number_table import NumberTable, checked_rows, read_numbers, required_columns
from lrm_ident.data.measurement_file.pose_quantity import DISTANCE, POINT, POSITION, PoseQuantity
from lrm_ident.data.measurement_file.summary_rows import summary_notices, without_summary
from lrm_ident.data.measurement_file.touched_points import require_points, with_touches, without_lone
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.kinds import KINDS
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.source import Source
from lrm_ident.data.table_text.csv_file import CsvTable, read_table
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AS_NAMED, Reading


def load_measurements(path: Path, arm: Arm, reading: Reading = AS_NAMED, usual: Reading | None = None) -> Measurements:
    """Reads measurements of an arm.

    Args:
        reading: how to read the numbers; then the file beside the data says, then `usual`, then the columns' names.

    Raises `FileError`: naming file, line and column of the first fault.
    """
    data, beyond = read_measured(path, arm, reading, usual)
    for _, error in beyond:
        raise error
    return data


def read_measured(
    path: Path, arm: Arm, reading: Reading, usual: Reading | None
) -> tuple[Measurements, tuple[tuple[int, FileError], ...]]:
    """Measurements as `load_measurements` reads them, and pose and error of each joint angle beyond the limits, and
    of each position beyond the arm's reach.

    Raises `FileError`.
    """
    said = conventions_of(path, arm, reading, usual)
    quantities = measured_quantities(arm, said.how)
    cells = without_summary(_arm_table(path, arm, said.how, quantities).once())
    require_points(cells, said.metadata)
    units = stated_units(cells)
    table = checked_rows(read_numbers(cells, quantities, said.how.bad_rows == "skip"))
    beside, power = said.metadata.beside, said.metadata.power_on
    poses = read_poses(table, arm, said.how, said.start, beside, power)
    data = Measurements(
        poses=poses,
        observations=tuple(observation for kind in KINDS for observation in kind.read(table, said.metadata)),
        pose=table.integers("pose"),
        repeat_of=table.integers("repeat_of"),
        source=Source(
            path=path,
            sha256=table.cells.sha256,
            notices=(*said.notices, *table.cells.notices, *pose_notices(table)),
            arm=arm,
            arm_name=said.metadata.arm or None,
            servos=said.metadata.servos,
            reading=said.how,
            stated=said.how.over(units),
            unused=unused_columns(cells, quantities),
        ),
    )
    touched = with_touches(data, table, said.metadata)
    if touched.touched and said.how.frame is not None:
        raise FileError(path, "frame", "touched points have frames of their own", "leave out frame (--frame)")
    seen = with_comparable(touched, table, arm)
    seen = without_lone(seen) if touched.touched else without_copies(without_lost(seen), table)
    if np.linalg.det(said.rotation) < 0 and seen.of(Orientations):
        raise FileError(path, "", "an orientation in a mirrored frame", "no rotation does that; check --axes")
    beyond = tuple((int(data.pose[row]), error) for row, error in (*table.beyond, *out_of_reach(arm, table)))
    return seen.turned(said.rotation, said.translation), beyond


def load_poses(file: str | Path, arm: Arm, reading: Reading = AS_NAMED) -> Poses:
    """Reads commanded poses: `q1_deg` …, optional `payload_g`, `t_s`, `session`, `temp_c`, `approach`,
    and gravity as `gx, gy, gz` or `roll_deg, pitch_deg`.

    Args:
        reading: as in `load_measurements`.

    Raises `FileError`.
    """
    return load_pose_table(Path(file), arm, reading)[0]


def pose_doubts(table: NumberTable, arm: Arm, reading: Reading = AS_NAMED) -> tuple[str, ...]:
    """What a person should know of poses that were read so, in words. Raises `FileError`."""
    how = conventions_of(table.cells.path, arm, reading).how
    return (*summary_notices(table.cells), *perhaps_radians(table["angles"], how), *time_notices(table))


def load_pose_table(
    path: Path, arm: Arm, reading: Reading = AS_NAMED, more: Collection[str] = ()
) -> tuple[Poses, NumberTable]:
    """Poses as `load_poses` reads them, and their table, with the quantities `more` as far as they are there."""
    said = conventions_of(path, arm, reading)
    how = said.how
    quantities = (*commanded_quantities(arm, how), *(replace(q, may_be_empty=False) for q in KNOWN if q.name in more))
    table = read_numbers(without_summary(_arm_table(path, arm, how, quantities)), quantities)
    for _, error in table.beyond:
        raise error
    return read_poses(table, arm, how, said.start, power=said.metadata.power_on).turned(motion_of(how)[0]), table


def _arm_table(path: Path, arm: Arm, how: Reading, quantities: Sequence[PoseQuantity]) -> CsvTable:
    """The table of a file, its columns named as ours; of a workbook that of a sheet with all that is required.

    Raises `FileError`.
    """

    def named(file: CsvTable) -> CsvTable:
        return arm_columns(file, arm, how, quantities)

    def complete(file: CsvTable) -> bool:
        cells = named(file)
        return {*required_columns(cells, quantities)} <= {*cells.header}

    return named(read_table(path, complete))


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""

    def measured(file: CsvTable) -> bool:
        return bool({*POSITION, DISTANCE, POINT} & {*named_columns(file).header})

    return measured(read_table(path, measured))


def read_pose_feedback(path: Path, arm: Arm) -> tuple[list[EncoderReadings], float | None]:
    """Readings of the encoders at the poses of a file, if it has any, and their standard deviation as stated (deg).

    Raises `FileError`.
    """
    said = conventions_of(path, arm, AS_NAMED)
    quantities = [each for each in measured_quantities(arm, said.how) if each.name in ("angles", "feedback")]
    table = read_numbers(without_summary(_arm_table(path, arm, said.how, quantities)), quantities)
    return [*EncoderReadings.read(table, said.metadata)], said.metadata.feedback_sd_deg
