"""Swing of the simulated arm: its links are masses on springs behind the servos, coupled with each other.

With θ the servos' angles, z the deflections of the springs and M(q) the links' inertia (point masses, and `GYRATION` of
each body about itself), the momentum of the links p = M_zz ż + M_zθ θ̇ changes by −K z − D ż − friction. Friction is an
impulse that stops a joint or as much of it as there is, more from a standstill: the joint sticks and slips.
Spong 1987 for the springs. It shares no code with the model of motion that is compared with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import Chain
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.kinematics.statics import weights
from lrm_math.model.model import Model

STEP = 0.001
"""s, the longest step of integration."""
GYRATION = 0.04
"""m: radius of gyration of a body about its own centre."""
STICTION, STICTION_SPEED = 1.5, 0.05
"""Friction from a standstill over that in motion, and speed (rad/s) at which the rest of it fades."""
STILL_SPEED, STILL = 1e-5, 1e-6
"""rad/s and rad below which a link has come to rest."""


@dataclass(frozen=True)
class JointSpring:
    """Spring between a servo and its link: stiffness (N·m/rad), damping (N·m·s/rad), dry friction of the link (N·m)."""

    stiffness: float
    damping: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        if not (0.1 <= self.stiffness <= 1e5 and 0.0 <= self.damping <= 1e3 and 0.0 <= self.friction <= 1e3):
            right = "stiffness 0.1 to 100000 N m/rad, damping 0 to 1000 N m s/rad, friction 0 to 1000 N m"
            raise LrmError(f"spring of a joint: should have {right}")

    @staticmethod
    def parse(text: str) -> JointSpring:
        """`STIFFNESS:DAMPING[:FRICTION]`. Raises `LrmError`."""
        try:
            numbers = [float(word) for word in text.split(":")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise LrmError(f"spring '{text}': should be STIFFNESS:DAMPING or STIFFNESS:DAMPING:FRICTION, in N m")
        return JointSpring(*numbers)


class SwingingLinks:
    """Deflection of every joint's spring (rad) as `deflection`, (n,); joints without a spring are rigid."""

    def __init__(self, truth: Model, springs: Mapping[str, JointSpring]) -> None:
        """`springs`: by joint. Raises `UnknownName`."""
        names = truth.arm.joint_names
        for name in springs:
            if name not in names:
                raise UnknownName(f"joint of {truth.arm.name}", name, names)
        self._soft = np.array([i for i, name in enumerate(names) if name in springs], dtype=np.int64)
        chosen = [springs[names[i]] for i in self._soft]
        self._stiffness, self._damping, self._friction = (
            np.array([getattr(spring, field) for spring in chosen]) for field in ("stiffness", "damping", "friction")
        )
        self._z: Array = np.zeros(len(chosen))
        self._speed: Array = np.zeros(len(chosen))
        self._turning = np.zeros(len(names))
        self._own: Array = np.eye(len(chosen))
        self._inverse: Array = np.eye(len(chosen))
        self._led = np.zeros((len(chosen), len(names)))

    @property
    def deflection(self) -> Array:
        """(n,), rad."""
        out = np.zeros(len(self._turning))
        out[self._soft] = self._z
        return out

    @property
    def still(self) -> bool:
        """Whether nothing swings: what is left of the deflection is held by friction."""
        held = np.abs(self._stiffness * self._z) <= STICTION * self._friction + self._stiffness * STILL
        return bool(np.all(np.abs(self._speed) < STILL_SPEED) and np.all(held) and not self._turning.any())

    def weigh(self, chain: Chain, q: Array, payload: float) -> None:
        """Takes the inertia of a chain's links at a posture q (n,), rad, with a payload (kg); the speeds stay."""
        M = inertia(chain, q, payload)
        self._led = M[self._soft]
        self._own = self._led[:, self._soft]
        self._inverse = np.asarray(np.linalg.inv(self._own))

    def follow(self, before: Array, after: Array, dt: float) -> None:
        """The servos turn evenly from angles to angles (n,), rad, within dt (s)."""
        turning = (after - before) / dt
        momentum: Array = self._own @ self._speed + self._led @ self._turning
        self._turning = turning
        steps = max(1, math.ceil(dt / STEP - 1e-9))
        h = dt / steps
        for _ in range(steps):
            momentum = momentum - h * (self._stiffness * self._z + self._damping * self._speed)
            self._speed = self._inverse @ (momentum - self._led @ turning)
            if self._friction.any():
                momentum = momentum - self._rubbed(h)
                self._speed = self._inverse @ (momentum - self._led @ turning)
            self._z = self._z + h * self._speed

    def _rubbed(self, h: float) -> Array:
        """(k,), impulse of friction in a step (N·m·s), against each link's own motion."""
        link = self._speed + self._turning[self._soft]
        more = 1.0 + (STICTION - 1.0) * np.exp(-((link / STICTION_SPEED) ** 2))
        most = self._friction * more * h
        return np.clip(np.diag(self._own) * link, -most, most)


def inertia(chain: Chain, q: Array, payload: float) -> Array:
    """(n, n), kg m², of a chain's joints at a posture (n,), rad: the bodies beyond both of two joints."""
    bodies, values = weights(chain, payload), chain.values([np.array([angle]) for angle in q.tolist()])
    geometry = chain_geometry(chain, values, 1, [body.com for body in bodies])
    slots = list(chain.joint_slots)
    axis, origin = geometry.axis[slots, :, 0], geometry.origin[slots, :, 0]
    M = np.zeros((len(q), len(q)))
    for number, body in enumerate(bodies):
        beyond = np.array([chain.moved[slot] <= number for slot in slots])
        levers = np.cross(axis, geometry.body[number, :, 0] - origin) * beyond[:, None]
        turned = axis * beyond[:, None]
        M += body.mass * (levers @ levers.T + GYRATION**2 * turned @ turned.T)
    return M
