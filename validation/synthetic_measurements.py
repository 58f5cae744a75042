"""Measurements of the independent generator's arms, with noise."""

from __future__ import annotations

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from validation import synthetic

NOISE = 3e-4
"""m per axis."""


def measured(
    arm: synthetic.ArmDescription,
    truth: synthetic.GroundTruth,
    q: Array,
    seed: int,
    load: float = 0.0,
    noise: float = NOISE,
) -> Measurements:
    """Measurements of a tracker at poses (N, n) with a load (kg)."""
    return Measurements.of_tcp(poses_of(q, load), synthetic.measure(arm, truth, q, load, noise, seed), noise)
