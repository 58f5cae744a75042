"""Conventions of a measurement file: the metadata `NAME.toml` beside `NAME.csv`, and what a `Reading` makes of numbers.

Signed axes, a frame's rigid motion, signs and order of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, FiniteFloat

from lrm_ident.data.atomic_write import is_something_else
from lrm_ident.data.measurement_file.dataset_card import DatasetCard
from lrm_ident.data.measurement_file.pose_quantity import SD, TURN_SD
from lrm_ident.data.measurement_file.power_ons import PowerOnTime
from lrm_ident.data.rigid_motion import placement_motion, to_xyz_angles
from lrm_math.arm.arm import Arm, Placement
from lrm_math.arm.arm_file import MM, load_arm, shipped_arms
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.reading import AXES, FrameTable, Reading
from lrm_math.plausibility import implausible_value
from lrm_math.toml_file import read_toml, schema_of

LENGTH_UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1.0}
"""Metres of each unit of positions."""
ANGLE_UNITS = {"deg": float(np.radians(1.0)), "rad": 1.0}
"""Radians of each unit of joint angles."""


class Metadata(Reading):
    """Metadata file `NAME.toml`, schema `lrm/measurements/1`; it may say how the numbers are to be read.

    `approach_deg`: how far from it every joint stood before it came to a pose. `feedback_sd_deg`: standard deviation of
    the joints' encoders. `distance_from_mm`: the point that distances are measured from, in the frame of the positions;
    `distance_sd_mm`: their standard deviation. `points`: places of touched points on their board (mm), by name;
    `distances`: measured distances between them (mm), by both names; without `points` those between all.
    `poses_sha256`, `t0_s`: of a campaign, its file of poses and the tracker's time at t_s = 0; `power_ons`: a name of
    each `session` from 1, `power_on`: when its servos got power. `servos`: their settings, by joint. `card`: for others
    who use the data.
    """

    schema_: Literal["lrm/measurements/1"] = Field(alias="schema")
    arm: str | None = None
    source: str = ""
    start_q_deg: list[float] | None = None
    approach_deg: Annotated[float, Field(gt=0, le=45)] | None = None
    noise_sd_mm: Annotated[float, Field(gt=0)] | None = None
    feedback_sd_deg: Annotated[float, Field(gt=0)] | None = None
    distance_from_mm: Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)] | None = None
    distance_sd_mm: Annotated[float, Field(gt=0)] | None = None
    points: dict[str, Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]] | None = None
    distances: dict[str, Annotated[float, Field(gt=0, allow_inf_nan=False)]] | None = None
    poses_sha256: str | None = None
    t0_s: float | None = None
    power_ons: list[str] = []
    power_on: list[PowerOnTime] = []
    servos: ServoSettings | None = None
    card: DatasetCard | None = None

    @property
    def beside(self) -> float | None:
        """How far (rad) from each pose the arm was sent before it, or None."""
        return None if self.approach_deg is None else float(np.radians(self.approach_deg))


PLAUSIBLE = {"noise_sd_mm": SD, "distance_sd_mm": SD, "feedback_sd_deg": TURN_SD}


def metadata_of(path: Path) -> Metadata | None:
    """Metadata of a CSV file; None if there is no such file, or the one of that name is of another schema.

    Raises `FileError`.
    """
    file = path.with_suffix(".toml")
    if not file.is_file() or is_something_else(file):
        return None
    metadata = read_toml(file, Metadata)
    for key, value in metadata.model_dump(exclude_none=True).items():
        fault = implausible_value(PLAUSIBLE[key], value) if key in PLAUSIBLE else None
        if fault:
            raise FileError(file, key, fault.what, fault.right)
    return metadata


@dataclass(frozen=True, eq=False)
class Conventions:
    """Conventions of one file.

    Attributes:
        metadata: beside it. how: its numbers are read.
        start: (n,), joint angles before its first pose (rad), or None.
        rotation, translation: (3, 3), or mirror, and (3,), m: from its positions to the arm's frame.
        notices: of a file beside it that is something else.
    """

    metadata: Metadata
    how: Reading
    start: Array | None
    rotation: Array
    translation: Array
    notices: tuple[str, ...]


def conventions_of(path: Path, arm: Arm, reading: Reading, usual: Reading | None = None) -> Conventions:
    """Conventions of a file of an arm's poses: as `reading` says, then the file beside it, then `usual`.

    Raises `FileError`.
    """
    file, metadata = path.with_suffix(".toml"), metadata_of(path)
    other = metadata is None and file.is_file()
    notices = (f"{file.name} beside it is {schema_of(file)}, so it says nothing of these data",) if other else ()
    beside = metadata or Metadata(schema="lrm/measurements/1")
    how, stated = reading.over(beside).over(usual), beside.start_q_deg
    for name, values in (("joint_sign", how.joint_sign), ("joint_order", how.joint_order)):
        if values is not None and len(values) != arm.dof:
            raise FileError(path, "", f"{name} has {len(values)} joints", f"{arm.name} has {arm.dof}")
    if stated is not None and len(stated) != arm.dof:
        raise FileError(
            file, "start_q_deg", f"{len(stated)} angles", f"{arm.name} has {arm.dof} joints; is this another arm?"
        )
    start = None if stated is None else read_joints(how, np.radians(stated))
    return Conventions(beside, how, start, *motion_of(how), notices)


def arm_for(data: Path, arm: str | None) -> tuple[str, Arm]:
    """The arm that is named, or that the file beside the data names: a shipped one, or a path relative to the folder of
    the data, else to the working directory. Raises `FileError`."""
    if arm is not None:
        return arm, load_arm(arm)
    metadata = metadata_of(data) if data.exists() else None
    if not data.exists():
        raise FileError(data, "", "no such file")
    if metadata is None or metadata.arm is None:
        names = f"{', '.join(sorted(shipped_arms()))} or an arm file of your own (lrm-ident arm import, arm new)"
        right = f"name it with --arm, or as arm in the .toml file beside the data: {names}"
        raise FileError(data, "", "no arm given", right)
    beside = data.parent / metadata.arm
    named = str(beside) if metadata.arm not in shipped_arms() and beside.exists() else metadata.arm
    return named, load_arm(named)


def axes_matrix(axes: str) -> Array:
    """(3, 3), signed permutation that takes the file's coordinates to the arm's."""
    matrix = np.zeros((3, 3))
    for row, word in enumerate(axes.split(",")):
        matrix[row, AXES.index(word[-1])] = -1.0 if word.startswith("-") else 1.0
    return matrix


def axes_words(matrix: Array) -> str:
    """The inverse of `axes_matrix`: the nearest signed permutation of a matrix (3, 3), as `x,y,-z`."""
    columns = np.argmax(np.abs(matrix), axis=1)
    return ",".join(
        ("-" if matrix[row, column] < 0 else "") + AXES[int(column)] for row, column in enumerate(columns.tolist())
    )


def frame_table(rotation: Array, translation: Array) -> FrameTable:
    """The table of a rigid motion: rotation (3, 3) and translation (3,), m."""
    x, y, z = (translation / MM).tolist()
    a, b, c = np.degrees(to_xyz_angles(rotation)).tolist()
    return FrameTable(x_mm=x, y_mm=y, z_mm=z, alpha_deg=a, beta_deg=b, gamma_deg=c)


def frame_motion(frame: FrameTable) -> Array:
    """(4, 4), rigid motion of a frame (m)."""
    x, y, z = frame.x_mm * MM, frame.y_mm * MM, frame.z_mm * MM
    return placement_motion(Placement(x, y, z, *np.radians([frame.alpha_deg, frame.beta_deg, frame.gamma_deg])))


def rigid_motion(frame: FrameTable) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,), m, of a frame."""
    T = frame_motion(frame)
    return T[:3, :3], T[:3, 3]


def motion_of(reading: Reading) -> tuple[Array, Array]:
    """Rotation (3, 3), or mirror, and translation (3,), m, from a file's positions to the arm's frame.

    To the file's own frame, with the arm's axes, as long as that frame is not known.
    """
    axes = np.eye(3) if reading.axes is None else axes_matrix(reading.axes)
    if not isinstance(reading.frame, FrameTable):
        return axes, np.zeros(3)
    rotation, translation = rigid_motion(reading.frame)
    return rotation @ axes, translation


def read_positions(reading: Reading, positions: Array) -> Array:
    """(N, 3), positions of a file (m) as `motion_of` takes them."""
    turn, shift = motion_of(reading)
    return np.asarray(positions @ turn.T + shift)


def read_joints(reading: Reading, columns: Array) -> Array:
    """(..., n), quantities of the file's joints in the order and with the signs of the arm's joints."""
    ordered = columns if reading.joint_order is None else columns[..., [number - 1 for number in reading.joint_order]]
    return ordered if reading.joint_sign is None else ordered * np.array(reading.joint_sign, dtype=np.float64)
