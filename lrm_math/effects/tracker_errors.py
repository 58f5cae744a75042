"""Errors of what measures, which move nothing of the arm: a tracker's frame and lens, the anchor of distances, the
places of touched points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import radians
from typing import ClassVar

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import (
    Amounts,
    Description,
    Effect,
    Excitation,
    Extrapolation,
    LinearEffect,
    ModelPart,
    Parameter,
    separately,
)
from lrm_math.effects.targets import FRAME, FRAME_PLACE, RADIAL
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos, sin

ANCHOR_TYPICAL = 0.1  # m: how well a point beside an arm is known without measuring it
FRAME_TYPICAL = 1e-3 / 3.0  # calibrated trackers are right to 1 mm in a metre
DIRECTIONS = tuple(radians(degrees) for degrees in range(-120, 121, 30))
"""rad: azimuths and elevations to begin with; they overlap, so that no direction lies at an end of the range."""
SYMMETRIC = ("xx", "yy", "zz", "xy yx", "xz zx", "yz zy")
"""Entries of a symmetric matrix: row and column."""
SCALES = (*(f"scale_{axis}" for axis in "xyz"), *(f"shear_{axes}" for axes in ("xy", "xz", "yz")))
QUADRATIC = tuple(map("".join, combinations_with_replacement("xyz", 2)))

MOST_PLACEMENTS = 48
SHIFT_TYPICAL, TURN_TYPICAL = 0.05, 0.2
"""m, rad: how near the arm as drawn comes to where a board stood, in the arm's frame."""
SHIFTS = tuple(f"{FRAME}{axis}" for axis in "xyz")


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
        claim=(
            "the tracker measures lengths {scale_x_mm_per_m:too long|too short} along x, "
            "{scale_y_mm_per_m:too long|too short} along y, {scale_z_mm_per_m:too long|too short} along z"
        ),
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


class DepthScale(Effect):
    """Scale of the tracker along one direction, mostly a camera's line of sight.

    Across that direction the tracker is right: this tells the arm's lengths, which `MeasurementFrame` leaves open.
    """

    id = "depth_scale"
    depends_on = ("session",)
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="The tracker's depth is wrong: a camera's focal length, its base line or the printed size of its target.",
        formula="x_seen = x + s (n · (x - centre of the measured points)) n, n = (ce ca, ce sa, se)",
        source="depth, the least certain direction of triangulation (Matthies & Shafer 1987)",
        claim=(
            "the tracker measures lengths {scale_mm_per_m:too long|too short} along the direction "
            "{azimuth_rad:towards y|away from y} and {elevation_rad:up|down} from x"
        ),
    )
    parameters = (
        _distortion("scale", "stretch along the direction"),
        Parameter("azimuth_rad", "azimuth of the direction from x about z", 1.0, fixed=0.0, scan=DIRECTIONS),
        Parameter("elevation_rad", "elevation of the direction over x and y", 1.0, fixed=0.0, scan=DIRECTIONS),
    )
    targets = MeasurementFrame.targets

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The frame of measurement."""
        return (FRAME_PLACE,)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The matrix s n nᵀ."""
        scale, azimuth, elevation = p
        n = (cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation))
        return tuple(scale * row * column for row in n for column in n)


class FrameCurve(LinearEffect):
    """A tracker's distortion of space: polynomial of the second degree and radial term of the third."""

    id = "frame_curve"
    variant_of = ("depth_scale", "measurement_frame")
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
        claim="the distances start {x_mm:along|against} x, {y_mm:along|against} y, {z_mm:along|against} z from "
        "the stated point",
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
        return None if "distance" in excitation.measured else "no distances (distance_mm) were measured"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The three directions."""
        return separately([(1.0,)] * 3)


class TouchedPoint(Effect):
    """Position of one touched point of which no distance to another is known."""

    id = "touched_point"
    depends_on = ("instrument", "placement")
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="Where the touched point stood is not known; it is identified together with the arm.",
        formula="x_seen = x + (x, y, z), at the poses that touched it",
        source="calibration by a point constraint: Meggiolaro, Scriffignano & Dubowsky 2000",
        claim="what was touched stood {x_mm:along|against} x, {y_mm:along|against} y, {z_mm:along|against} z from "
        "where the arm as drawn touches it",
        needs="touched points (columns point, placement)",
    )
    targets: ClassVar[tuple[str, ...]] = SHIFTS
    parameters: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"{axis}_mm", f"{axis} of what was touched", SHIFT_TYPICAL) for axis in "xyz"
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every placement, by its number in the order of the measurements."""
        return tuple(f"placement{number}" for number in range(1, MOST_PLACEMENTS + 1))

    @property
    def part(self) -> ModelPart:
        """The measurement."""
        return ModelPart.MEASUREMENT

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The shift at the poses of this placement, nothing at others."""
        here = self.here(poses)
        return tuple(amount * here for amount in p)

    def here(self, poses: Poses) -> Number:
        """(N,), one at the poses that touched at this placement, else zero."""
        if poses.placement is None:
            return 0.0
        at_placement: Number = (poses.placement == int(self.place.removeprefix("placement"))).astype(float)
        return at_placement


class TouchedBoard(TouchedPoint):
    """Position and attitude of several touched points whose distances are known."""

    id = "touched_board"
    about = Description(
        cause="Where the board with the touched points stood is not known; it is identified together with the arm.",
        formula="x_seen = Rx(alpha) Ry(beta) Rz(gamma) x + (x, y, z), at the poses that touched it",
        source="calibration by touched points of known distances: Ikits & Hollerbach 1997",
        claim="the board stood {x_mm:along|against} x, {y_mm:along|against} y, {z_mm:along|against} z from "
        "where the arm as drawn touches it",
        needs="touched points (columns point, placement) of known distances ([points] or [distances])",
    )
    targets: ClassVar[tuple[str, ...]] = (*SHIFTS, *(f"{FRAME}{row}{column}" for row in "xyz" for column in "xyz"))
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *TouchedPoint.parameters,
        *(
            Parameter(f"{name}_rad", f"turn of the board about {axis}", TURN_TYPICAL)
            for name, axis in zip(("alpha", "beta", "gamma"), "xyz", strict=True)
        ),
    )

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Shift, and rotation less identity, at the poses of this placement."""
        here = self.here(poses)
        (sa, ca), (sb, cb), (sc, cc) = ((sin(angle), cos(angle)) for angle in p[3:])
        rotation = (
            *(cb * cc, -cb * sc, sb),
            *(ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb),
            *(sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb),
        )
        less_identity = (value - (k % 4 == 0) for k, value in enumerate(rotation))
        return (*(amount * here for amount in p[:3]), *(amount * here for amount in less_identity))
