"""Library of settled poses all over the joint range: seeds of every search, and what is known of the reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.joint_errors import JointErrorModel
from lrm_math.ik.kernel.kernel_model import KernelModel
from lrm_math.kinematics.poses import poses_of, roberts_sequence
from lrm_math.model.batch_equilibrium import batch_equilibrium
from lrm_math.model.reach_ball import ReachBall, reach_ball

SIZE = 2048
COARSE = 1e-5
"""m: tolerance of the library's equilibria."""
CHAR_LENGTH = 0.1
"""m: weight of a rotation by 1 rad against a distance (characteristic length), as in the kernel."""


@dataclass(frozen=True, eq=False)
class PoseLibrary:
    """M settled poses without load.

    Attributes:
        q: (M, n), commands (rad). slots: (M, V), amounts of the moving slots (rad, m). tau: (M, V), their loads (N·m).
        tcp: (M, 4, 4), tool frames (m).
        reach_ball: contains every position that the TCP can have.
    """

    q: Array
    slots: Array
    tau: Array
    tcp: Array
    reach_ball: ReachBall

    @classmethod
    def of(cls, errors: JointErrorModel, arm: KernelModel) -> PoseLibrary:
        """Poses evenly spread over the limits; those that do not settle are left out. Raises `LrmError`: none does."""
        joints = errors.model.arm.joints
        lower, upper = np.array([joint.lower for joint in joints]), np.array([joint.upper for joint in joints])
        q, slots = _settled(errors, arm, lower + roberts_sequence(SIZE, len(joints)) * (upper - lower))
        if not len(q):
            raise LrmError(
                "the arm comes to rest in none of many poses without load; its compliances must be too large"
            )
        tcp, tau = arm.forward(slots)
        return cls(q, slots, tau, tcp, reach_ball(errors.model))

    def nonlinear_bound(self, errors: JointErrorModel) -> float:
        """rad, bound on the share of nonlinear effects in a command: twice the largest of the library."""
        joints = errors.moving.joints
        linear = self.slots[:, joints] - errors.constants[joints] - self.tau @ errors.compliances[joints].T
        return 2.0 * float(np.abs(linear - self.q).max())


def _settled(errors: JointErrorModel, arm: KernelModel, q: Array) -> tuple[Array, Array]:
    """Those of commands (K, n) that settle, and slot amounts there."""
    if errors.complete:
        start = np.tile(errors.constants, (len(q), 1))
        start[:, errors.moving.joints] += q
        slots, _, iterations = arm.settle(q, np.zeros_like(q), start, COARSE)
        return q[iterations > 0], slots[iterations > 0]
    settled, _ = batch_equilibrium(errors.model, poses_of(q), tolerance=COARSE)
    count = len(settled.poses)
    return settled.poses.q, np.stack([np.broadcast_to(settled.slots[k], count) for k in errors.moving.slots], axis=1)
