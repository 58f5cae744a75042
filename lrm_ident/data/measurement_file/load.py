"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`.

Rows that cannot be what they say are left out or told: a lost tracker, another order, repetitions elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.apply_reading import in_joint_order, motion_of
from lrm_ident.data.csv_table import (
    ANGLE,
    FEEDBACK,
    CsvTable,
    KnownColumns,
    NumberTable,
    columns_of_joints,
    read_numbers,
    require,
    without_bad_rows,
)
from lrm_ident.data.measurement_file.metadata import (
    NOTHING_STATED,
    Metadata,
    metadata_of,
    sidecar_notices,
    start_angles,
)
from lrm_ident.data.measurement_file.sensed_columns import (
    DISTANCE,
    measured_columns,
    read_feedback,
    with_sensed,
)
from lrm_ident.data.measurement_table import (
    POSITION,
    column_notices,
    joint_columns,
    read_measurement_table,
    stated_units,
)
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.pose_table import after_gap, full_turns, pose_columns, read_poses
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.reading import AS_NAMED, Reading

LISTED = 8
FINEST = 1e-5
"""Share of the reach: no tracker that arms are measured with is so exact."""
SAME_POSE = 1.0  # deg
MOVED = 0.05  # share of the reach


def load_measurements(path: Path, arm: Arm, reading: Reading = AS_NAMED, usual: Reading | None = None) -> Measurements:
    """Reads measurements of an arm.

    Args:
        reading: how to read the numbers; then the file beside the data says, then `usual`, then the columns' names.

    Raises `FileError`: naming file, line and column of the first fault (`BeyondLimits`: of a joint).
    """
    metadata, beside = metadata_of(path) or NOTHING_STATED, sidecar_notices(path)
    how = reading.over(metadata).over(usual)
    named = read_measurement_table(path, how, [joint.name for joint in arm.joints])
    known, tips = measured_columns(arm), True
    if DISTANCE in named.header:
        known = replace(known, may_be_empty={*known.may_be_empty, *POSITION})
        tips = bool({*POSITION} & {*named.header})
    required = [*joint_columns(named, arm, how), *(POSITION if tips else ())]
    notices, units = [*column_notices(named, known.names), *beside], stated_units(named)
    whole = require(named, required)
    start = start_angles(path, metadata, arm, how)
    ordered = in_joint_order(whole, how)
    turn, shift = motion_of(how)
    cells = without_bad_rows(ordered, known, how.bad_rows == "skip")
    table = read_numbers(cells, known)
    pose, repeat_of = numbered_rows(table)
    doubts = doubtful(table, arm, metadata)
    data = Measurements(
        poses=read_poses(table, arm, how, start),
        pose=pose,
        tcp=table.together[POSITION] * MM if tips else np.full((len(table), 3), np.nan),
        sd=None,
        noise_sd=None if metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM,
        repeat_of=repeat_of,
        path=path,
        sha256=cells.sha256,
        notices=(*notices, *cells.notices, *doubts),
        arm=arm,
        reading=Reading(**how.said()),
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
    path = Path(file)
    how = reading.over(metadata_of(path))
    return read_poses(read_numbers(_joint_table(path, arm, how), pose_columns(arm)), arm, how)


def _joint_table(path: Path, arm: Arm, how: Reading) -> CsvTable:
    """A table with the angles of the arm's joints, in their order and with their signs. Raises `FileError`."""
    named = read_measurement_table(path, how, [joint.name for joint in arm.joints])
    return in_joint_order(require(named, joint_columns(named, arm, how)), how)


def says_measured(path: Path) -> bool:
    """Whether a file has columns of positions or distances, not commands alone. Raises `FileError`."""
    return bool({*POSITION, DISTANCE} & {*read_measurement_table(path).header})


def read_pose_feedback(path: Path, arm: Arm) -> tuple[Array | None, float | None]:
    """Readings of the encoders at the poses of a file, (N, n) in rad, and its standard deviation as stated (deg).

    Raises `FileError`.
    """
    metadata = metadata_of(path) or NOTHING_STATED
    angles, feedback = (columns_of_joints(form, arm.dof) for form in (ANGLE, FEEDBACK))
    known = KnownColumns({*feedback, *angles}, feedback, {angles: "", feedback: ""})
    table = read_numbers(_joint_table(path, arm, AS_NAMED.over(metadata)), known)
    q, _ = full_turns(np.radians(table.together[angles]), arm)
    return read_feedback(table, q), metadata.feedback_sd_deg


def numbered_rows(table: NumberTable) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pose numbers (N,), and that of the pose that each row repeats, its own where the cell is empty.

    Raises `FileError`: a number that stands twice, or a repetition of no pose.
    """
    pose, first = table.integers("pose"), dict[int, int]()
    for row, number in enumerate(pose.tolist()):
        if first.setdefault(number, row) != row:
            what = f"pose {number} stands in line {table.cells.lines[first[number]]} already"
            right = "each row has its own number; name a repetition in the column repeat_of"
            raise FileError(table.cells.path, table.cells.at(row, "pose"), what, right)
    stated = table.columns.get("repeat_of", pose)
    repeat = np.where(np.isnan(stated), pose, np.nan_to_num(stated)).astype(np.int64)
    unknown = ~np.isin(repeat, pose)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise FileError(table.cells.path, table.cells.at(row, "repeat_of"), f"there is no pose {repeat[row]}")
    return pose, repeat


def without_lost(data: Measurements, table: NumberTable) -> Measurements:
    """The measurements without positions that are exactly 0, 0, 0: a tracker writes them while it sees nothing.

    Raises `FileError` if all are.
    """
    lost = (table.together[POSITION] == 0.0).all(axis=1)
    if not lost.any():
        return data
    if lost.all():
        raise FileError(data.path, "", "every position is 0, 0, 0", "was the tracker on?")
    count = f"{int(lost.sum())} positions are exactly 0, 0, 0, as of a lost tracker"
    words = f"{count}, and left out: {_poses(data.pose[lost])}"
    return replace(data.without(data.pose[lost].tolist()), notices=(*data.notices, words))


def without_frozen(arm: Arm, data: Measurements) -> Measurements:
    """The measurements without positions that are, to the last digit, those of the row before, while the arm moved."""
    same = np.flatnonzero((np.diff(data.tcp, axis=0) == 0.0).all(axis=1)) + 1
    if not len(same):
        return data
    drawn = equilibrium(model_of(arm, ()), data.poses.take(np.concatenate([same - 1, same]))).tcp
    away = np.linalg.norm(drawn[len(same) :] - drawn[: len(same)], axis=1) > MOVED * reach(arm)
    if not away.any():
        return data
    frozen = data.pose[same[away]]
    words = f"the position stands still while the arm moves, as of a frozen tracker; left out: {_poses(frozen)}"
    return replace(data.without(frozen.tolist()), notices=(*data.notices, words))


def doubtful(table: NumberTable, arm: Arm, metadata: Metadata) -> Iterator[str]:
    """Notices about the order, the repetitions and the stated noise of a file."""
    number = table.integers("pose")
    if not any(name.startswith("approach") for name in table.columns):
        gap = after_gap(number)
        if gap.any():
            yield (
                f"before {_poses(number[gap])} the file lacks a pose: the direction of approach is unknown there; "
                "state it as approach, or approach1, approach2 … of each joint"
            )
        if (np.diff(number) < 0).any():
            yield "the pose numbers do not ascend: the rows are taken to be in the order measured"
    yield from _turns(table, arm)
    yield from _times(table, number)
    yield from _repetitions(table, arm, number)
    yield from _noise(table, arm, metadata)


def _turns(table: NumberTable, arm: Arm) -> Iterator[str]:
    """Angles that were read a full turn away, as those of a file that counts from 0 to 360 deg."""
    stated = np.radians(table.together[columns_of_joints(ANGLE, arm.dof)])
    q, turned = full_turns(stated, arm)
    for joint in np.flatnonzero(turned.any(axis=0)).tolist():
        row = int(np.argmax(turned[:, joint]))
        was, read = np.degrees([stated[row, joint], q[row, joint]])
        count = int(turned[:, joint].sum())
        beyond = "1 angle is" if count == 1 else f"{count} angles are"
        yield f"{beyond} beyond the limits of joint {joint + 1} and read a full turn away: {was:g} = {read:g} deg"


def _times(table: NumberTable, number: NDArray[np.int64]) -> Iterator[str]:
    if "t_s" not in table:
        return
    t, session = table.columns["t_s"], table.columns.get("session", np.zeros(len(table)))
    back = np.concatenate([[False], (np.diff(t) < 0) & (np.diff(session) == 0)])
    if back.any():
        yield f"t_s runs backwards at {_poses(number[back])}: are the rows in the order measured?"


def _repetitions(table: NumberTable, arm: Arm, number: NDArray[np.int64]) -> Iterator[str]:
    """Repetitions that were commanded elsewhere than what they repeat."""
    if "repeat_of" not in table:
        return
    q, first = table.together[columns_of_joints(ANGLE, arm.dof)], {int(pose): row for row, pose in enumerate(number)}
    stated = np.nan_to_num(table.columns["repeat_of"], nan=-1.0)
    of = [first.get(int(pose), row) for row, pose in enumerate(stated)]
    away = np.abs(q - q[of]).max(axis=1) > SAME_POSE
    if away.any():
        yield f"repeat_of: {_poses(number[away])} is not commanded where the pose is that it repeats"


def _noise(table: NumberTable, arm: Arm, metadata: Metadata) -> Iterator[str]:
    """A standard deviation smaller than that of any tracker."""
    stated = table.columns.get("sd_mm", np.array([metadata.noise_sd_mm or np.nan]))
    name, usual = "sd_mm" if "sd_mm" in table else "noise_sd_mm", float(np.median(stated))
    if 0.0 < usual < FINEST * reach(arm) / MM:
        yield f"{name} is {usual:.3g} mm: no tracker is so exact; were it in metres, it would be {usual * 1e3:.3g} mm"


def _poses(numbers: NDArray[np.int64]) -> str:
    return f"pose {enumerate_words([str(number) for number in numbers.tolist()], LISTED)}"
