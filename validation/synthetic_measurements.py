"""Measurements of the independent generator's arms, with noise."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from validation import synthetic

NOISE = 3e-4
"""m per axis."""


def measured(
    arm: synthetic.ArmDescription, truth: synthetic.GroundTruth, q: Array, seed: int, load: float = 0.0
) -> Measurements:
    """Measurements of a tracker at poses (N, n) with a load (kg)."""
    number = np.arange(1, len(q) + 1)
    tcp = synthetic.measure(arm, truth, q, load, NOISE, seed)
    return Measurements.of_tcp(poses_of(q, load), tcp, NOISE, pose=number)
