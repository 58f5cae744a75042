"""Effects whose amounts follow a memory that can be integrated: from a file's visits, or by who drives the arm."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from lrm_math.arrays import Array
from lrm_math.effects.base import Effect, Excitation
from lrm_math.kinematics.history import Visits


class EffectWithMemory(Effect):
    """An effect with a memory: a few numbers that what the arm did before has left."""

    depends_on: ClassVar[tuple[str, ...]] = ("time",)
    remembers = True

    @property
    @abstractmethod
    def memories(self) -> int:
        """How many numbers it remembers."""

    @abstractmethod
    def memory(self, visits: Visits, p: Sequence[float]) -> tuple[Array, ...]:
        """Its memory at the end of each of M visits, each (M,), in the order of `Visits.begun`; p: as of `amounts`."""

    def began(self, visits: Visits) -> tuple[float, ...]:
        """Its memory before the first visit: nothing in a file."""
        return (0.0,) * self.memories if visits.begun is None else visits.begun[self.name]

    def when_powered(
        self, stood: Sequence[float], mean: Sequence[float], sd: Sequence[float]
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Mean and standard deviation of its memory when the arm gets power: as likely as not it rested before.

        stood: its memory if it had stood there for long. mean, sd: of the session of its model.
        """
        del mean, sd
        half = tuple(0.5 * x for x in stood)
        return half, half

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The order must be known."""
        return "the order of measurement is not known" if excitation.poses.history is None else None
