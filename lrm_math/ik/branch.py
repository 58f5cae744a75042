"""Branches: the commands that take an arm to one goal, as a search finds them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple


class Branch(NamedTuple):
    """One solution of a goal; a tuple, as a search makes thousands.

    Attributes:
        q: joint angles (rad), commanded ones of a calibrated arm; within the limits unless the verdict is
            outside_limits.
        margin: distance to the nearest joint limit (rad); negative outside.
        number: branch of the closed form, 0 to 7 (see `label`), or -1 where there are no fixed branches.
        free: number from 1 of a joint that can turn while the tool stays, others following; None if there is none.
        direction: of a calibrated arm, the side that each joint arrives from (see `Poses`), zeros where not known.
        detours: joints from 1 that a move straight from `near` would bring from the other side.
        slots: amounts of the moving slots in equilibrium (rad, m).
    """

    q: tuple[float, ...]
    margin: float
    number: int = -1
    free: int | None = None
    direction: tuple[int, ...] = ()
    detours: tuple[int, ...] = ()
    slots: tuple[float, ...] = ()

    @property
    def label(self) -> str:
        """Signs of the three roots of the closed form, e.g. `+-+`; empty where there are none.

        In the order in which they are taken: for an arm whose last three axes intersect elbow, shoulder, wrist; for one
        whose first three do, the same seen from the tool.
        """
        return "" if self.number < 0 else "".join("-" if self.number & bit else "+" for bit in (4, 2, 1))

    def distance(self, q: tuple[float, ...]) -> float:
        """Euclidean distance to q in joint space (rad)."""
        return math.dist(self.q, q)


AT_LIMIT, SAME = 1e-9, 1e-6
"""rad: a command this far beyond a limit is at the limit; commands no further apart are one."""


@dataclass(frozen=True, slots=True)
class IkSolutions:
    """Commands that a method found, and its steps; `error`: m, before the final Newton's method, if it has one."""

    commands: tuple[Branch, ...]
    steps: int
    error: float | None = None

    @property
    def within(self) -> list[Branch]:
        """Commands within the limits."""
        return [command for command in self.commands if command.margin >= -AT_LIMIT]

    @property
    def beyond(self) -> list[Branch]:
        """Commands beyond, the least excess first."""
        return sorted((c for c in self.commands if c.margin < -AT_LIMIT), key=lambda command: -command.margin)


def apart(q: Sequence[float], other: Sequence[float]) -> float:
    """Largest difference of a joint (rad)."""
    return max([abs(a - b) for a, b in zip(q, other, strict=True)])


def distinct(commands: Iterable[Branch], least: float = SAME) -> list[Branch]:
    """Commands without those of which no joint is more than `least` (rad) from one before."""
    kept: list[Branch] = []
    for command in commands:
        if all(apart(command.q, other.q) > least for other in kept):
            kept.append(command)
    return kept
