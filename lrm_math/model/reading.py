"""Conventions of a measurement file: units, axes, frame, and the joints' signs and order."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator

from lrm_math.toml_file import StrictSchema

LengthUnit = Literal["um", "mm", "cm", "m", "inch"]
AngleUnit = Literal["deg", "rad"]
AXES = ("x", "y", "z")


def parse_axes(text: str) -> str:
    """`x,y,-z`, without spaces. Raises `ValueError` unless each of x, y, z is named once."""
    words = [re.sub(r"\s|\+", "", word).lower() for word in text.split(",")]
    if sorted(word.lstrip("-") for word in words) != list(AXES) or any(word.count("-") > 1 for word in words):
        raise ValueError("x, y and z by commas, each once, some with a minus: x,y,-z")
    return ",".join(words)


def _signs(values: list[int]) -> list[int]:
    if not set(values) <= {1, -1}:
        raise ValueError("1 or -1 for each joint")
    return values


def _permutation(values: list[int]) -> list[int]:
    if sorted(values) != list(range(1, len(values) + 1)):
        raise ValueError("the number of each joint once")
    return values


class FrameTable(StrictSchema):
    """Pose of the measuring frame in the arm's: T(x, y, z) Rx Ry Rz, as `[base]` of an arm file."""

    x_mm: float
    y_mm: float
    z_mm: float
    alpha_deg: float
    beta_deg: float
    gamma_deg: float


class Reading(StrictSchema):
    """Conventions by which a file's numbers become positions and joint angles of the arm; None: as the columns say.

    Attributes:
        axes: the file's axes that are the arm's x, y and z, for instance "x,y,-z".
        joint_sign: 1 or −1 for each joint of the arm.
        joint_order: for each joint of the arm, the number of the file's column.
        bad_rows: "refuse": a cell that is no number is an error; "skip": its row is left out.
        frame: "arm": the frame of the arm file; "unknown": to be found; else its pose in the arm's.
    """

    unit: LengthUnit | None = None
    angle_unit: AngleUnit | None = None
    axes: Annotated[str, AfterValidator(parse_axes)] | None = None
    joint_sign: Annotated[list[int], AfterValidator(_signs)] | None = None
    joint_order: Annotated[list[int], AfterValidator(_permutation)] | None = None
    frame: Literal["arm", "unknown"] | FrameTable | None = None
    bad_rows: Literal["refuse", "skip"] | None = None

    def over(self, other: Reading | None) -> Self:
        """This reading, completed by what `other` says where it says nothing."""
        return self if other is None else self.model_copy(update={**other.said(), **self.said()})

    def said(self) -> dict[str, Any]:
        """The fields that are not None."""
        return {name: value for name in Reading.model_fields if (value := getattr(self, name)) is not None}


AS_NAMED = Reading()
"""The reading that the columns' names say."""
