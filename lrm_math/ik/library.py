"""Commands spread over the whole range and where the arm is then: seeds for goals that the closed form cannot take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import settled
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.ik.newton import LEVER
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import LARGEST_MOTION
from lrm_math.model.model import Model

SIZE = 2048
COARSE = 1e-5
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Ball:
    """All that is no further than `radius` (m) from `centre` (m)."""

    centre: tuple[float, float, float]
    radius: float

    def holds(self, position: Sequence[float]) -> bool:
        """Whether a position (m) is within."""
        return math.dist(self.centre, position) <= self.radius


@dataclass(frozen=True, eq=False)
class Library:
    """M settled poses: commands `q` (M, n) in rad, amounts of the moving slots (M, V) and TCP (M, 4, 4) there.

    `around`: what holds every place that the TCP can be at, poses of the library or not.
    """

    q: Array
    amounts: Array
    tcp: Array
    around: Ball

    @classmethod
    def of(cls, model: Model, slots: Sequence[int]) -> Library:
        """Poses without load, evenly spread, and amounts of `slots`; where this arm would not settle there is none.

        Raises:
            LrmError: it settles nowhere.
        """
        n = model.arm.dof
        lower = np.array([joint.lower for joint in model.arm.joints])
        upper = np.array([joint.upper for joint in model.arm.joints])
        q = lower + _spread(SIZE, n) * (upper - lower)
        rest, _ = settled(model, poses_of(q), tolerance=COARSE)
        count = len(rest.poses)
        if not count:
            raise LrmError(
                "the arm comes to rest in none of many poses without load; its compliances must be too large"
            )
        amounts = np.stack([np.broadcast_to(rest.slots[k], count) for k in slots], axis=1)
        return cls(rest.poses.q, amounts, frames(model.chain, rest.slots, count)[:, -1], ball_of(model))

    def closest(self, goal: Goal, count: int) -> Indices:
        """(count,), numbers of the poses closest to a goal, the closest first."""
        far = self._far(goal)
        some = np.argpartition(far, count)[:count] if count < len(far) else np.arange(len(far))
        return np.asarray(some[np.argsort(far[some])])

    def gap(self, goal: Goal) -> float:
        """How far the closest pose is from a goal: m, turns weighed by `newton.LEVER`."""
        return math.sqrt(float(self._far(goal).min()))

    def _far(self, goal: Goal) -> Array:
        """(M,), m², by the chords of turns."""
        far = ((self.tcp[:, :3, 3] - goal.position) ** 2).sum(axis=1)
        if goal.rotation is not None:
            far += LEVER**2 * ((self.tcp[:, :3, :3] - np.array(goal.rotation)) ** 2).sum(axis=(1, 2))
        elif goal.approach is not None:
            far += LEVER**2 * ((self.tcp[:, :3, 2] - np.array(goal.approach)) ** 2).sum(axis=1)
        return np.asarray(far)


def ball_of(model: Model) -> Ball:
    """A ball that no command can take the TCP out of: slot by slot from the tool inwards.

    What turns all the way round takes a ball's centre to its axis at most, and what gives way no further than an
    equilibrium may. Of an arm that slides under loads it is the whole space.
    """
    chain, wiring = model.chain, model.wiring
    turning = {*chain.joint_slots, *(k for effect in wiring.rigid for k in effect.moves)}
    x, y, z, radius = 0.0, 0.0, 0.0, 0.0
    for k in reversed(range(len(chain.slots))):
        slot, moving = chain.slots[k], k in turning or k in wiring.moving
        centre = [x, y, z]
        if not slot.rotates:
            centre[slot.axis] += wiring.steady[k]
            radius = math.inf if moving else radius
        else:
            i, j = (slot.axis + 1) % 3, (slot.axis + 2) % 3
            lever = math.hypot(centre[i], centre[j])
            if k in turning:
                radius, centre[i], centre[j] = radius + lever, 0.0, 0.0
            else:
                radius += 2.0 * math.sin(0.5 * LARGEST_MOTION) * lever if moving else 0.0
                c, s = math.cos(wiring.steady[k]), math.sin(wiring.steady[k])
                centre[i], centre[j] = c * centre[i] - s * centre[j], s * centre[i] + c * centre[j]
        x, y, z = centre
    return Ball((x, y, z), radius * (1.0 + ROUND_OFF))


def _spread(count: int, n: int) -> Array:
    """(count, n), evenly over the unit cube: an additive sequence with irrational steps (Roberts 2018)."""
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, n + 1.0))) % 1.0
