"""Parts of messages about what is around the arm: contacts that a request permits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from lrm_math.arrays import Vector3
from lrm_math.collision.contact import Contact, ContactPermit
from lrmd.messages.codec import Part


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("printable characters only")
    return text


Label = Annotated[str, Field(max_length=64), AfterValidator(_printable)]
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
