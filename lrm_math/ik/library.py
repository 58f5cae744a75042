"""Commands spread over the whole range and where the arm is then: seeds for goals that the closed form cannot take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.chain import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.ik.newton import LEVER
from lrm_math.ik.settled import settled
from lrm_math.model import Model
from lrm_math.poses import poses_of
from lrm_math.walk import frames

SIZE = 2048
COARSE = 1e-5


@dataclass(frozen=True, eq=False)
class Library:
    """M settled poses: commands `q` (M, n) in rad, amounts of the moving slots (M, V) and TCP (M, 4, 4) there."""

    q: Array
    amounts: Array
    tcp: Array

    @classmethod
    def of(cls, model: Model, slots: Sequence[int]) -> Library:
        """Poses without load, evenly spread, and amounts of `slots`; where this arm would not settle there is none."""
        n = model.arm.dof
        lower = np.array([joint.lower for joint in model.arm.joints])
        upper = np.array([joint.upper for joint in model.arm.joints])
        q = lower + _spread(SIZE, n) * (upper - lower)
        rest, _ = settled(model, poses_of(q), tolerance=COARSE)
        count = len(rest.poses)
        amounts = np.stack([np.broadcast_to(rest.slots[k], count) for k in slots], axis=1)
        return cls(rest.poses.q, amounts, frames(model.chain, rest.slots, count)[:, -1])

    def closest(self, goal: Goal, count: int) -> Indices:
        """(count,), numbers of the poses closest to a goal, the closest first."""
        far = ((self.tcp[:, :3, 3] - goal.position) ** 2).sum(axis=1)
        if goal.rotation is not None:
            far += LEVER**2 * ((self.tcp[:, :3, :3] - np.array(goal.rotation)) ** 2).sum(axis=(1, 2))
        elif goal.approach is not None:
            far += LEVER**2 * ((self.tcp[:, :3, 2] - np.array(goal.approach)) ** 2).sum(axis=1)
        return np.argsort(far)[:count]


def _spread(count: int, n: int) -> Array:
    """(count, n), evenly over the unit cube: an additive sequence with irrational steps (Roberts 2018)."""
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, n + 1.0))) % 1.0
