"""Drift as a free function of time: warming in stages, and again in every session; the weather."""

from __future__ import annotations

from functools import cached_property
from math import log1p

import numpy as np

from lrm_math.arm.arm import BASE, Arm
from lrm_math.effects.base import Amounts, Description, Excitation, LinearEffect, Parameter, separately
from lrm_math.effects.curves import cubic_b_splines, spline_count
from lrm_math.effects.session_errors import Drift
from lrm_math.kinematics.poses import Poses

FAST_S, SPACING, LONGEST_S = 600.0, 0.35, 108000.0
"""Knots are as far apart as `SPACING` times `FAST_S` and the time passed; the last at `LONGEST_S`."""
_COUNT = spline_count(0.0, log1p(LONGEST_S / FAST_S), SPACING)
COURSES = {"on": "since the session began", "all": "since the start"}


class DriftCurve(LinearEffect):
    """Smooth function of the time since the session began and of the time since the start."""

    id = "drift_curve"
    variant_of = ("drift",)
    depends_on = ("time",)
    about = Description(
        cause="Servo, gears and structure warm up at different paces, again after a break, and follow the room.",
        formula="δ = f(time in session) + g(time), cubic splines of ln(1 + t / 600 s)",
        source="cubic B-splines, de Boor 1978, with knots that lie closer where warming is fast",
        claim="{place} drifts by a curve of its own",
        needs=Drift.about.needs,
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every place of the drift that it refines."""
        return Drift.places(arm)

    @property
    def targets(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilts."""
        return ("base.alpha", "base.beta") if self.place == BASE else (f"{self.place}.theta",)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One coefficient for each B-spline and angle."""
        return tuple(
            Parameter(f"{course}{i}{end}_rad", f"B-spline {i} of the time {meaning}", 0.01)
            for end in (("_alpha", "_beta") if self.place == BASE else ("",))
            for course, meaning in COURSES.items()
            for i in range(1, _COUNT + 1)
        )

    @property
    def curves(self) -> tuple[tuple[str, ...], ...]:
        """One for each time and angle."""
        names, count = [parameter.name for parameter in self.parameters], _COUNT
        return tuple(tuple(names[first : first + count]) for first in range(0, len(names), count))

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The B-splines of both times; those of a time that is not known, or the same as the other, are zero."""
        still, last = np.zeros(len(poses)), log1p(LONGEST_S / FAST_S)
        found: list[np.ndarray] = []
        for time in (poses.running, poses.t):
            known = time is not None and not (time is poses.t and poses.session is None and poses.running is not None)
            course = still if time is None else np.log1p(np.maximum(time, 0.0) / FAST_S)
            functions = cubic_b_splines(course, 0.0, last, SPACING)
            found += [np.asarray(f) if known else still for f in functions]
        return separately([tuple(found)] * len(self.targets))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Times must be known."""
        return "the data have no times (t_s)" if excitation.poses.t is None else None
