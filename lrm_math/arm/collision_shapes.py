"""Collision geometry of an arm: capsules on its links and boxes around it. Frozen values in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

from lrm_math.arrays import Vector3
from lrm_math.errors import LrmError, UnknownName

WORLD = -1
"""Frame of a capsule that stands still in the frame of TCP positions."""


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` (m) of the segment from `start` to `end` (m); a sphere where the two coincide.

    `frame`: the number of the frame it is fixed to (0 base, i after joint i, n + 1 tool). `estimated`: whether nobody
    measured where it is or how large.
    """

    name: str
    frame: int
    start: Vector3
    end: Vector3
    radius: float
    estimated: bool = False

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise LrmError(f"capsule '{self.name}': its radius is {self.radius:g} m; it must be above zero")


@dataclass(frozen=True)
class Box:
    """A solid fixed box, given by its centre and the lengths of its edges (m), rotated by Rx Ry Rz (`rotation`, rad).

    `in_base`: whether it is given in the arm's base frame, tilted as that is, or in the frame of TCP positions.
    `estimated`: whether nobody measured where it is or how large.
    """

    name: str
    centre: Vector3
    size: Vector3
    rotation: Vector3 = (0.0, 0.0, 0.0)
    in_base: bool = False
    estimated: bool = False

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise LrmError(f"box '{self.name}': its edges are {self.size} m; they must be above zero")


@dataclass(frozen=True)
class HeightField:
    """A map of heights: square columns on a grid, each solid up to its height and without end below.

    `origin`: the corner of the first column at height 0 (m); `rotation`: of the grid about it, Rx Ry Rz (rad). `cell`:
    edge of a column (m). `heights`: rows of columns, along x in a row and row by row along y (m); minus infinity: there
    is no column.
    """

    name: str
    origin: Vector3
    cell: float
    heights: tuple[tuple[float, ...], ...]
    rotation: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.cell > 0:
            raise LrmError(f"heightfield '{self.name}': its cells are {self.cell:g} m wide; they must be above zero")
        if not self.heights or len({len(row) for row in self.heights}) != 1 or not self.heights[0]:
            raise LrmError(f"heightfield '{self.name}': its rows must have as many heights each, one at least")


Obstacle: TypeAlias = Capsule | Box | HeightField
"""A shape that stands around the arm."""


@dataclass(frozen=True)
class Shapes:
    """Every capsule and box of an arm, the margin (m) that must stay between them, and the pairs exempt from it.

    Bodies in the same frame or in neighbouring ones are not checked against each other; `ignored` names further pairs.
    """

    capsules: tuple[Capsule, ...] = ()
    boxes: tuple[Box, ...] = ()
    margin: float = 0.03
    ignored: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise LrmError(f"two shapes are called '{twice[0]}'; each needs a name of its own")
        for name in chain.from_iterable(self.ignored):
            if name not in names:
                raise UnknownName("shape in collision ignore", name, names)
        if not self.margin >= 0:
            raise LrmError(f"the collision margin is {self.margin:g} m; it must not be below zero")

    @property
    def names(self) -> tuple[str, ...]:
        """Capsules first, then boxes."""
        return (*(capsule.name for capsule in self.capsules), *(box.name for box in self.boxes))

    @property
    def estimated(self) -> frozenset[str]:
        """Names of the shapes that nobody measured."""
        shapes: tuple[Capsule | Box, ...] = (*self.capsules, *self.boxes)
        return frozenset(shape.name for shape in shapes if shape.estimated)
