"""What may touch: capsules on the arm's links and boxes around it. Frozen values in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

from lrm_math.errors import LrmError, UnknownName

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` (m) of the line from `start` to `end` (m), a ball where the two are one.

    `frame`: the number of the frame it stands in (0 base, i after joint i, n + 1 tool).
    """

    name: str
    frame: int
    start: Triple
    end: Triple
    radius: float

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise LrmError(f"capsule '{self.name}': its radius is {self.radius:g} m; it must be above zero")


@dataclass(frozen=True)
class Box:
    """A solid box that never moves, given by its centre and the lengths of its edges (m), turned by Rx Ry Rz (rad).

    `in_base`: whether it is given in the arm's base frame, tilted as that is, or in the frame of TCP positions.
    """

    name: str
    centre: Triple
    size: Triple
    turn: Triple = (0.0, 0.0, 0.0)
    in_base: bool = False

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise LrmError(f"box '{self.name}': its edges are {self.size} m; they must be above zero")


@dataclass(frozen=True)
class Shapes:
    """Every capsule and box of an arm, how far they must stay apart (m), and the pairs that need not.

    Bodies in the same frame or in neighbouring ones are never held against each other; `ignored` names further pairs.
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


NO_SHAPES = Shapes()
