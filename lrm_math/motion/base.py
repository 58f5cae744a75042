"""The contract of an effect of motion: how it changes the way of one joint from its command to its reading.

A joint is a mass on the spring of its servo, in units of angle: with u the set-point, K the servo's stiffness, J the
inertia about the axis and ω² = K/J₀,

    (J/J₀) q̈ = ω² [s(u + push − q) + f] − (2ζω + ω² c) q̇        s: saturation, |f| ≤ friction, c: damping

Torques stand as the angle by which they deflect the servo (τ/K): command and encoder alone know no other unit.
An effect changes one or more terms; each method of this class is one of them and by default leaves it alone.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.place_names import joint_number
from lrm_math.arrays import Array
from lrm_math.effects.base import Description, Parameter
from lrm_math.effects.reference import EffectRef, ParameterRef
from lrm_math.kinematics.chain import Number

Values = Sequence[Array]
"""Values of an effect's parameters (SI), each (P, 1): P sets of them are simulated at once; or (P, S), by moves."""


@dataclass(frozen=True, eq=False)
class JointDrive:
    """What one joint is told and bears in S moves, at M steps of `h` s.

    Attributes:
        command: (M, S), commanded angle, constant over each step (rad).
        gravity, reaction: (M, S), torque of gravity, and that of the other joints' acceleration (N·m).
        inertia: (M, S), moment of inertia of the links about the axis (kg m²).
        reference: float or (S,), that in the middle of all joints' ranges, where J is J₀ (kg m²).
        start, speed: (S,), reading and its speed at the beginning (rad, rad/s).
    """

    h: float
    command: Array
    gravity: Array
    reaction: Array
    inertia: Array
    reference: float | Array
    start: Array
    speed: Array

    def take(self, rows: NDArray[np.bool_]) -> JointDrive:
        """Some of the moves; `rows`: (S,)."""
        command, gravity, reaction = self.command[:, rows], self.gravity[:, rows], self.reaction[:, rows]
        inertia, start, speed = self.inertia[:, rows], self.start[rows], self.speed[rows]
        return JointDrive(self.h, command, gravity, reaction, inertia, self.reference, start, speed)


@dataclass(frozen=True)
class MotionEffect(ABC):
    """A cause that shapes the motion of one joint, its `place`, of one `arm`."""

    arm: Arm
    place: str

    id: ClassVar[str]
    about: ClassVar[Description]
    parameters: ClassVar[tuple[Parameter, ...]]
    """`typical`: the usual size; `scan`: values that a fit starts from; no parameter is held.

    `fixed`: value in files that do not state the parameter, since they are older than it.
    """
    names_a_cause: ClassVar[bool] = True
    """Whether it is a cause; otherwise it is an empirical term, against which causes have to hold their own."""
    basic: ClassVar[bool] = False
    """Whether every joint has it from the start."""
    alike: ClassVar[str] = ""
    """Why no recording of command and encoder can show it; empty where one can."""

    @property
    def name(self) -> str:
        """`id@place`."""
        return str(EffectRef(self.id, self.place))

    @property
    def joint(self) -> int:
        """Number of the joint from 0."""
        return joint_number(self.place)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of its parameters in model files: `id.place.parameter`."""
        return tuple(str(ParameterRef(self.id, self.place, parameter.name)) for parameter in self.parameters)

    def set_point(self, u: Array, drive: JointDrive, p: Values) -> Array:
        """(M, P, S), set-point u (rad) as it leaves this effect."""
        return u

    def lead(self, p: Values) -> Number:
        """T (s), broadcast to (P, 1), by which the derivative of the set-point counts: a jump of it is a blow."""
        return 0.0

    def push(self, drive: JointDrive, p: Values) -> Number:
        """Torque over the servo's stiffness (rad), broadcast to (M, P, S)."""
        return 0.0

    def compliance(self, p: Values) -> Number:
        """1/K (rad/N·m), broadcast to (P, 1), by which the servo yields to the links' inertia: J₀ = K/ω²."""
        return 0.0

    def inertia(self, drive: JointDrive, p: Values) -> Number:
        """Change of J/J₀, broadcast to (M, P, S)."""
        return 0.0

    def damping(self, drive: JointDrive, p: Values) -> Number:
        """c (s), broadcast to (P, 1)."""
        return 0.0

    def friction(self, drive: JointDrive, p: Values) -> Number:
        """Largest friction at any speed (rad), broadcast to (M, P, S)."""
        return 0.0

    def friction_at(self, speed: Array, p: Values) -> Number:
        """Further friction at a speed (rad/s) of (P, S)."""
        return 0.0

    def saturation(self, p: Values) -> Array | None:
        """(P, 1), the largest deflection (rad) that the drive answers to; None: it answers to any."""
        return None

    def hung(self, p: Values) -> tuple[Array, Array, Array] | None:
        """ω² (1/s²), 2ζω (1/s) and inertia over J₀, (P, 1) each, of a mass on a spring behind the joint; it is read."""
        return None

    def reading(self, q: Array, drive: JointDrive, p: Values) -> Array:
        """(M + 1, P, S), angle q (rad) as it is read."""
        return q

    def angle(self, reading: Array, p: Values) -> Array:
        """Angle (rad) of a joint at rest from its reading, as far as that does not depend on what it did before."""
        return reading

    def missing_excitation(self, drive: JointDrive) -> str | None:
        """Why the effect is not identifiable from these moves, or None if it may be."""
        return self.alike or None
