"""Doors to a motor: ways by which something outside asks an arm to move, each driven by its tests in the same manner.

A door keeps the laws of `tests.doors.laws`, whoever wrote it. A module `tests/doors/NAME_door.py` has a tuple `DOORS`
of the kinds that it knows, and `registry` finds it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, TypeAlias

Angles: TypeAlias = tuple[float, ...]
"""(n,), rad, in the order of the door's joints."""


class MotionDoor(Protocol):
    """One door with an arm behind it, real or simulated, and the time of that arm.

    What asks (`torque_on`, `ask`, `stop`) comes back at once or when the door has answered, and raises `LrmError` where
    the door refuses or reports a fault; the arm may still be on its way. `commanded`, `standing` and `powered` look
    past the door, at bytes, registers or counts behind it.
    """

    @property
    def joints(self) -> Sequence[str]:
        """Their names, as the door's errors write them."""

    def torque_on(self) -> None:
        """Switches the arm on, where it stands, as a user of this door does."""

    def ask(self, wish: Sequence[float]) -> None:
        """Asks for a motion to angles (n,), rad."""

    def stop(self) -> None:
        """Asks for the arm to stop, and comes back when the door has confirmed."""

    def lose_contact(self) -> None:
        """Ends the contact of whoever asked: killed, frozen, or unplugged. Nobody asks for anything after it."""

    def disturb(self) -> None:
        """Stalls what is on the way, or loses an answer: something that a busy or noisy place does by itself."""

    def pass_time(self, seconds: float) -> None:
        """Lets time pass for the door and the arm (s)."""

    def commanded(self) -> Angles:
        """Angles (n,), rad, that the motors are told now."""

    def standing(self) -> Angles:
        """Angles (n,), rad, of the shafts now."""

    def powered(self) -> frozenset[str]:
        """Names of the joints that have torque now."""


@dataclass(frozen=True)
class DoorKind:
    """A way to a motor.

    Attributes:
        modules: dotted names of the project's modules that write to a motor in it.
        open: opens one with an arm that stands somewhere and has no torque, by a seed.
        stop_s: after a confirmed stop nothing is commanded any more after so long (s), the bound of law (d).
        contact_s: likewise after contact is lost, the bound of law (e).
        reach: rad, that random wishes are within.
        slow: whether it takes real time, of which a test affords little.
        abreast: how many of them a long run may drive side by side.
        close: ends what serves all of them.
    """

    name: str
    modules: tuple[str, ...]
    open: Callable[[int], AbstractContextManager[MotionDoor]]
    stop_s: float
    contact_s: float
    reach: float = 0.8
    slow: bool = False
    abreast: int = 1
    close: Callable[[], None] = lambda: None
