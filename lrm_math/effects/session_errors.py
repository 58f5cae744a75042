"""What belongs to the session of measurement: warm-up, power cycles, the tracker's frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import BASE, Arm
from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts, Effect, Evidence, Parameter
from lrm_math.kinematics.poses import Poses

MOST_SESSIONS = 6


@dataclass(frozen=True)
class Drift(Effect):
    """Warm-up of a servo, or of the base: fast at first, then settling."""

    id = "drift"
    cause = "Servos and plastic warm up while measuring; angles creep, fast at first, then settle."
    formula = "A (1 − exp(−t/T)), and c (temperature − first temperature) where measured"
    source = "first-order warm-up; 15 °C in ten minutes seen on RC servos"
    claim = "{place} drifts as it warms up"
    needs = "times (t_s); a pose order that does not run with one joint"
    online = False
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, and the base."""
        return (*arm.joint_names, BASE)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """For each angle its drift A and its slope c with temperature; the time constant T."""
        names = [slot.split(".")[1] for slot in self.moves] if self.place == BASE else [""]
        ends = [f"_{name}" if name else "" for name in names]
        return (
            *(Parameter(f"A{end}_rad", f"drift of {self.place}{end}", 0.01) for end in ends),
            *(Parameter(f"c{end}_rad_per_K", f"drift of {self.place}{end} with temperature", 0.001) for end in ends),
            Parameter("T_s", "time constant", 1800.0, 30.0, fixed=1800.0, scan=(300.0, 900.0, 1800.0, 3600.0, 9000.0)),
        )

    @property
    def moves(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilts."""
        return ("base.alpha", "base.beta") if self.place == BASE else (f"{self.place}.theta",)

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """A (1 − exp(−t/T)) + c (temperature − first temperature)."""
        warm, heat = self._shapes(poses, p[-1])
        n = len(self.moves)
        return tuple(p[i] * warm + p[n + i] * heat for i in range(n))

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """The two courses; T by difference."""
        warm, heat = self._shapes(poses, p[-1])
        n = len(self.moves)
        rows = [tuple(course if i == j else 0.0 for i in range(n)) for course in (warm, heat) for j in range(n)]
        return (*rows, super().d_parameters(poses, tau, p)[-1])

    def _shapes(self, poses: Poses, time_constant: float) -> tuple[Array, Array]:
        still = np.zeros(len(poses))
        warm = still if poses.t is None else 1.0 - np.exp(-poses.t / time_constant)
        heat = still if poses.temperature is None else poses.temperature - poses.temperature[:1]
        return warm, heat

    def why_not(self, evidence: Evidence) -> str | None:
        """It needs times or temperatures."""
        if evidence.poses.t is None and evidence.poses.temperature is None:
            return "the data have neither times (t_s) nor temperatures (temp_c)"
        return None


@dataclass(frozen=True)
class Session(Effect):
    """A joint, or the base, that stands a little differently after each time the power was off."""

    id = "session"
    cause = "After each power cycle servos find their zero, and clamps their place, a little differently."
    formula = "a constant for each session after the first"
    source = "one offset per session"
    claim = "{place} stands differently in each session"
    needs = "two or more sessions"
    online = False
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, and the base."""
        return (*arm.joint_names, BASE)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A step for sessions 2 to 6 and each angle."""
        names = [f"_{slot.split('.')[1]}" for slot in self.moves] if self.place == BASE else [""]
        return tuple(
            Parameter(f"step{session}{name}_rad", f"step of {self.place}{name} in session {session}", 0.01)
            for name in names
            for session in range(2, MOST_SESSIONS + 1)
        )

    @property
    def moves(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilts."""
        return ("base.alpha", "base.beta") if self.place == BASE else (f"{self.place}.theta",)

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The step of each pose's session, counted from the first in the data."""
        if poses.session is None:
            return (0.0,) * len(self.moves)
        number = np.searchsorted(np.unique(poses.session), poses.session)
        steps = np.reshape(p, (len(self.moves), MOST_SESSIONS - 1))
        table = np.concatenate([np.zeros((len(steps), 1)), steps], axis=1)
        return tuple(row[np.minimum(number, MOST_SESSIONS - 1)] for row in table)

    def why_not(self, evidence: Evidence) -> str | None:
        """It needs sessions."""
        sessions = evidence.poses.session
        return None if sessions is not None and len(np.unique(sessions)) > 1 else "all poses are of one session"


@dataclass(frozen=True)
class MeasurementFrame(Effect):
    """A tracker whose frame is stretched, sheared or turned against the base."""

    id = "measurement_frame"
    cause = "The tracker's calibration stretches or shears space, or its frame is turned against the base target."
    formula = "x_seen = x + (symmetric matrix of scale and shear + small rotation) x"
    source = "linear map of the tracker's frame"
    claim = "the tracker stretches x, y, z by {scale_x_mm_per_m}, {scale_y_mm_per_m}, {scale_z_mm_per_m}"
    online = False
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The frame of measurement."""
        return ("frame",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Three scales, three shears, three rotations."""
        return (
            *(Parameter(f"scale_{axis}_mm_per_m", f"stretch along {axis}", 0.005) for axis in "xyz"),
            *(Parameter(f"shear_{axes}_mm_per_m", f"shear between {axes}", 0.005) for axes in ("xy", "xz", "yz")),
            *(Parameter(f"turn_{axis}_rad", f"rotation about {axis}", 0.01) for axis in "xyz"),
        )

    def seen(self, tcp: Array, p: Sequence[float]) -> Array | None:
        """(scale and shear + rotation) x."""
        sx, sy, sz, xy, xz, yz, a, b, c = p
        matrix = np.array([[sx, xy - c, xz + b], [xy + c, sy, yz - a], [xz - b, yz + a, sz]])
        return np.asarray(tcp @ matrix.T)
