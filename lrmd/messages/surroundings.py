"""Parts of messages about what is around the arm: contacts that a request permits, obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import msgpack
from pydantic import AfterValidator, Field, model_validator

from lrm_math.arm.collision_shapes import WORLD, Box, Capsule, HeightField, Obstacle
from lrm_math.arrays import Vector3
from lrm_math.collision.contact import Contact, ContactPermit
from lrmd.messages.codec import Part


def printable(text: str) -> str:
    """A text that may be shown on a terminal. Raises `ValueError`."""
    if not text.isprintable():
        raise ValueError("printable characters only")
    return text


Label = Annotated[str, Field(max_length=64), AfterValidator(printable)]
"""Text that is shown on terminals."""
Coordinate = Annotated[float, Field(ge=-100, le=100)]
Position = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]


class ContactEntry(Part):
    """Contact that a request permits: shapes `first` and `second`, one of them around the arm, while the tip is in the
    box from `low_m` to `high_m`.

    `depth_m`: how deep the shapes may overlap as commanded; below zero: the gap that stays. `force_n`: largest force,
    by which the model's stiffness limits the depth.
    """

    first: Label
    second: Label
    low_m: Position
    high_m: Position
    depth_m: Annotated[float, Field(ge=-0.1, le=0.02)] = 0.0
    force_n: Annotated[float, Field(ge=0, le=20)] = 2.0

    @model_validator(mode="after")
    def _box(self) -> Self:
        if not all(a < b for a, b in zip(self.low_m, self.high_m, strict=True)):
            raise ValueError("low_m must be below high_m on every axis")
        return self


def contacts_of(entries: Sequence[ContactEntry]) -> tuple[Contact, ...]:
    """The contacts of a request."""
    return tuple(
        Contact(ContactPermit(e.first, e.second, vector(e.low_m), vector(e.high_m), e.depth_m), e.force_n)
        for e in entries
    )


def vector(values: Sequence[float]) -> Vector3:
    """Three numbers as a vector."""
    x, y, z = values
    return x, y, z


Length = Annotated[float, Field(gt=0, le=10)]
Rotation = Annotated[list[Annotated[float, Field(ge=-20, le=20)]], Field(min_length=3, max_length=3)]
MOST_OBSTACLES = 32
"""Obstacles that a daemon knows at once, of all owners."""
MOST_HEIGHTS, MOST_CELLS = 2048, 4096
"""Heights of a heightfield, and of all that it knows at once."""
FINEST_CELL = 0.005
"""m."""
WANTED = {
    "box": ("size_m",),
    "sphere": ("radius_m",),
    "capsule": ("end_m", "radius_m"),
    "heightfield": ("cell_m", "columns", "heights_m"),
}
"""Fields of a shape that it has to have, beside `position_m`."""
ROTATED = ("box", "heightfield")
"""Shapes that may have `rotation_rad`."""


class ObstacleEntry(Part):
    """Obstacle in the frame of TCP positions.

    `box`: about its centre `position_m`, with edges `size_m`, rotated by Rx Ry Rz (`rotation_rad`). `sphere`: about
    `position_m`. `capsule`: within `radius_m` of the segment from `position_m` to `end_m`. `heightfield`: square
    columns with edges `cell_m`, solid up to `heights_m` and without end below; row by row along its y axis, each of
    `columns` heights along x, the first column's corner at `position_m`; None: no column is there.
    """

    name: Annotated[str, Field(min_length=1, max_length=64), AfterValidator(printable)]
    shape: Literal["box", "sphere", "capsule", "heightfield"]
    position_m: Position
    size_m: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = None
    rotation_rad: Rotation | None = None
    end_m: Position | None = None
    radius_m: Length | None = None
    cell_m: Annotated[float, Field(ge=FINEST_CELL, le=10)] | None = None
    columns: Annotated[int, Field(ge=1, le=MOST_HEIGHTS)] | None = None
    heights_m: Annotated[list[Coordinate | None], Field(min_length=1, max_length=MOST_HEIGHTS)] | None = None

    @model_validator(mode="after")
    def _fields_of_the_shape(self) -> Self:
        wanted = WANTED[self.shape]
        allowed = (*wanted, "rotation_rad") if self.shape in ROTATED else wanted
        for name in ("size_m", "rotation_rad", "end_m", "radius_m", "cell_m", "columns", "heights_m"):
            given = getattr(self, name) is not None
            if (given and name not in allowed) or (not given and name in wanted):
                raise ValueError(f"a {self.shape} has {', '.join(('position_m', *wanted))}; {name} is wrong there")
        if self.columns is not None and self.cells % self.columns:
            raise ValueError(f"heights_m has {self.cells} heights; they do not fill rows of {self.columns} columns")
        return self

    @property
    def cells(self) -> int:
        """Number of heights; 0 of another shape."""
        return len(self.heights_m or ())

    def built(self) -> Obstacle:
        """The shape."""
        place, rotation = vector(self.position_m), vector(self.rotation_rad or (0.0, 0.0, 0.0))
        if self.size_m is not None:
            return Box(self.name, place, vector(self.size_m), rotation)
        if self.heights_m is not None:
            assert self.columns is not None
            assert self.cell_m is not None
            flat = [-math.inf if height is None else height for height in self.heights_m]
            rows = tuple(tuple(flat[i : i + self.columns]) for i in range(0, len(flat), self.columns))
            return HeightField(self.name, place, self.cell_m, rows, rotation)
        assert self.radius_m is not None
        return Capsule(self.name, WORLD, place, vector(self.end_m or self.position_m), self.radius_m)


def packed(obstacles: Sequence[ObstacleEntry]) -> bytes:
    """Obstacles as bytes, for another process of the daemon."""
    return bytes(msgpack.packb([entry.model_dump() for entry in obstacles]))


def unpacked(data: bytes) -> tuple[ObstacleEntry, ...]:
    """Obstacles from the bytes of `packed`."""
    return tuple(ObstacleEntry.model_validate(entry) for entry in msgpack.unpackb(data)) if data else ()
