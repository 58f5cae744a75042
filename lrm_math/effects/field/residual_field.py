"""Residual field: a smooth function of the joint angles that is added to the TCP. It predicts and names no cause.

Gaussian-process regression of reduced rank (Solin & Särkkä 2020): the functions are cosines of the angles over the
range of the fit and products of up to three joints' cosines, eigenfunctions of the Laplacian on a box a quarter wider
with no slope at its walls. What is not a product of many joints (additive kernels, Duvenaud, Nickisch & Rasmussen 2011)
can be learned from hundreds of poses. Outside the range it fades to zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from math import pi, sqrt

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
    joint_number,
)
from lrm_math.effects.measured_range import MeasuredRange, fading
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos

MARGIN = 1.25
"""Half width of the box over half the width of the range."""
WAVES, JOINTS_TOGETHER = 2, 3
"""Cosines of one angle beside the constant; most joints of one product: on the real arm two do not suffice."""
BEYOND = tuple(f"{axis}_beyond_mm" for axis in "xyz")
"""Names of what the field may be, along each axis, where nothing was measured."""
TYPICAL = 1e-3
"""m: typical size of a coefficient."""


@lru_cache(maxsize=16)
def wave_numbers(joints: int) -> tuple[tuple[int, ...], ...]:
    """Half waves along every joint's range of each function, the constant first; 233 of six joints."""
    every = product(range(WAVES + 1), repeat=joints)
    return tuple(waves for waves in every if sum(wave > 0 for wave in waves) <= JOINTS_TOGETHER)


@dataclass(frozen=True)
class ResidualField(LinearEffect):
    """Displacement of the TCP in the base's axes, by cosines of the joint angles.

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
        """For each axis a coefficient of every function, named by its half waves, and what it may be beyond the data.

        The latter is zero; its standard error is the deviation of the field where nothing was measured.
        """
        return tuple(
            parameter
            for axis, beyond in zip("xyz", BEYOND, strict=True)
            for parameter in (
                *(
                    Parameter(f"{axis}{''.join(map(str, waves))}_mm", f"{axis}, half waves {waves}", TYPICAL)
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
        x, y, z = (
            [(f, 0.0, 0.0) for f in functions],
            [(0.0, f, 0.0) for f in functions],
            [(0.0, 0.0, f) for f in functions],
        )
        return (*x, *y, *z)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ c f along each axis; functions that no coefficient asks for are left out."""
        cosines, inside, each = self._cosines(poses), self.inside(poses), len(p) // 3
        out: list[Number] = [p[each * (axis + 1) - 1] * (1.0 - inside) for axis in range(3)]
        for axis, waves, value in self.terms(p):
            out[axis] = out[axis] + value * inside * _product(cosines, _factors(waves))
        return tuple(out)

    def terms(self, p: Sequence[float]) -> Iterator[tuple[int, tuple[int, ...], float]]:
        """Axis, wave numbers and coefficient (m) of every function that has one."""
        every, each = wave_numbers(self.arm.dof), len(p) // 3
        for axis in range(3):
            for waves, value in zip(every, p[axis * each : (axis + 1) * each - 1], strict=True):
                if value:
                    yield axis, waves, value

    def functions(self, poses: Poses) -> Amounts:
        """Each function at the poses, a float or (N,), as if it went on beyond the range; of unit mean square."""
        cosines = self._cosines(poses)
        return tuple([_product(cosines, _factors(waves)) for waves in wave_numbers(self.arm.dof)])

    def inside(self, poses: Poses) -> Number:
        """1 where all angles lie in the range, on the way to 0 beyond its edge."""
        out: Number = 1.0
        for joint, ends in enumerate(self.ends):
            out = out * fading(poses.angle(joint), *ends)
        return out

    def _cosines(self, poses: Poses) -> tuple[Amounts, ...]:
        """1, √2 cos φ and √2 cos 2φ of each joint; φ runs from 0 to π over the box."""
        out = []
        for joint, (lower, upper) in enumerate(self.ends):
            half = 0.5 * MARGIN * (upper - lower) or 1.0
            c = cos((poses.angle(joint) - 0.5 * (lower + upper) + half) * (pi / (2.0 * half)))
            out.append((1.0, sqrt(2.0) * c, sqrt(2.0) * (2.0 * c * c - 1.0)))
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
