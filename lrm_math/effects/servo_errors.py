"""Errors between commanded and real joint angle: gain of a servo or of all, eccentricity, coupling, quantisation."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.place_names import joint_number, joints_of, place_words, turned_by
from lrm_math.arm.servo_table import PwmClock, rounding
from lrm_math.effects.base import (
    Amounts,
    AngleDependentEffect,
    Description,
    Effect,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
)
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos, negative_part, positive_part, sin

FEWEST_CYCLES, MOST_CYCLES, FEWEST_ANGLES = 3.0, 64.0, 12
"""Cycles a turn that are looked for, more than an off-centre gear has; angles below which waves look alike."""
LEVEL_DEG, OVERSAMPLED = 0.5, 3.0
"""Angles that differ by less are one; frequencies that are tried for each that the range resolves."""


class ServoGain(AngleDependentEffect, LinearEffect):
    """Gain error of a servo, one for each sign of the angle."""

    id = "servo_gain"
    about = Description(
        cause="The potentiometer in a servo is not exactly linear, and the servo's table was read from a protractor.",
        formula="δq = g+ q for q > 0, g− q for q < 0",
        source="piecewise linear table of Conenna 2024, section 3.4",
        claim=(
            "{place} turns {g_plus_rad_per_rad:too far|too little} above zero and "
            "{g_minus_rad_per_rad:too far|too little} below"
        ),
        needs="seven or more angles of the joint",
    )
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (
        Parameter("g_plus_rad_per_rad", "gain error for q > 0", 0.02),
        Parameter("g_minus_rad_per_rad", "gain error for q < 0", 0.02),
    )

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """q on the parameter's own side."""
        q = poses.angle(self.joint)
        return (positive_part(q),), (negative_part(q),)


class CommonGain(LinearEffect):
    """Gain error that all servos share: the clock of the board that makes their pulses."""

    id = "common_gain"
    depends_on = ("angle",)
    about = Description(
        cause=(
            "The oscillator of a servo board is off by some percent, and with it every pulse; or all servos were "
            "scaled by the same wrong factor."
        ),
        formula="δq_j = g q_j at every joint j; what a longer pulse adds at zero is in the offsets",
        source="PCA9685 data sheet: an internal oscillator of nominally 25 MHz",
        claim="every servo turns {g_rad_per_rad:too far|too little}",
    )
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (Parameter("g_rad_per_rad", "gain error of all servos", 0.02),)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """All servos together, of an arm with several."""
        return ("servos",) if arm.dof > 1 else ()

    @property
    def targets(self) -> tuple[str, ...]:
        """The angle of every joint."""
        return tuple(f"{joint}.theta" for joint in self.arm.joint_names)

    @property
    def place_in_words(self) -> str:
        """All servos."""
        return "every servo"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """q_j."""
        return (tuple(poses.angle(joint) for joint in range(self.arm.dof)),)


class Eccentricity(AngleDependentEffect, LinearEffect):
    """Eccentricity of gears or potentiometer: a periodic error with one and two periods a turn."""

    id = "eccentricity"
    about = Description(
        cause=(
            "A gear or potentiometer whose axis is off centre turns now too far, now too little, once or twice a turn."
        ),
        formula="δq = Σ a_n sin nq + b_n (cos nq − 1), n = 1, 2",
        source="Fourier series of a periodic error of the joint",
        claim=(
            "{place} turns unevenly: sine {a1_rad:|} and cosine {b1_rad:|} once a turn, "
            "sine {a2_rad:|} and cosine {b2_rad:|} twice"
        ),
        needs="seven or more angles of the joint",
    )
    extrapolation = Extrapolation.PERIODIC
    parameters = tuple(
        Parameter(f"{letter}{n}_rad", f"amplitude of {wave} {n}q", 0.02, usual=radians(3.0), largest=radians(10.0))
        for n in (1, 2)
        for letter, wave in (("a", "sin"), ("b", "cos"))
    )

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """sin nq and cos nq − 1; of 2q by those of q, which is exact near zero too."""
        q = poses.angle(self.joint)
        s, c = sin(q), cos(q)
        return (s,), (c - 1.0,), (2.0 * s * c,), (-2.0 * s * s,)


class TransmissionRipple(AngleDependentEffect):
    """Ripple of a gear: a wave of the joint's angle whose number of cycles a turn is found from the data."""

    id = "gear_ripple"
    about = Description(
        cause="Teeth that mesh, or a flexspline that is not round, add a wave that repeats many times a turn.",
        formula="δq = a sin nq + b (cos nq − 1), n cycles a turn: teeth, or twice the ratio of a harmonic drive",
        source="transmission error (Tuttle & Seering 1996); n by a periodogram (Lomb 1976, Scargle 1982)",
        claim="{place} ripples {n_per_turn} times a turn, by {a_rad:|} (sine) and {b_rad:|} (cosine)",
        needs="poses at many different angles of the joint",
    )
    extrapolation = Extrapolation.PERIODIC
    parameters = (
        Parameter("a_rad", "amplitude of the sine", 0.005, usual=radians(1.0), largest=radians(5.0)),
        Parameter("b_rad", "amplitude of the cosine", 0.005, usual=radians(1.0), largest=radians(5.0)),
        Parameter(
            "n_per_turn",
            "cycles a turn",
            10.0,
            FEWEST_CYCLES,
            MOST_CYCLES,
            fixed=10.0,
            scan=(FEWEST_CYCLES, MOST_CYCLES),
        ),
    )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Frequencies that the poses can tell: more than half a wave in the range, more than two levels in a wave."""
        angles = np.unique(np.round(np.degrees(poses.q[:, self.joint]) / LEVEL_DEG))
        span = LEVEL_DEG * float(np.ptp(angles))
        least = max(FEWEST_CYCLES, 180.0 / span if span else np.inf)
        most = min(MOST_CYCLES, 180.0 / (LEVEL_DEG * float(np.median(np.diff(angles))))) if span else 0.0
        count = int((most - least) * span / 360.0 * OVERSAMPLED) + 1
        return {"n_per_turn": tuple(np.linspace(least, most, count).tolist()) if most > least else (FEWEST_CYCLES,)}

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """a sin nq + b (cos nq − 1)."""
        turned = p[2] * poses.angle(self.joint)
        return (p[0] * sin(turned) + p[1] * (cos(turned) - 1.0),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The joint must be measured at many angles."""
        levels = excitation.levels(self.joint)
        return None if levels >= FEWEST_ANGLES else f"it was measured at {levels} angles only"


class CoupledJoints(Effect):
    """A turn of one joint's angle by another joint: the place is an ordered pair `jointN<-jointM`."""

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every ordered pair of joints: `jointN<-jointM`."""
        return ordered_pairs(arm)

    @property
    def targets(self) -> tuple[str, ...]:
        """The angle of the joint that is turned."""
        return (f"{joints_of(self.place)[0]}.theta",)

    @property
    def place_in_words(self) -> str:
        """`joint 3 follows joint 2`."""
        return " follows ".join(map(place_words, joints_of(self.place)))


class Coupling(CoupledJoints, LinearEffect):
    """Linear coupling of one joint's angle to another one's command."""

    id = "coupling"
    about = Description(
        cause="A cable or a shared mount lets the command of one joint turn another one a little.",
        formula="δq_N = c q_M",
        source="first order of any dependence between two joints",
        claim="{place} by {c_rad_per_rad:|in the opposite direction}",
    )

    depends_on = ("angle",)
    extrapolation = Extrapolation.PROPORTIONAL

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficient c."""
        return (Parameter("c_rad_per_rad", f"turn of {' for each rad of '.join(joints_of(self.place))}", 0.02),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The other joint must move."""
        _, other = coupled_joints(self.place)
        return None if excitation.levels(other) >= 2 else f"joint {other + 1} never moves"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """q_M."""
        return ((poses.angle(coupled_joints(self.place)[1]),),)


class Quantisation(Effect):
    """Quantisation of the servo pulses to whole counts of the chip. Known, not fitted."""

    id = "quantisation"
    about = Description(
        cause="The servo board can only make pulses of whole counts, about half a degree each at 50 Hz.",
        formula="δq = angle of the rounded pulse − q",
        source="PCA9685 data sheet, section 7.3.5; lrm_math.arm.servo_table",
        needs="the PWM frequency",
    )
    depends_on = ("counts",)
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (
        Parameter("pwm_Hz", "PWM frequency", 50.0, lower=24.0, fixed=50.0),
        Parameter("oscillator_Hz", "oscillator of the board", 25e6, lower=20e6, fixed=25e6),
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The arm, if every joint has a servo table."""
        return ("arm",) if all(joint.servo for joint in arm.joints) else ()

    @property
    def targets(self) -> tuple[str, ...]:
        """All joint angles."""
        return tuple(f"{joint}.theta" for joint in self.arm.joint_names)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The rounding error of every joint."""
        clock = PwmClock(p[0], p[1])
        return tuple(
            rounding(joint.servo, clock, poses.angle(i)) if joint.servo else 0.0
            for i, joint in enumerate(self.arm.joints)
        )


def ordered_pairs(arm: Arm) -> tuple[str, ...]:
    """Every ordered pair of joints: `jointN<-jointM`."""
    return tuple(turned_by(to, by) for to in arm.joint_names for by in arm.joint_names if to != by)


def coupled_joints(place: str) -> tuple[int, int]:
    """Numbers from 0 of the joint that is turned and of the one that turns it, of `jointN<-jointM`."""
    to, by = joints_of(place)
    return joint_number(to), joint_number(by)
