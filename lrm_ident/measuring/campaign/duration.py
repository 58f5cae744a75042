"""Time that a campaign takes, from its poses and the speed of the arm, before anything moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import APPROACH
from lrm_ident.measuring.campaign.run import PoseTiming, held
from lrm_ident.measuring.campaign.servo_arm import GLANCE_S
from lrm_math.arrays import Array


def pose_durations(poses: Sequence[PlannedPose], timing: PoseTiming, rates: Sequence[float]) -> Array:
    """(N,), s, that each pose takes: its motion, its rest, and the pause where that is longer.

    Straight ways, by way of the side that each joint arrives from, at joint speeds `rates` (n,), rad/s; a way round
    obstacles takes longer. The arm counts as standing at the first pose.
    """
    q = np.array([pose.q for pose in poses])
    sides = np.array([pose.approach or (0,) * len(pose.q) for pose in poses])
    beside = q - sides * APPROACH
    legs = np.abs(beside - np.vstack([q[:1], q[:-1]])), np.abs(q - beside)
    moves = sum((leg / np.array(rates)).max(axis=1) for leg in legs)
    rests = [held(timing, pose).settle + timing.dwell for pose in poses]
    return np.asarray(np.maximum(moves + GLANCE_S + rests, timing.pause))
