"""Fixed end of a string potentiometer or telescoping ball bar: where measured distances start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects.base import Effect, Excitation, Parameter

TYPICAL = 0.1  # m: how well a point beside an arm is known without measuring it


class Anchor(Effect):
    """Position of the point from which distances of the TCP are measured; it moves nothing of the arm."""

    id = "anchor"
    cause = "The fixed end of the string or ball bar is not where it was said to be, or was never measured."
    formula = "distance = |TCP - (stated point + x, y, z)|; without a stated point, x, y, z are its coordinates"
    source = "telescoping ball bar: Goswami, Quaid & Peshkin 1993; single wire draw: Driels & Swayze 1994"
    claim = "the distances start {x_mm}, {y_mm}, {z_mm} from the stated point"
    needs = "distances from a fixed point (distance_mm)"
    online = False
    instrument = True
    follows_angles = False
    parameters = tuple(Parameter(f"{axis}_mm", f"{axis} of the fixed end of the distances", TYPICAL) for axis in "xyz")

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The measured distance."""
        return ("distance",)

    def anchor_shift(self, p: Sequence[float]) -> Array | None:
        """x, y, z."""
        return np.array(p)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Distances must have been measured."""
        return None if excitation.distance else "no distances (distance_mm) were measured"
