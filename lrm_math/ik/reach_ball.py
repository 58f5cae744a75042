"""A ball that contains every position that a model's tool can have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lrm_math.model.equilibrium import LARGEST_MOTION, LARGEST_SLIDE
from lrm_math.model.model import Model

ROUND_OFF = 1e-9


@dataclass(frozen=True)
class ReachBall:
    """All points no further than `radius` (m) from `centre` (m)."""

    centre: tuple[float, float, float]
    radius: float

    def contains(self, position: Sequence[float]) -> bool:
        """Whether a position (m) is within."""
        return math.dist(self.centre, position) <= self.radius


def reach_ball(model: Model) -> ReachBall:
    """A ball that contains the TCP for every command: recursion over the slots from the tool inwards.

    Slots that turn all the way round take a ball's centre to their axis at most, elastic ones no further than an
    equilibrium may. For an arm that slides by its commands it is the whole space.
    """
    chain, binding = model.chain, model.binding
    turning = {*chain.turning_slots, *(k for effect in binding.rigid for k in effect.slots)}
    x, y, z, radius = 0.0, 0.0, 0.0, 0.0
    for k in reversed(range(len(chain.slots))):
        slot, moving = chain.slots[k], k in turning or k in binding.moving
        centre = [x, y, z]
        if not slot.rotates:
            centre[slot.axis] += binding.constants[k]
            radius += math.inf if k in turning else LARGEST_SLIDE if moving else 0.0
        else:
            i, j = (slot.axis + 1) % 3, (slot.axis + 2) % 3
            lever = math.hypot(centre[i], centre[j])
            if k in turning:
                radius, centre[i], centre[j] = radius + lever, 0.0, 0.0
            else:
                radius += 2.0 * math.sin(0.5 * LARGEST_MOTION) * lever if moving else 0.0
                c, s = math.cos(binding.constants[k]), math.sin(binding.constants[k])
                centre[i], centre[j] = c * centre[i] - s * centre[j], s * centre[i] + c * centre[j]
        x, y, z = centre
    return ReachBall((x, y, z), radius * (1.0 + ROUND_OFF))
