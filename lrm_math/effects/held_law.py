"""A law as it would be if it did not go on beyond the range that it was measured in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import Amounts, Description, Effect, Extrapolation, Parameter
from lrm_math.kinematics.poses import Poses


@dataclass(frozen=True)
class HeldLaw(Effect):
    """An effect that is held at the edge of the measured range, under the name and the keys of the effect itself."""

    effect: Effect

    id = "held"
    extrapolation = Extrapolation.HELD
    depends_on = ("angle", "direction")
    about = Description(
        cause="No cause: what a law says at the edge of the measured range.",
        formula="f at the nearest angles, loads and payload that were measured",
        source="lrm_math.effects.measured_range",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """None: it is made of an effect."""
        return ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the effect."""
        return self.effect.parameters

    @property
    def targets(self) -> tuple[str, ...]:
        """Those of the effect."""
        return self.effect.targets

    @property
    def load_slots(self) -> tuple[str, ...]:
        """Those of the effect."""
        return self.effect.load_slots

    @property
    def name(self) -> str:
        """That of the effect."""
        return self.effect.name

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Those of the effect."""
        return self.effect.keys

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Those of the effect; whoever asks holds poses and loads, as of every effect that is held."""
        return self.effect.amounts(poses, tau, p)
