"""Measurement files: `NAME.csv`, one row per pose in measured order, and its metadata `NAME.toml`."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from lrm_ident.data.apply_reading import ANGLE_UNITS, AS_NAMED, LENGTH_UNITS, read_joints, read_positions
from lrm_ident.data.csv_table import CsvTable, csv_text, require
from lrm_ident.data.measurement_table import ANGLES, POSITION, numbered, read_measurement_table
from lrm_ident.data.pose_table import in_units, poses_of_table, read_angles, read_whole
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM, MM, load_arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import Reading
from lrm_math.toml_file import read_toml, schema_of

ATTITUDE = ("qw", "qx", "qy", "qz")
OPTIONAL = ("t_s", "session", "payload_g", *ATTITUDE, "temp_c", "supply_v", "sd_mm", "repeat_of", "approach")


class Metadata(Reading):
    """Metadata file `NAME.toml`, schema `lrm/measurements/1`; it may say how the numbers are to be read.

    `poses_sha256`, `t0_s`: of a campaign, its file of poses and the tracker's time at t_s = 0.
    """

    schema_: Literal["lrm/measurements/1"] = Field(alias="schema")
    arm: str | None = None
    source: str = ""
    start_q_deg: list[float] | None = None
    noise_sd_mm: Annotated[float, Field(gt=0)] | None = None
    poses_sha256: str | None = None
    t0_s: float | None = None


@dataclass(frozen=True, eq=False)
class Measurements:
    """N measured poses.

    Attributes:
        pose: (N,), pose numbers.
        tcp: (N, 3), measured TCP position (m).
        sd: (N,), standard deviation of each position per axis (m), or None.
        noise_sd: standard deviation per axis for all poses (m), or None.
        repeat_of: (N,), number of the pose that a row repeats, else its own number.
        notices: warnings about the file.
        reading: how the file's numbers were read, where that was said.
        stated: the same with the units of the columns' names.
        left_out: numbers of poses that were taken out.
        arm_name: of a shipped arm, or path of its file, as a model file names it; None: the arm's own name.
    """

    poses: Poses
    pose: NDArray[np.int64]
    tcp: Array
    sd: Array | None
    noise_sd: float | None
    repeat_of: NDArray[np.int64]
    path: Path
    sha256: str
    notices: tuple[str, ...] = ()
    arm: Arm | None = None
    reading: Reading = AS_NAMED
    stated: Reading = AS_NAMED
    left_out: tuple[int, ...] = ()
    arm_name: str | None = None

    def __len__(self) -> int:
        return len(self.pose)

    def take(self, rows: ArrayLike) -> Measurements:
        """The given rows (indices or a mask)."""
        chosen = np.asarray(rows)
        return replace(
            self,
            poses=self.poses.take(chosen),
            pose=self.pose[chosen],
            tcp=self.tcp[chosen],
            sd=None if self.sd is None else self.sd[chosen],
            repeat_of=self.repeat_of[chosen],
        )

    def without(self, numbers: Sequence[int]) -> Measurements:
        """Without the poses of these numbers, which `left_out` then names too."""
        gone = np.isin(self.pose, numbers)
        return replace(self.take(~gone), left_out=tuple(sorted({*self.left_out, *self.pose[gone].tolist()})))


def metadata_of(path: Path) -> Metadata | None:
    """Metadata of a CSV file; None if there is no such file, or the one of that name is of another schema.

    Raises `FileError`.
    """
    file = path.with_suffix(".toml")
    if not file.is_file() or is_something_else(file):
        return None
    return read_toml(file, Metadata)


def is_something_else(sidecar: Path) -> bool:
    """Whether a TOML file says by its schema that it is a model, an arm, or anything but metadata."""
    schema = schema_of(sidecar)
    return schema is not None and not schema.startswith("lrm/measurements/")


def arm_for(data: Path, arm: str | None) -> tuple[str, Arm]:
    """The arm that is named, or that the file beside the data names. Raises `FileError`."""
    if arm is not None:
        return arm, load_arm(arm)
    metadata = metadata_of(data) if data.exists() else None
    if not data.exists():
        raise FileError(data, "", "no such file")
    if metadata is None or metadata.arm is None:
        raise FileError(data, "", "no arm given", "name it with --arm, or as arm in the .toml file beside the data")
    return metadata.arm, load_arm(metadata.arm)


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
    require(table, ["pose", *angles, *POSITION])
    pose = read_whole(table, "pose")
    _check_once(table, pose)
    q = read_angles(table, arm, how)
    known = {name: table.numbers(name) for name in OPTIONAL if name in table.header}
    start = _start(path, metadata, arm, how)
    sd = known.get("sd_mm")
    if sd is not None:
        table.reject(sd <= 0, "sd_mm", "not above zero")
    return Measurements(
        poses=poses_of_table(table, q, known, pose, start, how),
        pose=pose,
        tcp=read_positions(how, np.stack([table.numbers(name) for name in POSITION], axis=1) * MM),
        sd=None if sd is None else sd * MM,
        noise_sd=None if metadata is None or metadata.noise_sd_mm is None else metadata.noise_sd_mm * MM,
        repeat_of=_repeats(table, pose),
        path=path,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        notices=tuple(_notices(table, [*angles, *_sides(arm), "pose", *POSITION, *OPTIONAL])),
        arm=arm,
        reading=Reading(**how.said()),
        stated=_stated(table, how),
    )


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


def measurements_csv(data: Measurements) -> str:
    """CSV text of measurements, with the optional columns that they have."""
    columns: list[tuple[str, Array, int]] = [("pose", data.pose.astype(np.float64), 0)]
    optional = (("t_s", data.poses.t, 1.0, 3), ("session", data.poses.session, 1.0, 0))
    columns += [(name, values / unit, digits) for name, values, unit, digits in optional if values is not None]
    columns.append(("payload_g", data.poses.payload / GRAM, 4))
    columns += [(f"q{i + 1}_deg", np.degrees(data.poses.q[:, i]), 9) for i in range(data.poses.q.shape[1])]
    columns += [(name, data.tcp[:, i] / MM, 6) for i, name in enumerate(("x_mm", "y_mm", "z_mm"))]
    if data.poses.temperature is not None:
        columns.append(("temp_c", data.poses.temperature, 3))
    if data.sd is not None:
        columns.append(("sd_mm", data.sd / MM, 6))
    columns.append(("repeat_of", data.repeat_of.astype(np.float64), 0))
    return csv_text(columns)


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
