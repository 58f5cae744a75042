"""Residual field: a smooth function of the joint angles that is added to the TCP. It predicts and names no cause.

Gaussian-process regression of reduced rank (Solin & Särkkä 2020): the functions are cosines of the angles over the
range of the fit and products of up to three joints' cosines, eigenfunctions of the Laplacian on a box a quarter wider
with no slope at its walls. What is not a product of many joints (additive kernels, Duvenaud, Nickisch & Rasmussen 2011)
can be learned from hundreds of poses: functions of one angle have short waves too, as gears do. Outside the range it
fades to zero. Its axes turn with joint 1, as what bends and sags in the arm's plane does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from math import pi, sqrt

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.place_names import joint_number
from lrm_math.arrays import Array
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
)
from lrm_math.effects.measured_range import MeasuredRange, fading
from lrm_math.kinematics.chain import Number, chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos, sin

MARGIN = 1.25
"""Half width of the box over half the width of the range."""
WAVES, JOINTS_TOGETHER, WAVES_ALONE = 2, 3, 20
"""Cosines of each angle in a product, beside the constant; most joints of one product: on the real arm two do not
suffice; and cosines of one angle alone: the gears of the UR5 err by waves of 13 degrees, 16 half waves of its range."""
DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"
"""Of half waves in the names of coefficients."""
AXES = "uvw"
"""Names of its axes: the base's x and y turned with joint 1, and its z."""
BEYOND = tuple(f"{axis}_beyond_mm" for axis in AXES)
"""Names of what the field may be, along each axis, where nothing was measured."""
TYPICAL = 1e-3
"""m: typical size of a coefficient."""


@lru_cache(maxsize=16)
def wave_numbers(joints: int) -> tuple[tuple[int, ...], ...]:
    """Half waves along every joint's range of each function, the constant first; 233 of six joints, 341 with the short
    ones of one joint alone."""
    every = product(range(WAVES + 1), repeat=joints)
    together = (waves for waves in every if sum(wave > 0 for wave in waves) <= JOINTS_TOGETHER)
    short = range(WAVES + 1, WAVES_ALONE + 1)
    alone = (tuple(wave * (other == joint) for other in range(joints)) for joint in range(joints) for wave in short)
    return (*together, *alone)


@dataclass(frozen=True)
class ResidualField(LinearEffect):
    """Displacement of the TCP in axes that turn with joint 1 (the base's own at zero), by cosines of the joint angles.

    `within`: the range of the fit, which its functions are stated by; None: the joints' limits.
    """

    within: MeasuredRange | None = None

    id = "residual_field"
    names_a_cause = False
    keeps_basis = False
    depends_on = ("angle",)
    extrapolation = Extrapolation.FADING
    about = Description(
        cause="No cause: a smooth function of the joint angles that predicts what is left when all names are found.",
        formula="δx = Σ c Π √2 cos(m π (q − q0 + b)/2b), at most three joints in a product; zero beyond the data",
        source="reduced-rank Gaussian-process regression, Solin & Särkkä 2020",
        claim="what is left follows the joint angles; this names no cause",
        needs="some hundred poses spread over the joint angles",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The tool."""
        return ("tool",)

    @property
    def targets(self) -> tuple[str, ...]:
        """Translations of the whole arm, which move the TCP along the base's axes whatever its pose."""
        return ("base.x", "base.y", "base.z")

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """A coefficient of every function for each axis, named by its half waves, and what it may be beyond the data.

        The latter is zero; its standard error is the deviation of the field where nothing was measured.
        """
        return tuple(
            parameter
            for axis, beyond in zip(AXES, BEYOND, strict=True)
            for parameter in (
                *(
                    Parameter(f"{axis}{''.join(DIGITS[m] for m in waves)}_mm", f"{axis}, half waves {waves}", TYPICAL)
                    for waves in wave_numbers(self.arm.dof)
                ),
                Parameter(beyond, f"{axis} where nothing was measured", TYPICAL),
            )
        )

    def over(self, within: MeasuredRange | None) -> ResidualField:
        """The field over the range of its fit."""
        return replace(self, within=within)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Some joint must stand at three angles."""
        moved = (joint for joint in self.arm.joint_names if excitation.levels(joint_number(joint)) >= 3)
        return None if next(moved, None) else "no joint stands at three levels"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """Every function, within the range; one beyond it."""
        inside = self.inside(poses)
        functions = (*[f * inside for f in self.functions(poses)], 1.0 - inside)
        return tuple(tuple(part * f for part in axis) for axis in self.axes(poses) for f in functions)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ c f along each axis; functions that no coefficient asks for are left out."""
        inside, each, terms = self.inside(poses), len(p) // 3, tuple(self.terms(p))
        cosines = self._cosines(poses, max((max(waves) for _, waves, _ in terms), default=1))
        out: list[Number] = [p[each * (axis + 1) - 1] * (1.0 - inside) for axis in range(3)]
        for axis, waves, value in terms:
            out[axis] = out[axis] + value * inside * _product(cosines, _factors(waves))
        axes = self.axes(poses)
        return tuple([axes[0][i] * out[0] + axes[1][i] * out[1] + axes[2][i] * out[2] for i in range(3)])

    def axes(self, poses: Poses) -> tuple[Amounts, Amounts, Amounts]:
        """Axes of the field, in the world's: the base's, turned by joint 1's command about the last of them."""
        x, y, z = self.base.T.tolist()
        c, s = cos(poses.angle(0)), sin(poses.angle(0))
        turned = (
            [c * a + s * b for a, b in zip(x, y, strict=True)],
            [c * b - s * a for a, b in zip(x, y, strict=True)],
        )
        return tuple(turned[0]), tuple(turned[1]), tuple(z)

    def along_axes(self, poses: Poses, vectors: Array) -> Array:
        """(N, 3), components along its axes of vectors (N, 3) of the world."""
        parts = np.broadcast_arrays(*(part for axis in self.axes(poses) for part in axis), vectors[:, 0])[:-1]
        return np.asarray(np.einsum("ain,ni->na", np.reshape(parts, (3, 3, -1)), vectors))

    @cached_property
    def base(self) -> Array:
        """(3, 3), the nominal base's axes as columns, in the world's."""
        chain = chain_of(self.arm)
        return np.asarray(frames(chain, chain.values([0.0] * self.arm.dof), 1)[0, 0, :3, :3])

    def terms(self, p: Sequence[float]) -> Iterator[tuple[int, tuple[int, ...], float]]:
        """Axis, wave numbers and coefficient (m) of every function that has one."""
        every, each = wave_numbers(self.arm.dof), len(p) // 3
        for axis in range(3):
            for waves, value in zip(every, p[axis * each : (axis + 1) * each - 1], strict=True):
                if value:
                    yield axis, waves, value

    def functions(self, poses: Poses) -> Amounts:
        """Each function at the poses, a float or (N,), as if it went on beyond the range; of unit mean square."""
        cosines = self._cosines(poses, WAVES_ALONE)
        return tuple([_product(cosines, _factors(waves)) for waves in wave_numbers(self.arm.dof)])

    def inside(self, poses: Poses) -> Number:
        """1 where all angles lie in the range, on the way to 0 beyond its edge."""
        out: Number = 1.0
        for joint, ends in enumerate(self.ends):
            out = out * fading(poses.angle(joint), *ends)
        return out

    def _cosines(self, poses: Poses, most: int) -> tuple[Amounts, ...]:
        """1 and √2 cos mφ, m = 1 … `most`, of each joint; φ runs from 0 to π over the box (Chebyshev's recurrence)."""
        out = []
        for joint, (lower, upper) in enumerate(self.ends):
            half = 0.5 * MARGIN * (upper - lower) or 1.0
            c = cos((poses.angle(joint) - 0.5 * (lower + upper) + half) * (pi / (2.0 * half)))
            powers: list[Number] = [1.0, c]
            while len(powers) <= most:
                powers.append(2.0 * c * powers[-1] - powers[-2])
            out.append((1.0, *(sqrt(2.0) * power for power in powers[1:])))
        return tuple(out)

    @property
    def ends(self) -> tuple[tuple[float, float], ...]:
        """Range of every joint's command (rad)."""
        if self.within is None:
            return tuple((joint.lower, joint.upper) for joint in self.arm.joints)
        return self.within.angle


@lru_cache(maxsize=8192)
def _factors(waves: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Joints from 0 whose cosines a function holds, and which."""
    return tuple((joint, wave) for joint, wave in enumerate(waves) if wave)


def _product(cosines: Sequence[Amounts], factors: Sequence[tuple[int, int]]) -> Number:
    out: Number = 1.0
    for joint, wave in factors:
        out = out * cosines[joint][wave]
    return out
