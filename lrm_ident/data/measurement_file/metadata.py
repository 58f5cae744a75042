"""Metadata beside a measurement file: `NAME.toml` beside `NAME.csv`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, FiniteFloat

from lrm_ident.data.apply_reading import read_joints
from lrm_ident.data.atomic_write import is_something_else
from lrm_ident.data.measurement_file.known_columns import SD, TURN_SD
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading
from lrm_math.plausibility import implausible_value
from lrm_math.toml_file import read_toml, schema_of


class Metadata(Reading):
    """Metadata file `NAME.toml`, schema `lrm/measurements/1`; it may say how the numbers are to be read.

    `approach_deg`: how far from it every joint stood before it came to a pose. `feedback_sd_deg`: standard deviation of
    the joints' encoders. `distance_from_mm`: the point that distances are measured from, in the frame of the positions;
    `distance_sd_mm`: their standard deviation. `poses_sha256`, `t0_s`: of a campaign, its file of poses and the
    tracker's time at t_s = 0; `power_ons`: a name of each `session` from 1.
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
    poses_sha256: str | None = None
    t0_s: float | None = None
    power_ons: list[str] = []


PLAUSIBLE = {"noise_sd_mm": SD, "distance_sd_mm": SD, "feedback_sd_deg": TURN_SD}
NOTHING_STATED = Metadata(schema="lrm/measurements/1")
"""Metadata of a file that has none beside it."""


def metadata_of(path: Path) -> Metadata | None:
    """Metadata of a CSV file; None if there is no such file, or the one of that name is of another schema.

    Raises `FileError`.
    """
    file = path.with_suffix(".toml")
    if not file.is_file() or is_something_else(file):
        return None
    metadata = read_toml(file, Metadata)
    for key, value in metadata.model_dump(exclude_none=True).items():
        found = implausible_value(PLAUSIBLE[key], value) if key in PLAUSIBLE else None
        if found:
            raise FileError(file, key, found.what, found.right)
    return metadata


def start_angles(path: Path, metadata: Metadata, arm: Arm, how: Reading) -> Array | None:
    """(n,), joint angles before the first pose of a CSV file (rad), or None. Raises `FileError`."""
    stated = metadata.start_q_deg
    if stated is not None and len(stated) != arm.dof:
        raise FileError(path.with_suffix(".toml"), "start_q_deg", f"{len(stated)} angles", f"should be {arm.dof}")
    return None if stated is None else read_joints(how, np.radians(stated))


def beside_of(metadata: Metadata) -> float | None:
    """How far (rad) from each pose the arm was sent before it, or None."""
    return None if metadata.approach_deg is None else float(np.radians(metadata.approach_deg))


def sidecar_notices(path: Path) -> tuple[str, ...]:
    """A notice of a file beside a CSV file, of the name of its metadata, that is something else."""
    file = path.with_suffix(".toml")
    if not file.is_file() or not is_something_else(file):
        return ()
    return (f"{file.name} beside it is {schema_of(file)}, so it says nothing of these data",)


def arm_for(data: Path, arm: str | None) -> tuple[str, Arm]:
    """The arm that is named, or that the file beside the data names. Raises `FileError`."""
    if arm is not None:
        return arm, load_arm(arm)
    metadata = metadata_of(data) if data.exists() else None
    if not data.exists():
        raise FileError(data, "", "no such file")
    if metadata is None or metadata.arm is None:
        names = f"{', '.join(sorted(shipped_arms()))} or an arm file of your own (lrm-ident arm new)"
        right = f"name it with --arm, or as arm in the .toml file beside the data: {names}"
        raise FileError(data, "", "no arm given", right)
    return metadata.arm, load_arm(metadata.arm)
