"""Starts for branches that the closed form has outside the limits although the arm has them within.

Where axes line up, one joint can turn back what another turns, and a little bending decides how they share it.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.equivalent_arm import SLACK
from lrm_math.ik.folds import Slowest
from lrm_math.ik.newton import Aim
from lrm_math.ik.solver_context import Ask, Deployment

SLOW = 0.01
"""m/rad: a branch can be slid where the tool goes slower than this."""
STILL = 0.05
"""Joints that turn by less than this share of the fastest are taken to stay."""
BEYOND = 0.1
"""rad: how far outside the limits a start may be."""
PARTS = (0.1, 0.5, 0.9)
"""Where the starts are on the way through the limits."""


def slid_into_limits(deployment: Deployment, ask: Ask) -> Array:
    """(M, V), amounts of the moving slots: branches of the look-alike moved into the limits while the tool stays.

    For a whole pose; none without a closed form.
    """
    linkage, band, anywhere = deployment.compensation.linkage, deployment.band, deployment.likeness.anywhere
    found = None if anywhere is None or ask.goal.rotation is None else anywhere(ask.goal.rotation, ask.goal.position)
    q = np.array([angles for _, angles in found or ()]).reshape(-1, len(linkage.joints))
    q = q[~band.holds(q, SLACK)]
    starts = deployment.at(q)
    slowest = Slowest.of(linkage, Aim.of(ask.goal), starts)
    moving = np.abs(slowest.along) > STILL
    turn = np.where(moving, slowest.along, 1.0)
    ends = np.sort([(band.lower - BEYOND - q) / turn, (band.upper + BEYOND - q) / turn], axis=0)
    first, last = np.where(moving, ends[0], -np.inf).max(axis=1), np.where(moving, ends[1], np.inf).min(axis=1)
    within = ((q > band.lower - SLACK) & (q < band.upper + SLACK)) | moving
    possible = (slowest.slope < SLOW) & (first < last) & within.all(axis=1)
    ways = np.array([first + part * (last - first) for part in PARTS])[:, possible]
    out = np.repeat(starts[possible][None], len(PARTS), axis=0)
    out[:, :, linkage.joints] += ways[:, :, None] * slowest.along[possible]
    return np.asarray(out.reshape(-1, starts.shape[1]))
