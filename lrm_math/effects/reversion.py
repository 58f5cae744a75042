"""Reversion to the model without its empirical terms, beyond the range of a joint's angles that they were measured at.

A free form follows one covariate. Where its size within the measured range changes with the angle of another joint, it
stands for something else, and beyond the range of that joint it may have the other sign. As a Gaussian process goes
back to its mean away from the data (Rasmussen & Williams 2006, section 2.2), the model goes back there to what it
would be without the form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import exp, positive_part

CORRELATED = math.radians(25.0)
"""rad: angles of a joint that are so far apart have errors that tell something of each other, by half (a convention:
a quarter of a wave of what gears, teeth and poles do to the angle, three to five times a turn)."""


def correlation(apart: Number) -> Number:
    """Correlation of what happens at angles so far apart (rad, not negative): Matérn, 3/2, whose derivative is
    continuous (Rasmussen & Williams 2006, Eq 4.17)."""
    scaled = apart * (math.sqrt(3.0) / CORRELATED)
    return (1.0 + scaled) * exp(-scaled)


@dataclass(frozen=True)
class Reversion:
    """Empirical terms that vary with a joint's angle, and the model without them.

    Attributes:
        terms: names of the effects, `id@place`.
        ends: lowest and highest angle of each joint (rad) between which they hold; infinite where they always do.
        changes: what is added to parameters (SI), by their keys, where nothing of the terms holds.
    """

    terms: tuple[str, ...]
    ends: tuple[tuple[float, float], ...]
    changes: Mapping[str, float]

    def share(self, poses: Poses) -> Number:
        """How much of the terms holds: 1 between the ends, falling to 0 beyond; a float or (N,)."""
        left: Number = 1.0
        for joint, (lower, upper) in self.limiting.items():
            angle = poses.angle(joint)
            left = left * correlation(positive_part(angle - upper) + positive_part(lower - angle))
        return left

    @property
    def sentence(self) -> str:
        """Where the terms end, for a person."""
        ends = [
            f"{word} {math.degrees(end):.0f}° of joint {joint + 1}"
            for joint, pair in self.limiting.items()
            for word, end in zip(("Below", "Above"), pair, strict=True)
            if math.isfinite(end)
        ]
        names = ", ".join(self.terms)
        what = f"the model goes back to one without terms that hold only where they were measured: {names}"
        return f"{' and '.join(ends)} {what}."

    @cached_property
    def limiting(self) -> dict[int, tuple[float, float]]:
        """The ends of the joints, by number from 0, that have a finite one."""
        return {joint: ends for joint, ends in enumerate(self.ends) if any(map(math.isfinite, ends))}
