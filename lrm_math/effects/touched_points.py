"""Where touched points stood: rigid motions of what was touched, which move nothing of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import Amounts, Description, Effect, Extrapolation, ModelPart, Parameter
from lrm_math.effects.targets import FRAME
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos, sin

MOST_PLACEMENTS = 48
SHIFT_TYPICAL, TURN_TYPICAL = 0.05, 0.2
"""m, rad: how near the arm as drawn comes to where a board stood, in the arm's frame."""
AXES = "xyz"
SHIFTS = tuple(f"{FRAME}{axis}" for axis in AXES)


class TouchedPoint(Effect):
    """Position of one touched point of which no distance to another is known."""

    id = "touched_point"
    depends_on: ClassVar[tuple[str, ...]] = ("instrument", "placement")
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="Where the touched point stood is not known; it is identified together with the arm.",
        formula="x_seen = x + (x, y, z), at the poses that touched it",
        source="calibration by a point constraint: Meggiolaro, Scriffignano & Dubowsky 2000",
        claim="what was touched stood {x_mm}, {y_mm}, {z_mm} from where the arm as drawn touches it",
        needs="touched points (columns point, placement)",
    )
    targets: ClassVar[tuple[str, ...]] = SHIFTS
    parameters: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"{axis}_mm", f"{axis} of what was touched", SHIFT_TYPICAL) for axis in AXES
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every placement, by its number in the order of the measurements."""
        return tuple(f"placement{number}" for number in range(1, MOST_PLACEMENTS + 1))

    @property
    def part(self) -> ModelPart:
        """Of the measurement."""
        return ModelPart.MEASUREMENT

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The shift at the poses of this placement, nothing at others."""
        here = self.here(poses)
        return tuple(amount * here for amount in p)

    def here(self, poses: Poses) -> Number:
        """(N,), one at the poses that touched at this placement, else zero."""
        if poses.placement is None:
            return 0.0
        found: Number = (poses.placement == int(self.place.removeprefix("placement"))).astype(float)
        return found


class TouchedBoard(TouchedPoint):
    """Position and attitude of several touched points whose distances are known."""

    id = "touched_board"
    about = Description(
        cause="Where the board with the touched points stood is not known; it is identified together with the arm.",
        formula="x_seen = Rx(alpha) Ry(beta) Rz(gamma) x + (x, y, z), at the poses that touched it",
        source="calibration by touched points of known distances: Ikits & Hollerbach 1997",
        claim="the board stood {x_mm}, {y_mm}, {z_mm} from where the arm as drawn touches it",
        needs="touched points (columns point, placement) of known distances ([points] or [distances])",
    )
    targets: ClassVar[tuple[str, ...]] = (*SHIFTS, *(f"{FRAME}{row}{column}" for row in AXES for column in AXES))
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *TouchedPoint.parameters,
        *(
            Parameter(f"{name}_rad", f"turn of the board about {axis}", TURN_TYPICAL)
            for name, axis in zip(("alpha", "beta", "gamma"), AXES, strict=True)
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
