"""True parameters of the simulated arm: drawn by a seed from the independent generator, unknown to the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.synthetic import (
    ArmDescription,
    BaseRocking,
    CablePull,
    CoupledJoint,
    EccentricShaft,
    GroundTruth,
    HardeningSpring,
    HiddenEffect,
    LinkBending,
    OneSidedGain,
    SoftPlay,
    base_displacement_to_deviations,
)

DEG = math.pi / 180.0


@dataclass(frozen=True)
class HiddenArm:
    """The true arm. `effect`: what is hidden in it, by the tool's name. `words`: the same for a person."""

    truth: GroundTruth
    effect: str
    words: str


@dataclass(frozen=True)
class _Draw:
    """Random draws: sizes within a quarter of a typical one, signs."""

    rng: np.random.Generator
    arm: ArmDescription

    def size(self, typical: float) -> float:
        return float(f"{typical * self.rng.uniform(0.8, 1.25):.4g}")

    def signed(self, typical: float) -> float:
        return float(self.rng.choice([-1.0, 1.0])) * self.size(typical)


def _play(draw: _Draw, joint: int) -> HiddenEffect:
    return SoftPlay(joint, draw.size(1.5 * DEG), 0.04)


def _gain(draw: _Draw, joint: int) -> HiddenEffect:
    return OneSidedGain(joint, int(draw.rng.choice([-1, 1])), draw.signed(0.025), 6.0 * DEG)


def _shaft(draw: _Draw, joint: int) -> HiddenEffect:
    return EccentricShaft(joint, draw.size(0.03), round(draw.rng.uniform(-math.pi, math.pi), 3))


def _spring(draw: _Draw, joint: int) -> HiddenEffect:
    return HardeningSpring(joint, draw.size(0.0055), 0.15)


def _cable(draw: _Draw, joint: int) -> HiddenEffect:
    return CablePull(joint, 1, -75.0 * DEG, draw.size(0.055), 4.0)


def _coupling(draw: _Draw, joint: int) -> HiddenEffect:
    return CoupledJoint(joint, joint - 1, draw.signed(0.025), 1.5)


def _bending(draw: _Draw, link: int) -> HiddenEffect:
    soft = 6.0 if link == 2 else 1.5
    return LinkBending(link, 0.1, (draw.size(soft), draw.size(2.0 * soft)))


def _rocking(draw: _Draw, _: int) -> HiddenEffect:
    beta = draw.arm.base.angles_rad[1]
    return BaseRocking(draw.size(0.012), (math.cos(beta), 0.0, math.sin(beta)))


@dataclass(frozen=True)
class _Kind:
    """A kind of effect: how it is drawn, at which numbers, its name with `{n}` and `{m}` = n − 1."""

    draw: Callable[[_Draw, int], HiddenEffect]
    numbers: tuple[int, ...]
    name: str
    words: str


KINDS = (
    _Kind(_play, (2, 3, 4), "backlash@joint{n}", "play in the gear of joint {n}"),
    _Kind(_gain, (1, 2, 4), "servo_gain@joint{n}", "a wrong gain of servo {n}, on one side of zero"),
    _Kind(_shaft, (2, 5), "eccentricity@joint{n}", "an eccentric shaft in joint {n}"),
    _Kind(_spring, (1, 2), "nonlinear_stiffness@joint{n}", "a spring in joint {n} that hardens"),
    _Kind(_cable, (1, 4), "cable_spring@joint{n}", "a cable that pulls joint {n} back"),
    _Kind(_coupling, (3, 5), "coupling@joint{n}<-joint{m}", "joint {n} turns a little with joint {m}"),
    _Kind(_bending, (2, 4), "lateral_compliance@link{n}", "link {n} bends sideways"),
    _Kind(_rocking, (0,), "base_compliance@base", "the base rocks about its other axis"),
)
"""Effects that a rover can compensate: they need angles and loads only, no thermometer and no clock."""


def hidden_arm(arm: ArmDescription, seed: int) -> HiddenArm:
    """Random errors of geometry and springs, and one of `KINDS` at a random place."""
    draw = _Draw(np.random.default_rng([seed, 18]), arm)
    kind = KINDS[draw.rng.integers(len(KINDS))]
    number = int(draw.rng.choice(kind.numbers))
    effect = kind.draw(draw, number)
    truth = base_displacement_to_deviations(arm, GroundTruth.random(arm, seed, (effect,)))
    named = kind.name.format(n=number, m=number - 1), kind.words.format(n=number, m=number - 1)
    return HiddenArm(truth, *named)
