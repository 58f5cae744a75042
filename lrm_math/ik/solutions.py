"""One query of the calibrated inverse, and what a method finds: commands, or where it stalled."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_math.ik.goal import Goal

AT_LIMIT = 1e-9
"""rad: a command this far beyond a limit is at the limit."""


@dataclass(frozen=True, slots=True)
class IkQuery:
    """The goal, the payload (kg), and the present joint angles (rad), if known."""

    goal: Goal
    payload: float = 0.0
    near: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class IkSolution:
    """One command that reaches a goal.

    Attributes:
        q: rad, whatever the limits.
        direction: the side that each joint arrives from (see `Poses`), zeros where it is not known.
        detour: joints from 1 that a move straight from `near` would bring from the other side.
        slots: amounts of the moving slots (rad, m).
        margin: distance to the nearest limit (rad), negative beyond.
        free: number from 1 of a joint that can turn while the tool hardly moves; None if there is none.
    """

    q: tuple[float, ...]
    direction: tuple[int, ...]
    detour: tuple[int, ...]
    slots: tuple[float, ...]
    margin: float
    free: int | None = None


@dataclass(frozen=True, slots=True)
class IkSolutions:
    """Commands that a method found, and its steps; `error`: m, before the final Newton's method, if it has one."""

    commands: tuple[IkSolution, ...]
    steps: int
    error: float | None = None

    @property
    def within(self) -> list[IkSolution]:
        """Those within the limits."""
        return [command for command in self.commands if command.margin >= -AT_LIMIT]

    @property
    def beyond(self) -> list[IkSolution]:
        """Those beyond, the least excess first."""
        return sorted((c for c in self.commands if c.margin < -AT_LIMIT), key=lambda command: -command.margin)


@dataclass(frozen=True, eq=False)
class Stalled:
    """A method that ended away from the goal.

    `q`: its last command (rad). `errors`: m, the distance from the goal after each step.
    """

    q: tuple[float, ...]
    errors: tuple[float, ...]
