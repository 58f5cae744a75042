"""State that effects of a measurement session leave behind, as a model carries it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

CarriedState: TypeAlias = Literal["last", "mean"]
"""State of a session that is carried forward: that of its last pose (last observation carried forward), or the mean."""


@dataclass(frozen=True)
class SessionMemory:
    """Memory of an effect in its session.

    Attributes:
        parts: what of the offsets, springs and gains of `StateAfterSession` stands for it, by their keys; the effect
            itself replaces them where it is known what the arm did before.
        mean, sd: of each number of its memory, in the effect's order and units: of an arm of which nothing is known.
    """

    parts: Mapping[str, float]
    mean: tuple[float, ...]
    sd: tuple[float, ...]


@dataclass(frozen=True)
class StateAfterSession:
    """State that goes along where effects of a session are left out.

    Attributes:
        carried: of each effect (`id@place`), which state is carried forward.
        offsets: what is added to constant offsets (rad, m), springs (rad/N·m) and gains, by their keys.
        warming: effects whose law is followed where the time since power-on is known, each with its part of the offset
            of its joint (rad), which its law replaces then.
        memory: of each effect that follows what the arm did before, where that is known.
    """

    carried: Mapping[str, CarriedState]
    offsets: Mapping[str, float]
    warming: Mapping[str, float] = field(default_factory=dict)
    memory: Mapping[str, SessionMemory] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """The state that is deployed in words; empty where there is none."""
        return self.sentence_with(str)

    def sentence_with(self, named: Callable[[str], str]) -> str:
        """The sentence with the names of effects as they are to be `named`."""
        by_state = {
            state: [named(name) for name, carried_as in self.carried.items() if carried_as == state]
            for state in ("last", "mean")
        }
        parts = [f"the {state} state of {', '.join(names)}" for state, names in by_state.items() if names]
        kept = f"The deployed model keeps {' and '.join(parts)}" if parts else ""
        said = [
            f"Where {state_words}, {', '.join(map(named, names))} follows it"
            for state_words, names in (
                ("the time since power-on is known", self.warming),
                ("it is known what the arm did before", self.memory),
            )
            if names
        ]
        return "".join(f"{sentence}. " for sentence in (kept, *said) if sentence).strip()
