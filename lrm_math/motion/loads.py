"""Torques and inertia that a trajectory puts on the joints, the bodies taken as point masses at their centres.

With c the centre of a body, a its acceleration and g gravity the torque of all bodies b beyond joint i about its axis
z through o is z · Σ (c − o) × m (g − a), and the moment of inertia Σ m |z × (c − o)|² (Siciliano et al. 2009, 7.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry


@dataclass(frozen=True, eq=False)
class JointLoads:
    """At frames of moves, (…, n) each: torque of gravity, of the other joints' acceleration (N·m), and moment of
    inertia of the links (kg m²)."""

    gravity: Array
    reaction: Array
    inertia: Array


def reference_inertia(arm: Arm) -> Array:
    """(n,), moments of inertia of the links in the middle of all joints' ranges (kg m²)."""
    middle = np.array(JointLimits.of(arm).middle)
    return np.asarray(joint_loads(arm, np.tile(middle, (1, 3, 1)), 1.0).inertia[0, 1])


def acceleration(x: Array, dt: float) -> Array:
    """(S, T, k), second derivative of x (S, T, k), T at least 3, by its steps of `dt` s; at its ends it is taken as 0.

    By five points (Abramowitz & Stegun 1972, 25.3.24): 0.5 % short at 4 Hz and 30 steps a second.
    """
    a, b, c, d, e = np.moveaxis(
        sliding_window_view(np.pad(x, ((0, 0), (2, 2), (0, 0)), mode="reflect", reflect_type="odd"), 5, axis=1), -1, 0
    )
    return np.asarray((16.0 * (b + d) - a - e - 30.0 * c) / (12.0 * dt * dt))


def joint_loads(arm: Arm, q: Array, dt: float) -> JointLoads:
    """Loads along trajectories q (S, T, n), rad, of frames `dt` s apart."""
    S, T, n = q.shape
    chain = chain_of(arm)
    geometry = chain_geometry(chain, chain.values(list(q.reshape(-1, n).T)), S * T)
    mass = np.array([body.mass for body in chain.bodies])
    centre = geometry.body.transpose(2, 0, 1)  # (N, B, 3)
    moving = acceleration(centre.reshape(S, T, -1), dt).reshape(centre.shape)
    turning = acceleration(q, dt).reshape(-1, n)
    out = np.zeros((3, S * T, n))
    for joint, slot in enumerate(chain.joint_slots):
        axis, origin = geometry.axis[slot].T[:, None], geometry.origin[slot].T[:, None]
        beyond = slice(chain.counted[slot], len(mass))
        lever = np.cross(axis, centre[:, beyond] - origin)
        m = mass[beyond, None]
        out[0, :, joint] = np.sum(m * lever * np.array(chain.gravity), axis=(1, 2))
        out[2, :, joint] = np.sum(m * lever**2, axis=(1, 2))
        accelerated = np.sum(m * lever * moving[:, beyond], axis=(1, 2))
        out[1, :, joint] = out[2, :, joint] * turning[:, joint] - accelerated
    gravity, reaction, inertia = out.reshape(3, S, T, n)
    return JointLoads(gravity, reaction, inertia)
