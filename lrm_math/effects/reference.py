"""References to effects and parameters: the only place that builds or parses a name of a model file."""

from __future__ import annotations

from typing import NamedTuple

_AT, _OF = "@", "."


class EffectRef(NamedTuple):
    """An effect: what it is, and where it acts; "" stands for all its places. As text `backlash@joint2`, `backlash`."""

    id: str
    place: str = ""

    @classmethod
    def parse(cls, name: str) -> EffectRef:
        """From its text."""
        effect_id, _, place = name.partition(_AT)
        return cls(effect_id, place)

    def __str__(self) -> str:
        return f"{self.id}{_AT}{self.place}" if self.place else self.id


class ParameterRef(NamedTuple):
    """A parameter of an effect at a place. As text, the key in model files, `backlash.joint2.b_rad`."""

    id: str
    place: str
    name: str

    @classmethod
    def parse(cls, key: str) -> ParameterRef:
        """From its text.

        Raises:
            ValueError: it has fewer than three parts.
        """
        effect_id, place, name = key.split(_OF, 2)
        return cls(effect_id, place, name)

    def __str__(self) -> str:
        return _OF.join(self)

    @property
    def effect(self) -> EffectRef:
        """The effect that it belongs to."""
        return EffectRef(self.id, self.place)


def effect_of(key: str) -> str:
    """The `Effect.name` of the effect that a parameter belongs to, by its key."""
    return str(ParameterRef.parse(key).effect)


BASE_OFFSETS = EffectRef("offsets", "base")
"""Where the arm stands."""
