"""A soft arm with small noise, and a smooth displacement of its TCP that no effect of the catalogue makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium

ARM = load_arm("lrm-lab")
NOISE, WIDEST, SOFTNESS = 3e-4, 1.2, 0.03
"""m per axis; rad, of every joint to either side; rad/N·m."""


def measured(seed: int, size: float, count: int = 260) -> Measurements:
    """Measurements at random poses, with a displacement of amplitude `size` (m)."""
    rng = np.random.default_rng(seed)
    poses = poses_of(rng.uniform(-WIDEST, WIDEST, (count, ARM.dof)))
    nothing = np.zeros((count, 3))
    plain = Study.of(Measurements.of_tcp(poses, nothing, NOISE, source=Source(arm=ARM)))
    springs = np.where([ParameterRef.parse(key).id == "compliance" for key in plain.model.keys], SOFTNESS, 0.0)
    tcp = solve_equilibrium(plain.model.with_values(springs), poses).tcp + displacement(poses.q, size)
    return replace(plain.data, source=Source(sha256=str(seed), arm=ARM)).with_tcp(
        tcp + rng.normal(0.0, NOISE, tcp.shape)
    )


def displacement(q: Array, size: float) -> Array:
    """(N, 3), of the height alone, by two joints' angles (N, n): m."""
    height = size * np.sin(2.0 * q[:, 3]) * np.cos(1.5 * q[:, 0])
    return np.stack([np.zeros_like(height), np.zeros_like(height), height], axis=1)
