"""Causes that the tool names, with the names that are right: in its own form (`play` to `leaning`), or in another."""

from __future__ import annotations

import math

from validation.hidden_effects.case import DEG, MINUTE_S, MM, NAMED, Case, RandomSizes, hidden
from validation.synthetic import (
    AxialFloat,
    BaseRocking,
    BaseWarmUp,
    CablePull,
    CoupledJoint,
    DahlLoop,
    EccentricShaft,
    FormulaJoint,
    FrictionLag,
    HardeningSpring,
    HardStop,
    HiddenEffect,
    HingedLink,
    JointSlip,
    LiftingBase,
    LinkBending,
    OneSidedGain,
    RadialFloat,
    SessionStep,
    SharedCable,
    SkewTracker,
    SoftPlay,
    StickSlip,
    TiltingBearing,
    ToothRipple,
    TwoStageWarmUp,
    WarmUp,
    WrongBody,
)
from validation.synthetic.hidden_memory import ViscoelasticJoint

NONE = (0.0, 0.0, 0.0)


def play(joint: int, width_deg: float, softness_nm: float) -> Case:
    name, right = f"play{joint}", f"backlash@joint{joint}"
    return hidden(NAMED, name, right, lambda by: SoftPlay(joint, by.size(width_deg * DEG), softness_nm))


def lag(joint: int, width_deg: float) -> Case:
    right = f"hysteresis@joint{joint}"
    return hidden(NAMED, f"lag{joint}", right, lambda by: FrictionLag(joint, by.size(width_deg * DEG), 2.0 * DEG))


def gain(joint: int, side: int, size: float) -> Case:
    """A gain on one side of a joint."""
    name, right = f"gain{joint}", f"servo_gain@joint{joint}"
    return hidden(NAMED, name, right, lambda by: OneSidedGain(joint, side, by.sign() * by.size(size), 6.0 * DEG))


def shaft(joint: int, offset: float) -> Case:
    """An eccentric shaft in a joint."""
    name, right = f"shaft{joint}", f"eccentricity@joint{joint}"
    return hidden(NAMED, name, right, lambda by: EccentricShaft(joint, by.size(offset), by.angle()))


def spring(joint: int, size_rad: float, scale_nm: float) -> Case:
    """A joint that hardens; size / scale stays below the least compliance that Truth.random draws."""
    name, right = f"spring{joint}", f"nonlinear_stiffness@joint{joint}"
    return hidden(NAMED, name, right, lambda by: HardeningSpring(joint, by.size(size_rad), scale_nm))


def cable(joint: int, slack_deg: float, stiffness_nm_per_rad: float) -> Case:
    """A cable that pulls a joint back."""
    name, right = f"cable{joint}", f"cable_spring@joint{joint}"
    return hidden(
        NAMED, name, right, lambda by: CablePull(joint, 1, slack_deg * DEG, by.size(stiffness_nm_per_rad), 4.0)
    )


def coupled(joint: int, by_joint: int, ratio: float) -> Case:
    name, right = f"coupled{joint}-{by_joint}", f"coupling@joint{joint}<-joint{by_joint}"
    return hidden(NAMED, name, right, lambda by: CoupledJoint(joint, by_joint, by.sign() * by.size(ratio), 1.5))


def bending(link: int, length_m: float, first_nm2: float, second_nm2: float) -> Case:
    """A link that bends, differently about its two axes."""
    name, right = f"bending{link}", f"lateral_compliance@link{link}"
    return hidden(NAMED, name, right, lambda by: LinkBending(link, length_m, (by.size(first_nm2), by.size(second_nm2))))


def bracket(link: int, aside_mm: float) -> Case:
    """A link with something heavy screwed to its side."""

    def make(by: RandomSizes) -> HiddenEffect:
        return WrongBody(f"link {link}", by.size(0.35), (by.sign() * by.size(aside_mm * MM), 0.0, 0.0))

    return hidden(NAMED, f"bracket{link}", f"mass@link{link}", make)


def base_roll(by: RandomSizes) -> HiddenEffect:
    """About x of the base as it is mounted, before its other turns."""
    (_, beta, _) = by.arm.base.angles_rad
    return BaseRocking(by.size(0.012), (math.cos(beta), 0.0, math.sin(beta)))


def base_warms(by: RandomSizes) -> HiddenEffect:
    """A base that drifts about the axis about which it also bends."""
    return BaseWarmUp((0.0, by.sign() * by.size(0.5 * DEG), 0.0), (8.0 * MINUTE_S, by.size(35.0 * MINUTE_S)))


def warms(joint: int, final_deg: float) -> Case:
    def make(by: RandomSizes) -> HiddenEffect:
        return WarmUp(joint, by.sign() * by.size(final_deg * DEG), by.size(30.0 * MINUTE_S))

    return hidden(NAMED, f"warm{joint}", f"drift@joint{joint}", make)


def slip(joint: int, size_deg: float) -> Case:
    """A joint that slips once, while it is measured."""

    def make(by: RandomSizes) -> HiddenEffect:
        return JointSlip(joint, by.sign() * by.size(size_deg * DEG), by.size(14.0 * MINUTE_S))

    return hidden(NAMED, f"slip{joint}", f"change_point@joint{joint}", make)


def restart(joint: int, sessions: int, step_deg: float) -> Case:
    """A joint that stands elsewhere after each power-on."""

    def make(by: RandomSizes) -> HiddenEffect:
        steps = [by.sign() * by.size(step_deg * DEG) for _ in range(sessions - 1)]
        return SessionStep(joint, (0.0, *steps))

    return hidden(NAMED, f"restart{joint}", f"session@joint{joint}", make, sessions)


def stretched(by: RandomSizes) -> HiddenEffect:
    """A tracker whose axes have unequal units."""
    stretch = (by.size(0.006), -by.size(0.004), by.size(0.003))
    return SkewTracker((by.sign() * 0.01, 0.004, -0.006), stretch, NONE)


def leaning(by: RandomSizes) -> HiddenEffect:
    """A tracker whose axes are not at right angles."""
    lean = (by.sign() * by.size(0.006), by.sign() * by.size(0.004), by.sign() * by.size(0.005))
    return SkewTracker((0.003, -0.01, 0.005), (0.003, 0.003, 0.003), lean)


def unequal_play(part: str, joint: int, wide_deg: float) -> Case:
    """Backlash with a wide and a narrow side."""

    def make(by: RandomSizes) -> HiddenEffect:
        up, down = by.size(wide_deg * DEG), by.size(0.25 * wide_deg * DEG)
        return FormulaJoint(joint, 1.0, f"np.where(tau > 0.0, {up}, {down}) * np.tanh(tau / 0.03)")

    return hidden(part, f"unequal-play{joint}", f"backlash@joint{joint}", make)


def hinged(part: str, link: int, behind_mm: float, compliance: float) -> Case:
    """A link that gives way at one place, its near or its far end, where it meets the next one."""

    def make(by: RandomSizes) -> HiddenEffect:
        return HingedLink(link, behind_mm * MM, (by.size(compliance), by.size(0.5 * compliance)))

    where, other = ("near", link - 1) if behind_mm else ("far", link + 1)
    right = f"lateral_compliance@link{link} lateral_compliance@link{other}"
    return hidden(part, f"bends-at-{where}-end{link}", right, make)


def tilting_bearing(part: str, link: int, tilt_deg: float) -> Case:
    """A bearing with clearance at the far end of a link."""
    right = f"lateral_compliance@link{link} lateral_compliance@link{link + 1}"
    return hidden(part, f"bearing{link + 1}", right, lambda by: TiltingBearing(link, by.size(tilt_deg * DEG), 0.15))


def stick_slip(part: str, joint: int, degrees: float) -> Case:
    """Friction that sticks, slips, and grows with the load."""

    def make(by: RandomSizes) -> HiddenEffect:
        return StickSlip(joint, 2.0 * degrees * DEG, by.size(degrees * DEG), 0.8)

    return hidden(part, f"stick-slip{joint}", f"hysteresis@joint{joint}", make)


def dahl_loop(part: str, joint: int, degrees: float) -> Case:
    """Friction with a long memory."""
    right = f"hysteresis@joint{joint}"
    return hidden(part, f"dahl{joint}", right, lambda by: DahlLoop(joint, by.size(degrees * DEG), 20.0 * DEG))


def creeps(part: str, joint: int, compliance: float) -> Case:
    """A joint that follows its torque with a memory of a minute."""
    right = f"creep@joint{joint}"
    return hidden(part, f"creep{joint}", right, lambda by: ViscoelasticJoint(joint, by.size(compliance), (60.0,)))


def stops(part: str, joint: int, side: int, at_deg: float) -> Case:
    """A joint that meets a stop."""

    def make(by: RandomSizes) -> HiddenEffect:
        return HardStop(joint, side, at_deg * DEG, 1.0 - by.size(0.08), 3.0 * DEG)

    return hidden(part, f"stop{joint}", f"servo_gain@joint{joint} cable_spring@joint{joint}", make)


def gear_ripple(part: str, joint: int, waves: int, degrees: float) -> Case:
    """A gear whose error repeats several times per turn."""
    right = f"gear_ripple@joint{joint} eccentricity@joint{joint}"
    return hidden(part, f"gear{joint}", right, lambda by: ToothRipple(joint, waves, by.size(degrees * DEG), by.angle()))


def shared_cable(part: str, a: int, b: int, stiffness: float) -> Case:
    """A cable over two joints."""
    right = f"cable_spring@joint{a} cable_spring@joint{b} coupling@joint{a}<-joint{b} coupling@joint{b}<-joint{a}"
    return hidden(part, f"cable-over-{a}-and-{b}", right, lambda by: SharedCable((a, b), -0.5, by.size(stiffness)))


def warms_in_two_stages(part: str, joint: int, degrees: float) -> Case:
    """A joint that warms up with two time constants, in two sessions."""

    def make(by: RandomSizes) -> HiddenEffect:
        return TwoStageWarmUp(joint, (by.size(degrees * DEG), by.size(degrees * DEG)), (300.0, 2700.0))

    return hidden(part, f"warms-in-two-stages{joint}", f"drift@joint{joint}", make, sessions=2)


def weather(part: str, joint: int, degrees: float) -> Case:
    """A joint that follows the room's temperature, which swings in 90 minutes, with a first-order lag of 20."""
    turn = 2.0 * math.pi / 5400.0
    delay = math.atan(turn * 1200.0)

    def make(by: RandomSizes) -> HiddenEffect:
        size = by.sign() * by.size(degrees * DEG) * math.cos(delay)
        return FormulaJoint(joint, size, f"np.sin({turn} * time_s - {delay})")

    return hidden(part, f"weather{joint}", f"drift@joint{joint}", make)


def axial_float(part: str, link: int, size_mm: float) -> Case:
    """A joint with play along its axis, ended by a soft collar."""

    def make(by: RandomSizes) -> HiddenEffect:
        return AxialFloat(link, by.size(size_mm * MM), 0.5, by.size(0.03 * MM))

    return hidden(part, f"axial-float{link + 1}", f"axial_play@joint{link + 1}", make)


def radial_float(part: str, link: int, size_mm: float) -> Case:
    """A joint with clearance across its axis."""
    return hidden(part, f"radial-float{link + 1}", None, lambda by: RadialFloat(link, by.size(size_mm * MM), 0.5))


def base_lifts(part: str, axis: str) -> Case:
    """A base that gives way beyond a moment, on one side."""
    x, y, z = (float(axis == name) for name in "xyz")
    name, right = f"base-lifts-about-{axis}", "base_compliance@base"
    return hidden(part, name, right, lambda by: LiftingBase((x, y, z), by.size(0.03), -0.1, 0.1))


def long_metre(part: str) -> Case:
    """A tracker with a long unit of length: the lengths take it up, so nothing can be missing."""
    tracker = SkewTracker(NONE, (0.008, 0.008, 0.008), NONE)
    return Case("long-metre", (), lambda *_: (tracker,), part)
