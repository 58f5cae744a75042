"""Level 2: errors of the nominal geometry (thesis Table 4.3, 38 parameters for six joints without parallel axes).

A link whose two axes are (nearly) parallel has Hayati's angle beta too: a turn about its y (Hayati & Mirmirani 1985).
"""

from __future__ import annotations

from functools import cached_property

from lrm_math.arm.arm import BASE, TOOL, Arm, TypicalSizes
from lrm_math.effects.base import Amounts, Description, Extrapolation, LinearEffect, Parameter, separately
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.poses import Poses

BASE_TURN, BASE_SHIFT = 0.5, 0.25
"""rad and m: by so much a base may stand elsewhere in the tracker's frame, which is no error of the arm."""
ZERO_TURN = 0.5
"""rad: by so much a joint's zero may be off, since a servo's horn fits at every tooth: one of 25 is 14.4 deg."""


class Offsets(LinearEffect):
    """Constant errors added to the nominal dimensions of one link, the base or the tool."""

    id = "offsets"
    about = Description(
        cause="Parts are printed and screwed together a little longer, shorter or more twisted than drawn.",
        formula="each nominal dimension + its own constant",
        source="Conenna 2024, Table 4.3; Hayati & Mirmirani 1985 (beta of parallel axes)",
        claim="{place} is not as drawn",
    )

    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, with a motor or without, the base and the tool."""
        return (*arm.link_places, BASE, TOOL)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each dimension at this place; how well an arm stands in its place does not depend on its make."""
        sizes = TypicalSizes() if self.place == BASE else self.arm.typical_sizes
        turn, shift = (BASE_TURN, BASE_SHIFT) if self.place == BASE else (None, None)
        return tuple(
            Parameter(
                f"{slot.name}_rad",
                f"error of the angle {slot.key}",
                sizes.angle,
                usual=turn,
                largest=ZERO_TURN if slot.name == "theta" else None,
            )
            if slot.rotates
            else Parameter(f"{slot.name}_mm", f"error of the length {slot.key}", sizes.length, usual=shift)
            for slot in chain_of(self.arm).slots
            if slot.place == self.place
        )

    @cached_property
    def targets(self) -> tuple[str, ...]:
        """Every slot at this place."""
        return tuple(slot.key for slot in chain_of(self.arm).slots if slot.place == self.place)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """One for the parameter's own slot."""
        return separately([(1.0,)] * len(self.targets))
