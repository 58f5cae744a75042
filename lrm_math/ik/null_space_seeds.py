"""Seeds for branches that the closed form has outside the limits although the calibrated arm has them within.

Where axes are aligned, joints turn against each other along the null space; small deflections decide how far.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.equivalent_arm import SLACK
from lrm_math.ik.newton import Target
from lrm_math.ik.singularities import SingularDirection
from lrm_math.ik.solver_context import IkQuery, SolverContext

SLOW = 0.01
"""m/rad: null-space motion is possible where the tool moves slower than this."""
STILL = 0.05
"""Joints that turn by less than this share of the fastest are taken to stay."""
BEYOND = 0.1
"""rad: how far outside the limits a seed may be."""
PARTS = (0.1, 0.5, 0.9)
"""Positions of the seeds along the motion through the limits."""


def null_space_seeds(context: SolverContext, query: IkQuery) -> Array:
    """(M, V), slot amounts: branches of the equivalent arm moved into the limits along the null space.

    For a full pose; none without a closed form.
    """
    linkage, bounds, anywhere = context.linkage, context.bounds, context.equivalent_arm.anywhere
    found = (
        None if anywhere is None or query.goal.rotation is None else anywhere(query.goal.rotation, query.goal.position)
    )
    q = np.array([angles for _, angles in found or ()]).reshape(-1, len(linkage.joints))
    q = q[~bounds.contains(q, SLACK)]
    starts = context.amounts_at(q)
    singular = SingularDirection.of(linkage, Target.of(query.goal), starts)
    moving = np.abs(singular.joint_motion) > STILL
    turn = np.where(moving, singular.joint_motion, 1.0)
    ends = np.sort([(bounds.lower - BEYOND - q) / turn, (bounds.upper + BEYOND - q) / turn], axis=0)
    first, last = np.where(moving, ends[0], -np.inf).max(axis=1), np.where(moving, ends[1], np.inf).min(axis=1)
    within = ((q > bounds.lower - SLACK) & (q < bounds.upper + SLACK)) | moving
    possible = (singular.slope < SLOW) & (first < last) & within.all(axis=1)
    distances = np.array([first + part * (last - first) for part in PARTS])[:, possible]
    out = np.repeat(starts[possible][None], len(PARTS), axis=0)
    out[:, :, linkage.joints] += distances[:, :, None] * singular.joint_motion[possible]
    return np.asarray(out.reshape(-1, starts.shape[1]))
