"""Cases of hidden effects: their kinds and places under the tool's names, with sizes that vary with the seed."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.synthetic import (
    ArmDescription,
    BaseRocking,
    BaseWarmUp,
    CablePull,
    CoupledJoint,
    EccentricShaft,
    FrictionLag,
    HardeningSpring,
    HiddenEffect,
    JointSlip,
    LinkBending,
    OneSidedGain,
    SessionStep,
    SkewTracker,
    SoftPlay,
    WarmUp,
    WrongBody,
)

Build = Callable[[ArmDescription, int], tuple[HiddenEffect, ...]]
DEG = math.pi / 180.0
MINUTE_S = 60.0
GRAM, MM = 1e-3, 1e-3


@dataclass(frozen=True)
class HiddenEffectCase:
    """Effects hidden in one data set.

    truth: their names and places in the tool's words; empty if nothing is hidden, None if no name of the tool's fits.
    build: the effects from the arm and a seed. sessions: how many power-on sessions the poses are spread over.
    """

    name: str
    truth: tuple[str, ...] | None
    build: Build
    sessions: int = 1


@dataclass(frozen=True)
class RandomSizes:
    """The arm, and random draws of a seed: sizes within a quarter of the typical one, and signs."""

    arm: ArmDescription
    rng: np.random.Generator

    def size(self, typical: float) -> float:
        """Between 0.8 and 1.25 of it, to four digits (what a truth file shows)."""
        return float(f"{typical * 0.8 * (1.25 / 0.8) ** self.rng.random():.4g}")

    def sign(self) -> int:
        """-1 or 1."""
        return int(self.rng.choice([-1, 1]))


def stable_seed(*words: object) -> int:
    """A seed that is the same on every machine and in every run (CRC-32)."""
    return zlib.crc32("/".join(str(word) for word in words).encode())


def case(
    name: str, truth: str | None, make: Callable[[RandomSizes], HiddenEffect], sessions: int = 1
) -> HiddenEffectCase:
    """A case with one effect; truth None if no name of the tool's fits it."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return (make(RandomSizes(arm, np.random.default_rng(stable_seed(name, seed, "sizes")))),)

    return HiddenEffectCase(name, None if truth is None else (truth,), build, sessions)


def combined(*parts: HiddenEffectCase) -> HiddenEffectCase:
    """All effects of several cases."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return tuple(effect for part in parts for effect in part.build(arm, seed))

    truth = tuple(place for part in parts for place in part.truth or ())
    return HiddenEffectCase("+".join(part.name for part in parts), truth, build, max(part.sessions for part in parts))


def play(joint: int, width_deg: float, softness_nm: float) -> HiddenEffectCase:
    """Backlash of a joint."""
    return case(
        f"play{joint}",
        f"backlash@joint{joint}",
        lambda by: SoftPlay(joint, by.size(width_deg * DEG), softness_nm),
    )


def lag(joint: int, width_deg: float) -> HiddenEffectCase:
    """Hysteresis of a joint."""
    return case(
        f"lag{joint}",
        f"hysteresis@joint{joint}",
        lambda by: FrictionLag(joint, by.size(width_deg * DEG), 2.0 * DEG),
    )


def gain(joint: int, side: int, gain: float) -> HiddenEffectCase:
    """A gain on one side of a joint."""
    return case(
        f"gain{joint}",
        f"servo_gain@joint{joint}",
        lambda by: OneSidedGain(joint, side, by.sign() * by.size(gain), 6.0 * DEG),
    )


def shaft(joint: int, offset: float) -> HiddenEffectCase:
    """An eccentric shaft in a joint."""
    return case(
        f"shaft{joint}",
        f"eccentricity@joint{joint}",
        lambda by: EccentricShaft(joint, by.size(offset), round(by.rng.uniform(-math.pi, math.pi), 3)),
    )


def spring(joint: int, size_rad: float, scale_nm: float) -> HiddenEffectCase:
    """A joint that hardens; size / scale stays below the least compliance that Truth.random draws."""
    return case(
        f"spring{joint}",
        f"nonlinear_stiffness@joint{joint}",
        lambda by: HardeningSpring(joint, by.size(size_rad), scale_nm),
    )


def cable(joint: int, slack_deg: float, stiffness_nm_per_rad: float) -> HiddenEffectCase:
    """A cable that pulls a joint back."""
    return case(
        f"cable{joint}",
        f"cable_spring@joint{joint}",
        lambda by: CablePull(joint, 1, slack_deg * DEG, by.size(stiffness_nm_per_rad), 4.0),
    )


def coupled(joint: int, by_joint: int, ratio: float) -> HiddenEffectCase:
    """A joint that turns with another."""
    return case(
        f"coupled{joint}-{by_joint}",
        f"coupling@joint{joint}<-joint{by_joint}",
        lambda by: CoupledJoint(joint, by_joint, by.sign() * by.size(ratio), 1.5),
    )


def bending(link: int, length_m: float, first_nm2: float, second_nm2: float) -> HiddenEffectCase:
    """A link that bends, differently about its two axes."""
    return case(
        f"bending{link}",
        f"lateral_compliance@link{link}",
        lambda by: LinkBending(link, length_m, (by.size(first_nm2), by.size(second_nm2))),
    )


def bracket(link: int, aside_mm: float) -> HiddenEffectCase:
    """A link with something heavy screwed to its side."""

    def make(by: RandomSizes) -> HiddenEffect:
        return WrongBody(f"link {link}", by.size(0.35), (by.sign() * by.size(aside_mm * MM), 0.0, 0.0))

    return case(f"bracket{link}", f"mass@link{link}", make)


def base_roll(by: RandomSizes) -> HiddenEffect:
    """About x of the base as it is mounted, before its other turns."""
    (_, beta, _) = by.arm.base.angles_rad
    return BaseRocking(by.size(0.012), (math.cos(beta), 0.0, math.sin(beta)))


def base_warms(by: RandomSizes) -> HiddenEffect:
    """A base that drifts about the axis about which it also bends."""
    return BaseWarmUp((0.0, by.sign() * by.size(0.5 * DEG), 0.0), (8.0 * MINUTE_S, by.size(35.0 * MINUTE_S)))


def warms(joint: int, final_deg: float) -> HiddenEffectCase:
    """A joint that drifts."""
    return case(
        f"warm{joint}",
        f"drift@joint{joint}",
        lambda by: WarmUp(joint, by.sign() * by.size(final_deg * DEG), by.size(30.0 * MINUTE_S)),
    )


def slip(joint: int, size_deg: float) -> HiddenEffectCase:
    """A joint that slips once, while it is measured."""
    return case(
        f"slip{joint}",
        f"change_point@joint{joint}",
        lambda by: JointSlip(joint, by.sign() * by.size(size_deg * DEG), by.size(14.0 * MINUTE_S)),
    )


def restart(joint: int, sessions: int, step_deg: float) -> HiddenEffectCase:
    """A joint that stands elsewhere after each power-on."""

    def make(by: RandomSizes) -> HiddenEffect:
        steps = [by.sign() * by.size(step_deg * DEG) for _ in range(sessions - 1)]
        return SessionStep(joint, (0.0, *steps))

    return case(f"restart{joint}", f"session@joint{joint}", make, sessions)


def stretched(by: RandomSizes) -> HiddenEffect:
    """A tracker whose axes have unequal units."""
    stretch = (by.size(0.006), -by.size(0.004), by.size(0.003))
    return SkewTracker((by.sign() * 0.01, 0.004, -0.006), stretch, (0.0, 0.0, 0.0))


def leaning(by: RandomSizes) -> HiddenEffect:
    """A tracker whose axes are not at right angles."""
    lean = (by.sign() * by.size(0.006), by.sign() * by.size(0.004), by.sign() * by.size(0.005))
    return SkewTracker((0.003, -0.01, 0.005), (0.003, 0.003, 0.003), lean)


def named(*cases: HiddenEffectCase) -> dict[str, HiddenEffectCase]:
    """Cases by their names."""
    return {case.name: case for case in cases}
