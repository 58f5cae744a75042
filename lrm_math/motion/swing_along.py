"""Swing of the links behind servos that turn: the inertia is that of each posture on the way.

The springs are those of `lrm_math.motion.modes`, whose modes hold in one posture. A move of 20° changes frequencies by
some per cent, and with them what a jolt half a second before the end leaves. With p = M_zz ż + M_zθ θ̇ the momentum of
the links, ṗ = −K z − D ż (Spong 1987; torques of the square of speeds are left out), by the symplectic Euler rule.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arrays import Array
from lrm_math.motion.modes import links_inertia, springs_of
from lrm_math.motion.motion_model import MotionModel

POSTURE_S = 0.05
"""s between postures of which the inertia is taken, in the mean of the ways."""


def swing_along(
    model: MotionModel, servos: Array, step: float, frequency_factors: Sequence[float], payload: float, length: int
) -> Array:
    """(M + 1, F, B, n), deflections of the joints (rad) by F factors of all natural frequencies; 0 where none swings.

    `servos`: (M + 1, B, n), rad, angles at steps (s) from rest on B ways that have arrived after `length` steps.
    `payload`: kg.
    """
    springs = springs_of(model)
    out = np.zeros((len(servos), len(frequency_factors), *servos.shape[1:]))
    if springs is None:
        return out
    soft, every = springs.joints, max(round(POSTURE_S / step), 1)
    postures = np.concatenate([servos[:length:every], servos[-1:]]).mean(axis=1, keepdims=True)
    M = links_inertia(model.arm, postures.reshape(-1, servos.shape[2]), payload)
    led = M[:, :, soft].reshape(*postures.shape, len(soft))  # (places, 1, n, k)
    inverse = np.linalg.inv(led[:, :, soft])
    factor = np.array(frequency_factors)[:, None, None]
    stiff, braked = step * factor**2 * springs.stiffness, step * factor * springs.damping
    z = np.zeros((len(frequency_factors), servos.shape[1], len(soft)))
    speed, turns = np.zeros_like(z), np.diff(servos, axis=0) / step
    before = np.zeros_like(servos[0])
    for k, turning in enumerate(turns):
        index = min(k // every, len(led) - 1) if k < length else -1
        pushed = ((before - turning)[:, None] @ led[index])[:, 0] - stiff * z - braked * speed
        speed = speed + (pushed[:, :, None] @ inverse[index])[:, :, 0]
        z, before = z + step * speed, turning
        out[k + 1][..., soft] = z
    return out
