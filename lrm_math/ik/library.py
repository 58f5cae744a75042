"""Library of settled poses all over the joint range: seeds for goals that the closed form cannot solve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import batch_equilibrium
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.ik.multi_start import roberts_sequence
from lrm_math.ik.newton import CHAR_LENGTH
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import LARGEST_MOTION
from lrm_math.model.model import Model

SIZE = 2048
COARSE = 1e-5
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Ball:
    """All points no further than `radius` (m) from `centre` (m)."""

    centre: tuple[float, float, float]
    radius: float

    def contains(self, position: Sequence[float]) -> bool:
        """Whether a position (m) is within."""
        return math.dist(self.centre, position) <= self.radius


@dataclass(frozen=True, eq=False)
class PoseLibrary:
    """M settled poses: commands `q` (M, n) in rad, slot amounts (M, V) and TCP (M, 4, 4) there.

    `reach_ball`: contains every position that the TCP can have.
    """

    q: Array
    amounts: Array
    tcp: Array
    reach_ball: Ball

    @classmethod
    def of(cls, model: Model, slots: Sequence[int]) -> PoseLibrary:
        """Poses without load, evenly spread, with amounts of `slots`; those that do not settle are left out.

        Raises `LrmError`: none settles.
        """
        n = model.arm.dof
        lower = np.array([joint.lower for joint in model.arm.joints])
        upper = np.array([joint.upper for joint in model.arm.joints])
        q = lower + roberts_sequence(SIZE, n) * (upper - lower)
        rest, _ = batch_equilibrium(model, poses_of(q), tolerance=COARSE)
        count = len(rest.poses)
        if not count:
            raise LrmError(
                "the arm comes to rest in none of many poses without load; its compliances must be too large"
            )
        amounts = np.stack([np.broadcast_to(rest.slots[k], count) for k in slots], axis=1)
        return cls(rest.poses.q, amounts, frames(model.chain, rest.slots, count)[:, -1], reach_ball(model))

    def closest(self, goal: Goal, count: int) -> Indices:
        """(count,), numbers of the poses closest to a goal, the closest first."""
        square = self._squared_distance(goal)
        some = np.argpartition(square, count)[:count] if count < len(square) else np.arange(len(square))
        return np.asarray(some[np.argsort(square[some])])

    def gap(self, goal: Goal) -> float:
        """Distance of the closest pose from a goal: m, rotation weighed by `newton.CHAR_LENGTH`."""
        return math.sqrt(float(self._squared_distance(goal).min()))

    def _squared_distance(self, goal: Goal) -> Array:
        """(M,), m², squared distances from a goal, rotations by chords."""
        square = ((self.tcp[:, :3, 3] - goal.position) ** 2).sum(axis=1)
        if goal.rotation is not None:
            square += CHAR_LENGTH**2 * ((self.tcp[:, :3, :3] - np.array(goal.rotation)) ** 2).sum(axis=(1, 2))
        elif goal.approach is not None:
            square += CHAR_LENGTH**2 * ((self.tcp[:, :3, 2] - np.array(goal.approach)) ** 2).sum(axis=1)
        return np.asarray(square)


def reach_ball(model: Model) -> Ball:
    """A ball that contains the TCP for every command: recursion over the slots from the tool inwards.

    Slots that turn all the way round take a ball's centre to their axis at most, elastic ones no further than an
    equilibrium may. For an arm that slides under loads it is the whole space.
    """
    chain, binding = model.chain, model.binding
    turning = {*chain.joint_slots, *(k for effect in binding.rigid for k in effect.moves)}
    x, y, z, radius = 0.0, 0.0, 0.0, 0.0
    for k in reversed(range(len(chain.slots))):
        slot, moving = chain.slots[k], k in turning or k in binding.moving
        centre = [x, y, z]
        if not slot.rotates:
            centre[slot.axis] += binding.constants[k]
            radius = math.inf if moving else radius
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
    return Ball((x, y, z), radius * (1.0 + ROUND_OFF))
