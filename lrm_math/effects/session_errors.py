"""Errors that belong to one measurement session: thermal drift, power cycles, sudden displacements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import log1p
from typing import ClassVar

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm
from lrm_math.arm.place_names import place_words
from lrm_math.effects.base import (
    Amounts,
    Description,
    Effect,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
    separately,
)
from lrm_math.effects.curves import cubic_b_splines, spline_count
from lrm_math.effects.offsets import BASE_SHIFT, ZERO_TURN
from lrm_math.effects.reference import ParameterRef
from lrm_math.effects.targets import FRAME, FRAME_PLACE, SCALE
from lrm_math.kinematics.poses import Poses

MOST_SESSIONS = 6
MOMENTS = 24
"""Moments of a change that are tried first; the search goes on between the best and its neighbours."""
PLACE_WORDS = {BASE: "base or tracker", TOOL: "tool or target", FRAME_PLACE: "the scale of all lengths"}
"""Words of places where what is displaced may be another thing than the arm."""
RIGID = dict.fromkeys("xyz", "mm") | dict.fromkeys(("alpha", "beta", "gamma"), "rad")
"""All six motions of a place and the units of their parameters."""
TYPICAL = {"rad": 0.01, "mm": 0.003, "mm_per_m": 0.003}
"""Sizes of such errors (SI), by unit."""
DISPLACED = {"rad": ZERO_TURN, "mm": BASE_SHIFT}
"""Largest displacements (SI), by unit: hands put base, tracker, target or a servo's horn back anywhere, no assembly
limits how far."""
RESET = "reset_s_per_s"
SAME_S = 1e-6
"""s: times that differ by less are the same."""
FAST_S, SPACING, LONGEST_S = 600.0, 0.35, 108000.0
"""Knots are as far apart as `SPACING` times `FAST_S` and the time passed; the last at `LONGEST_S`."""
_COUNT = spline_count(0.0, log1p(LONGEST_S / FAST_S), SPACING)
COURSES = {"on": "since the session began", "all": "since the start"}


class _SessionError(Effect):
    """An error of one joint's angle, of where the base stands before the tracker, or the target on the tool, in one
    measurement session."""

    depends_on: ClassVar[tuple[str, ...]] = ("session",)
    extrapolation = Extrapolation.PROPORTIONAL
    motions: ClassVar[dict[str, str]] = RIGID
    """Motions of the base, or of the tool, as a whole and the units of their parameters: all six, since what is not the
    arm's, a table or a tracker that is pushed, a target that is put on again, moves by any of them."""

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, and the base."""
        return (*arm.joint_names, BASE)

    @property
    def targets(self) -> tuple[str, ...]:
        """The joint's angle, the motions of base or tool, or the scale of what is measured."""
        if self.place in (BASE, TOOL):
            return tuple(f"{self.place}.{name}" for name in self.motions)
        return (f"{FRAME}{SCALE}",) if self.place == FRAME_PLACE else (f"{self.place}.theta",)

    @property
    def place_in_words(self) -> str:
        """A base that is displaced as a whole looks like a tracker that is, a tool like the target on it."""
        return session_words(self.place)

    @property
    def _motions(self) -> tuple[tuple[str, str], ...]:
        """Suffix of the parameters of each target, and their unit: `_x`, `_alpha` … of base and tool, else nothing."""
        if self.place in (BASE, TOOL):
            return tuple((f"_{name}", unit) for name, unit in self.motions.items())
        return (("", "mm_per_m" if self.place == FRAME_PLACE else "rad"),)


class Drift(_SessionError):
    """Thermal drift of a servo, or of the base, or of what measures it: first-order warm-up."""

    id = "drift"
    depends_on = ("time",)
    about = Description(
        cause=(
            "Servos and plastic warm up while measuring; angles creep, fast at first, then settle. Base and tracker on "
            "their stands do so as a whole, and all lengths of an arm, or the scale of its tracker, grow."
        ),
        formula="A (1 − exp(−t/T)), t since start or power-on; c (temperature − first temperature) where measured",
        source="first-order warm-up; 15 °C in ten minutes seen on RC servos",
        claim="{place} drifts as it warms up",
        needs="times (t_s), or poses numbered as they were measured; in an order that follows no joint",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, the base, and the scale of all lengths."""
        return (*super().places(arm), FRAME_PLACE)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Drift A of each motion, slope c of each with temperature; the time constant T; when it begins."""
        ends = self._motions
        return (
            *(Parameter(f"A{end}_{unit}", f"drift of {self.place}{end}", TYPICAL[unit]) for end, unit in ends),
            *(
                Parameter(f"c{end}_{unit}_per_K", f"drift of {self.place}{end} with temperature", 0.1 * TYPICAL[unit])
                for end, unit in ends
            ),
            Parameter(
                "T_s", "time constant", 1800.0, 30.0, fixed=1800.0, scan=(60.0, 300.0, 900.0, 1800.0, 3600.0, 9000.0)
            ),
            Parameter(RESET, "share of the clock that each session resets", 1.0, 0.0, 1.0, fixed=0.0, scan=(0.0, 1.0)),
        )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """The time constant; of several sessions, whether it was cold again when each began."""
        once = poses.t is None or poses.running is None or np.ptp(poses.t - poses.running) < SAME_S
        return {name: scan for name, scan in super().shapes_to_try(poses).items() if not (once and name == RESET)}

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """A (1 − exp(−t/T)) + c (temperature − first temperature); t since the start, of joints since they got power,
        or since the session began."""
        n = len(self.targets)
        *_, constant, reset = p
        clock = poses.powered if poses.powered is not None and warms_with_the_arm(self) else poses.clock
        if clock is not None and poses.running is not None and reset:
            clock = (1.0 - reset) * clock + reset * poses.running
        warm = 0.0 if clock is None else 1.0 - np.exp(-clock / constant)
        heat = 0.0 if poses.warmed is None else poses.warmed
        return tuple(p[i] * warm + p[n + i] * heat for i in range(n))

    @property
    def reset_key(self) -> str:
        """Name of the shape that states whether it begins anew with each session, in model files."""
        return str(ParameterRef(self.id, self.place, RESET))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Times, temperatures or the order must be known."""
        if excitation.poses.clock is None and excitation.poses.temperature is None:
            return "the data have neither times (t_s) nor temperatures (temp_c), and no order of poses"
        return None


def warms_with_the_arm(effect: Effect) -> bool:
    """Whether it follows the time since the arm's power-on: a joint's drift, not that of the stands or the tracker."""
    return isinstance(effect, Drift) and effect.place not in (BASE, FRAME_PLACE)


class DriftCurve(_SessionError, LinearEffect):
    """Smooth function of the time since the session began and of the time since the start."""

    id = "drift_curve"
    variant_of = ("drift",)
    depends_on = ("time",)
    extrapolation = Extrapolation.HELD
    motions = {"alpha": "rad", "beta": "rad"}
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

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One coefficient for each B-spline and angle."""
        return tuple(
            Parameter(f"{course}{i}{end}_{unit}", f"B-spline {i} of the time {meaning}", TYPICAL[unit])
            for end, unit in self._motions
            for course, meaning in COURSES.items()
            for i in range(1, _COUNT + 1)
        )

    @property
    def curves(self) -> tuple[tuple[str, ...], ...]:
        """One for each time and angle."""
        names, count = [parameter.name for parameter in self.parameters], _COUNT
        return tuple(tuple(names[first : first + count]) for first in range(0, len(names), count))

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The B-splines of both times; those of a time that is not known, or the same as the other, are zero.

        Of the scale of all lengths they are less their values at the start, as the law is zero there: a constant part
        would be the scale of the whole session, which no pose distinguishes from longer links.
        """
        last = log1p(LONGEST_S / FAST_S)
        start = cubic_b_splines(0.0, 0.0, last, SPACING) if self.place == FRAME_PLACE else (0.0,) * _COUNT
        amounts: Amounts = ()
        for time in (poses.running, poses.t):
            if time is None or (time is poses.t and poses.session is None and poses.running is not None):
                amounts += (0.0,) * _COUNT
            else:
                splines = cubic_b_splines(np.log1p(np.maximum(time, 0.0) / FAST_S), 0.0, last, SPACING)
                amounts += tuple(spline - begin for spline, begin in zip(splines, start, strict=True))
        return separately([amounts] * len(self.targets))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Times must be known."""
        return "the data have no times (t_s)" if excitation.poses.t is None else None


class Session(_SessionError, LinearEffect):
    """Offset of a joint, of the base against the tracker, or of the target, that changes with each power cycle."""

    id = "session"
    about = Description(
        cause=(
            "After each power cycle servos find their zero, and clamps their place, a little differently; a base or a "
            "tracker that was pushed moves everything alike; a target that was put on again sits elsewhere on the tool."
        ),
        formula="a constant for each session after the first",
        source="one offset per session",
        claim="{place} stands differently in each session",
        needs="another session, with some of the same poses",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, the base, and the tool with the target on it."""
        return (*super().places(arm), TOOL)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A step for sessions 2 to 6 and each motion."""
        return tuple(
            _displacement(f"step{session}{name}", f"step of {self.place}{name} in session {session}", unit)
            for name, unit in self._motions
            for session in range(2, MOST_SESSIONS + 1)
        )

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """There must be two or more sessions."""
        sessions = excitation.poses.session
        return None if sessions is not None and len(np.unique(sessions)) > 1 else "all poses are of one session"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """One in the poses of the parameter's session, counted from the first in the data; the last holds the rest."""
        number, later = poses.power_cycle, range(1, MOST_SESSIONS)
        in_session = [
            0.0 if number is None else (np.minimum(number, MOST_SESSIONS - 1) == k).astype(float) for k in later
        ]
        return separately([tuple(in_session)] * len(self.targets))


def _displacement(symbol: str, meaning: str, unit: str) -> Parameter:
    """One motion of what was displaced as a whole."""
    return Parameter(f"{symbol}_{unit}", meaning, TYPICAL[unit], largest=DISPLACED[unit])


def session_words(place: str) -> str:
    """The place in words."""
    return PLACE_WORDS.get(place) or place_words(place)


class ChangePoint(_SessionError):
    """Sudden displacement of a joint, of base or tracker, or of tool or target, at an unknown moment: a level shift."""

    id = "change_point"
    depends_on = ("time",)
    extrapolation = Extrapolation.HELD
    about = Description(
        cause=(
            "A belt skips a tooth, a horn or a clamp slips; a base or a tracker is pushed; a reflector turns, or is "
            "put on again. What was measured before stands elsewhere than what was measured after."
        ),
        formula="a constant up to one pose, nothing after it",
        source="change point in the mean (Page 1955; Hinkley 1970), its moment searched by least squares",
        claim="{place} stood elsewhere up to {last_pose}",
        needs="numbered poses on both sides of the moment, in an order that follows no joint",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, the base, and the tool with the target on it."""
        return (*super().places(arm), TOOL)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Shift of each motion before it against after; the number of the last pose before."""
        return (
            *(
                _displacement(f"before{end}", f"{self.place}{end} before the shift minus after it", of)
                for end, of in self._motions
            ),
            Parameter("last_pose", "number of the last pose before it", 1.0, fixed=0.0),
        )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Moments with equally many poses between them."""
        number = np.unique(poses.names(np.arange(len(poses))))
        moments = np.linspace(0.0, len(number) - 1.0, MOMENTS + 2)[1:-1].astype(int)
        return {"last_pose": tuple(np.unique(number[moments]).astype(float).tolist())}

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Nothing after the moment, and where poses have no numbers: as the arm is now."""
        before = 0.0 if poses.number is None else (poses.number <= p[-1]).astype(float)
        return tuple(size * before for size in p[:-1])

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The order of the poses must be known."""
        return "the poses have no numbers" if excitation.poses.number is None else None


class SecondChangePoint(ChangePoint):
    """A second displacement of what was displaced once (binary segmentation: Scott and Knott 1974)."""

    id = "second_change_point"
    variant_of = ("change_point",)
