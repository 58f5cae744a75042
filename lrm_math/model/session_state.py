"""State that effects of a measurement session leave behind, as a model carries it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

Moment: TypeAlias = Literal["last", "mean"]
"""Moment of a session whose state stands for what follows it: its end, or the mean of all measured poses."""


@dataclass(frozen=True)
class StateAfterSession:
    """State that goes along where effects of a session are left out.

    Attributes:
        moments: of each effect (`id@place`), the moment whose state it is.
        offsets: what is added to constant offsets, by their keys (rad, m).
    """

    moments: Mapping[str, Moment]
    offsets: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """The state that is deployed in words; empty where there is none."""
        by_moment = {
            moment: [name for name, one in self.moments.items() if one == moment] for moment in ("last", "mean")
        }
        parts = [f"the {moment} state of {', '.join(names)}" for moment, names in by_moment.items() if names]
        return f"The deployed model keeps {' and '.join(parts)}." if parts else ""
