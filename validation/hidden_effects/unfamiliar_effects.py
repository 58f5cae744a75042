"""Building blocks of the second catalogue: hidden effects without the tool's formula, other arms, awkward data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from validation.hidden_effects.case_generator import (
    DEG,
    MM,
    Build,
    HiddenEffectCase,
    RandomSizes,
    stable_seed,
)
from validation.synthetic import (
    ArmDescription,
    AxialFloat,
    CreepingJoint,
    DahlLoop,
    HardStop,
    HiddenEffect,
    HingedLink,
    LiftingBase,
    RadialFloat,
    SharedCable,
    SkewTracker,
    StickSlip,
    TiltingBearing,
    ToothRipple,
    TwoStageWarmUp,
    UnequalPlay,
    WeatherLag,
)

Half = Literal["tune", "report", "unforeseen", "second-unforeseen", "third-unforeseen"]
LAB, TWO_LOADS, FIVE_LEVELS_DEG = "lrm-lab", (0.0, 0.0663), (-80.0, -40.0, 0.0, 40.0, 80.0)


@dataclass(frozen=True)
class UnfamiliarCase:
    """A hidden effect, or several, and how the data are taken.

    truths: for each hidden effect the names of the tool, `effect@place`, of which any is right; None: no name fits.
    arm: a shipped arm, or one of the folder `arms`. levels_deg: the only angles of each joint; none: any angle.
    outliers: the share of wrong measurements, which are out by 5 to 25 mm.
    """

    name: str
    half: Half
    truths: tuple[frozenset[str], ...] | None
    build: Build
    arm: str = LAB
    sessions: int = 1
    loads_kg: tuple[float, ...] = TWO_LOADS
    levels_deg: tuple[float, ...] = ()
    outliers: float = 0.0

    @property
    def group(self) -> str:
        """The row of the table of totals."""
        if self.truths is None:
            return "outside the catalogue"
        return ("nothing hidden", "one effect", "two effects", "three effects")[len(self.truths)]


def hidden(
    half: Half, name: str, right: str | None, make: Callable[[RandomSizes], HiddenEffect], sessions: int = 1
) -> UnfamiliarCase:
    """A case with one effect. right: the names that fit it, by spaces; None if none does."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return (make(RandomSizes(arm, np.random.default_rng(stable_seed(name, seed, "sizes")))),)

    return UnfamiliarCase(name, half, None if right is None else (frozenset(right.split()),), build, sessions=sessions)


def from_first_catalogue(half: Half, first: HiddenEffectCase) -> UnfamiliarCase:
    """A case of the first catalogue, to be measured otherwise or on another arm."""
    truths = tuple(frozenset({name}) for name in first.truth or ())
    return UnfamiliarCase(first.name, half, truths, first.build, sessions=first.sessions)


def both(first: UnfamiliarCase, second: UnfamiliarCase) -> UnfamiliarCase:
    """The effects of two cases of the same half and arm together."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return (*first.build(arm, seed), *second.build(arm, seed))

    truths = (*(first.truths or ()), *(second.truths or ()))
    sessions = max(first.sessions, second.sessions)
    return replace(first, name=f"{first.name}+{second.name}", truths=truths, build=build, sessions=sessions)


def on(arm: str, of: UnfamiliarCase) -> UnfamiliarCase:
    """The same on another arm."""
    return replace(of, arm=arm, name=f"{of.name} on {arm}")


def one_load(of: UnfamiliarCase) -> UnfamiliarCase:
    """The same, measured without load only."""
    return replace(of, loads_kg=(0.0,), name=f"{of.name}, one load")


def five_levels(of: UnfamiliarCase) -> UnfamiliarCase:
    """The same, measured at five angles of each joint."""
    return replace(of, levels_deg=FIVE_LEVELS_DEG, name=f"{of.name}, five levels")


def with_outliers(of: UnfamiliarCase) -> UnfamiliarCase:
    """The same with one wrong measurement in twenty."""
    return replace(of, outliers=0.05, name=f"{of.name}, outliers")


def unequal_play(half: Half, joint: int, wide_deg: float) -> UnfamiliarCase:
    """Backlash with a wide and a narrow side."""

    def make(by: RandomSizes) -> HiddenEffect:
        return UnequalPlay(joint, by.size(wide_deg * DEG), by.size(0.25 * wide_deg * DEG), 0.03)

    return hidden(half, f"unequal-play{joint}", f"backlash@joint{joint}", make)


def hinged(half: Half, link: int, behind_mm: float, compliance: float) -> UnfamiliarCase:
    """A link that gives way at one place, its near or its far end."""

    def make(by: RandomSizes) -> HiddenEffect:
        return HingedLink(link, behind_mm * MM, (by.size(compliance), by.size(0.5 * compliance)))

    where, other = ("near", link - 1) if behind_mm else ("far", link + 1)
    right = f"lateral_compliance@link{link} lateral_compliance@link{other}"  # both meet where it gives way
    return hidden(half, f"bends-at-{where}-end{link}", right, make)


def tilting_bearing(half: Half, link: int, tilt_deg: float) -> UnfamiliarCase:
    """A bearing with clearance at the far end of a link."""
    right = f"lateral_compliance@link{link} lateral_compliance@link{link + 1}"
    return hidden(half, f"bearing{link + 1}", right, lambda by: TiltingBearing(link, by.size(tilt_deg * DEG), 0.15))


def stick_slip(half: Half, joint: int, degrees: float) -> UnfamiliarCase:
    """Friction that sticks, slips, and grows with the load."""
    return hidden(
        half,
        f"stick-slip{joint}",
        f"hysteresis@joint{joint}",
        lambda by: StickSlip(joint, 2.0 * degrees * DEG, by.size(degrees * DEG), 0.8),
    )


def dahl_loop(half: Half, joint: int, degrees: float) -> UnfamiliarCase:
    """Friction with a long memory."""
    return hidden(
        half, f"dahl{joint}", f"hysteresis@joint{joint}", lambda by: DahlLoop(joint, by.size(degrees * DEG), 20.0 * DEG)
    )


def creeps(half: Half, joint: int, compliance: float) -> UnfamiliarCase:
    """A joint that follows its torque with a memory of a minute."""
    right = f"creep@joint{joint}"
    return hidden(half, f"creep{joint}", right, lambda by: CreepingJoint(joint, by.size(compliance), 60.0))


def stops(half: Half, joint: int, side: int, at_deg: float) -> UnfamiliarCase:
    """A joint that meets a stop."""
    right = f"servo_gain@joint{joint} cable_spring@joint{joint}"
    return hidden(
        half, f"stop{joint}", right, lambda by: HardStop(joint, side, at_deg * DEG, 1.0 - by.size(0.08), 3.0 * DEG)
    )


def gear_ripple(half: Half, joint: int, waves: int, degrees: float) -> UnfamiliarCase:
    """A gear whose error repeats several times per turn."""

    def make(by: RandomSizes) -> HiddenEffect:
        return ToothRipple(joint, waves, by.size(degrees * DEG), round(by.rng.uniform(-math.pi, math.pi), 3))

    return hidden(half, f"gear{joint}", f"gear_ripple@joint{joint} eccentricity@joint{joint}", make)


def shared_cable(half: Half, a: int, b: int, stiffness: float) -> UnfamiliarCase:
    """A cable over two joints."""
    right = f"cable_spring@joint{a} cable_spring@joint{b} coupling@joint{a}<-joint{b} coupling@joint{b}<-joint{a}"
    return hidden(half, f"cable-over-{a}-and-{b}", right, lambda by: SharedCable((a, b), -0.5, by.size(stiffness)))


def warms_in_two_stages(half: Half, joint: int, degrees: float) -> UnfamiliarCase:
    """A joint that warms up with two time constants, in two sessions."""

    def make(by: RandomSizes) -> HiddenEffect:
        return TwoStageWarmUp(joint, (by.size(degrees * DEG), by.size(degrees * DEG)), (300.0, 2700.0))

    return hidden(half, f"warms-in-two-stages{joint}", f"drift@joint{joint}", make, sessions=2)


def weather(half: Half, joint: int, degrees: float) -> UnfamiliarCase:
    """A joint that follows the room's temperature."""
    return hidden(
        half,
        f"weather{joint}",
        f"drift@joint{joint}",
        lambda by: WeatherLag(joint, by.sign() * by.size(degrees * DEG), 5400.0, 1200.0),
    )


def axial_float(half: Half, link: int, size_mm: float) -> UnfamiliarCase:
    """A joint with play along its axis, ended by a soft collar."""
    joint = link + 1
    return hidden(
        half,
        f"axial-float{joint}",
        f"axial_play@joint{joint}",
        lambda by: AxialFloat(link, by.size(size_mm * MM), 0.5, by.size(0.03 * MM)),
    )


def radial_float(half: Half, link: int, size_mm: float) -> UnfamiliarCase:
    """A joint with clearance across its axis."""
    return hidden(half, f"radial-float{link + 1}", None, lambda by: RadialFloat(link, by.size(size_mm * MM), 0.5))


def base_lifts(half: Half, axis: str) -> UnfamiliarCase:
    """A base that gives way beyond a moment, on one side."""
    about = tuple(float(axis == name) for name in "xyz")
    return hidden(
        half,
        f"base-lifts-about-{axis}",
        "base_compliance@base",
        lambda by: LiftingBase((about[0], about[1], about[2]), by.size(0.03), -0.1, 0.1),
    )


def long_metre(half: Half) -> UnfamiliarCase:
    """A tracker with a long unit of length: the lengths take it up, so nothing can be missing."""
    tracker = SkewTracker((0.0, 0.0, 0.0), (0.008, 0.008, 0.008), (0.0, 0.0, 0.0))
    return UnfamiliarCase("long-metre", half, (), lambda *_: (tracker,))


def nothing(half: Half) -> UnfamiliarCase:
    """No hidden effect."""
    return UnfamiliarCase("nothing", half, (), lambda *_: ())
