"""Modes in which an arm's links swing behind its servos, at a posture: frequencies, damping, and what drives them.

A joint with `swing` is a spring K between servo and link, damped by D. With z its deflections, θ the servos' angles and
M(q) the links' inertia (Siciliano et al. 2009, 7.2; Spong 1987):

    M_zz z̈ + D ż + K z = −M_zθ θ̈,    K φ = ω² M_zz φ,  φᵀ M_zz φ = 1,  2ζω = φᵀ D φ

K and D follow from frequency and damping ratio of `swing`, which stand for the mean of all postures: a stretched arm
swings more slowly than a folded one. Bodies are point masses with a radius of gyration of `GYRATION`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.kinematics.statics import weights
from lrm_math.motion.effects import Swing
from lrm_math.motion.motion_model import MotionModel

GYRATION = 0.03
"""m: of a body about its own centre; servo and bracket of hobby arms are 40 to 60 mm wide."""
POSTURES = 64
"""Over which the inertia is averaged."""


@dataclass(frozen=True, eq=False)
class Modes:
    """k modes of n joints.

    Attributes:
        omega: (k,), rad/s. damping: (k,), ratios. shape: (n, k), deflections of the joints for modal coordinates.
        driven: (k, n), modal coordinates of the servos' angles, whose acceleration drives the modes.
    """

    omega: Array
    damping: Array
    shape: Array
    driven: Array

    @property
    def frequency(self) -> Array:
        """(k,), Hz, of the damped swing."""
        return np.asarray(self.omega * np.sqrt(np.maximum(1.0 - self.damping**2, 0.0)) / (2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class SwingSprings:
    """SwingSprings of k joints (from 0) behind their servos.

    Attributes:
        stiffness: (k,), N·m/rad. damping: (k,), N·m·s/rad.
    """

    joints: list[int]
    stiffness: Array
    damping: Array


def springs_of(model: MotionModel) -> SwingSprings | None:
    """The springs that a model's `swing` stands for, at the mean inertia of all postures; None where none swings."""
    soft = [effect for effect in model.effects if isinstance(effect, Swing)]
    if not soft:
        return None
    joints = [effect.joint for effect in soft]
    omega = np.array([2.0 * np.pi * model.values[effect.keys[0]] for effect in soft])
    ratio = np.array([model.values[effect.keys[1]] for effect in soft])
    mean = np.diag(mean_inertia(model.arm))[joints]
    return SwingSprings(joints, omega**2 * mean, 2.0 * ratio * omega * mean)


def modes_at(model: MotionModel, q: Array, payload: float = 0.0) -> Modes | None:
    """The modes at a posture q (n,), rad, with a payload (kg); None where no joint swings."""
    springs = springs_of(model)
    if springs is None:
        return None
    joints = springs.joints
    led = links_inertia(model.arm, q[None], payload)[0][joints]
    root = np.linalg.inv(np.linalg.cholesky(led[:, joints]))
    squares, turned = np.linalg.eigh((root * springs.stiffness) @ root.T)
    phi = root.T @ turned
    frequencies = np.sqrt(np.maximum(squares, 0.0))
    braked = np.sum(phi**2 * springs.damping[:, None], axis=0)
    shape = np.zeros((len(q), len(joints)))
    shape[joints] = phi
    return Modes(frequencies, braked / (2.0 * frequencies), shape, phi.T @ led)


def mean_inertia(arm: Arm) -> Array:
    """(n, n), mean of the links' inertia over postures spread within the joints' limits (kg m²)."""
    lower, upper = (np.array(side) for side in (JointLimits.of(arm).lower, JointLimits.of(arm).upper))
    spread = np.random.default_rng(0).uniform(size=(POSTURES, arm.dof))
    return np.asarray(links_inertia(arm, lower + spread * (upper - lower)).mean(axis=0))


def links_inertia(arm: Arm, q: Array, payload: float = 0.0) -> Array:
    """(N, n, n), kg m², of the links about the joints at postures (N, n), rad, with a payload (kg)."""
    chain = chain_of(arm)
    bodies = weights(chain, payload)
    geometry = chain_geometry(chain, chain.values(list(q.T)), len(q), [body.com for body in bodies])
    out = np.zeros((len(q), arm.dof, arm.dof))
    slots = list(chain.joint_slots)
    axis, origin = (x[slots].transpose(2, 0, 1) for x in (geometry.axis, geometry.origin))
    for number, body in enumerate(bodies):
        moved = np.array([chain.moved[slot] <= number for slot in slots])[:, None]
        lever = np.cross(axis, geometry.body[number].T[:, None] - origin) * moved
        turned = GYRATION * axis * moved
        out += body.mass * (lever @ lever.transpose(0, 2, 1) + turned @ turned.transpose(0, 2, 1))
    return out
