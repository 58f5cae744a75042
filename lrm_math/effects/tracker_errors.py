"""Errors of what measures, which move nothing of the arm: a tracker's frame and lens, the anchor of distances."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import ClassVar

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
    separately,
)
from lrm_math.effects.targets import FRAME_PLACE, RADIAL
from lrm_math.kinematics.poses import Poses

ANCHOR_TYPICAL = 0.1  # m: how well a point beside an arm is known without measuring it
FRAME_TYPICAL = 1e-3 / 3.0  # calibrated trackers are right to 1 mm in a metre
SYMMETRIC = ("xx", "yy", "zz", "xy yx", "xz zx", "yz zy")
"""Entries of a symmetric matrix: row and column."""
SCALES = (*(f"scale_{axis}" for axis in "xyz"), *(f"shear_{axes}" for axes in ("xy", "xz", "yz")))
QUADRATIC = tuple(map("".join, combinations_with_replacement("xyz", 2)))


def _distortion(name: str, meaning: str) -> Parameter:
    """A distortion of space: trackers that are sold as such stay below 1 mm/m, a webcam below 10."""
    return Parameter(f"{name}_mm_per_m", meaning, FRAME_TYPICAL, usual=1e-3, largest=1e-2)


class MeasurementFrame(LinearEffect):
    """Scale and shear of the tracker's frame about the centre of what was measured; a rotation of it is the base's."""

    id = "measurement_frame"
    depends_on = ("session",)
    extrapolation = Extrapolation.PROPORTIONAL
    targets = tuple(f"frame.{row}{column}" for row in "xyz" for column in "xyz")
    about = Description(
        cause="The tracker's calibration stretches or shears space.",
        formula="x_seen = x + (symmetric matrix of scale and shear) (x - centre of the measured points)",
        source="linear map of the tracker's frame",
        claim="the tracker stretches x, y, z by {scale_x_mm_per_m}, {scale_y_mm_per_m}, {scale_z_mm_per_m}",
    )
    parameters = (
        *(_distortion(f"scale_{axis}", f"stretch along {axis}") for axis in "xyz"),
        *(_distortion(f"shear_{axes}", f"shear between {axes}") for axes in ("xy", "xz", "yz")),
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The frame of measurement."""
        return (FRAME_PLACE,)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The symmetric matrix of each parameter."""
        return tuple(_entries(words, self.targets) for words in SYMMETRIC)


class FrameCurve(LinearEffect):
    """A tracker's distortion of space: polynomial of the second degree and radial term of the third."""

    id = "frame_curve"
    variant_of = ("measurement_frame",)
    depends_on: ClassVar[tuple[str, ...]] = ("session",)
    about = Description(
        cause="A lens, a turntable or a scale of the tracker errs by where in space the target is.",
        formula="x_seen = x + S d + polynomial of the second degree in d + k |d|² d, S symmetric, d from the centre",
        source="polynomial distortion with a radial term: Brown 1971",
        claim="the tracker distorts space by a curve of the position",
        needs="positions spread over all of the space that the arm reaches",
    )
    parameters = (
        *(Parameter(f"{name}_mm_per_m", f"{name.replace('_', ' along ')}", 0.005) for name in SCALES),
        *(
            Parameter(f"{row}_{term}_mm_per_m2", f"{row} by {term[0]} times {term[1]}", 0.02)
            for row in "xyz"
            for term in QUADRATIC
        ),
        Parameter("radial_mm_per_m3", "all along the position, by its square", 0.05),
    )
    targets = tuple(f"frame.{row}{term}" for row in "xyz" for term in (*"xyz", *QUADRATIC, RADIAL))

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The frame of measurement."""
        return (FRAME_PLACE,)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The terms of each parameter."""
        curved = (f"{row}{term}" for row in "xyz" for term in QUADRATIC)
        radial = " ".join(f"{row}{RADIAL}" for row in "xyz")
        return tuple(_entries(words, self.targets) for words in (*SYMMETRIC, *curved, radial))


def _entries(words: str, targets: tuple[str, ...]) -> Amounts:
    """1 at the entries of some words, 0 at the others."""
    named = words.split()
    return tuple(float(target.partition(".")[2] in named) for target in targets)


class Anchor(LinearEffect):
    """Position of the point from which distances of the TCP are measured; it moves nothing of the arm."""

    id = "anchor"
    about = Description(
        cause="The fixed end of the string or ball bar is not where it was said to be, or was never measured.",
        formula="distance = |TCP - (stated point + x, y, z)|; without a stated point, x, y, z are its coordinates",
        source="telescoping ball bar: Goswami, Quaid & Peshkin 1993; single wire draw: Driels & Swayze 1994",
        claim="the distances start {x_mm}, {y_mm}, {z_mm} from the stated point",
        needs="distances from a fixed point (distance_mm)",
    )
    depends_on = ("instrument",)
    extrapolation = Extrapolation.PROPORTIONAL
    targets = ("anchor.x", "anchor.y", "anchor.z")
    parameters = tuple(
        Parameter(f"{axis}_mm", f"{axis} of the fixed end of the distances", ANCHOR_TYPICAL) for axis in "xyz"
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The measured distance."""
        return ("distance",)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Distances must have been measured."""
        return None if excitation.distance else "no distances (distance_mm) were measured"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The three directions."""
        return separately([(1.0,)] * 3)
