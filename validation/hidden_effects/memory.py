"""Worlds with a memory: what is hidden, where, and how long the arm waited between two readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.case import DEG, MEMORY, MEMORY_BLIND, Case, RandomSizes, Waits, hidden, nothing
from validation.synthetic import HiddenEffect
from validation.synthetic.hidden_links import ViscoelasticBase
from validation.synthetic.hidden_memory import (
    HeatedServo,
    PromptReading,
    SlippingHorn,
    ViscoelasticJoint,
)

COMPLIANCE = {2: 0.05, 3: 0.08, 4: 0.12}
"""rad/Nm, by joint."""


def even(_: np.random.Generator, count: int) -> Array:
    """A reading every 15 s."""
    return np.full(count, 15.0)


def uneven(rng: np.random.Generator, count: int) -> Array:
    """Mostly 5 to 60 s."""
    return np.asarray(np.round(np.exp(rng.normal(np.log(18.0), 0.6, count)), 1), dtype=np.float64)


def with_breaks(rng: np.random.Generator, count: int) -> Array:
    """Ten seconds, and now and then some minutes."""
    return np.where(rng.random(count) < 0.06, rng.uniform(120.0, 900.0, count), 10.0)


def _world(
    name: str, right: str, make: Callable[[RandomSizes], HiddenEffect], waits: Waits, part: str = MEMORY
) -> Case:
    return replace(hidden(part, name, right, make), waits=waits)


def _creep(joint: int, constant_s: float, waits: Waits, late: float = 0.0, fresh: bool = False) -> Case:
    def make(by: RandomSizes) -> HiddenEffect:
        return ViscoelasticJoint(joint, by.size(COMPLIANCE[joint]), (constant_s,), late, fresh)

    part = MEMORY_BLIND if late > 0.0 or fresh else MEMORY
    return _world(f"creep{joint} {constant_s:g} s", f"creep@joint{joint}", make, waits, part)


def _base(constant_s: float, waits: Waits, part: str = MEMORY) -> Case:
    def make(by: RandomSizes) -> HiddenEffect:
        return ViscoelasticBase((by.size(0.02), by.size(0.03)), constant_s)

    return _world(f"creep base {constant_s:g} s", "creep@base", make, waits, part)


def _paces(name: str, joint: int, size: float, constants_s: tuple[float, ...], waits: Waits, late: float) -> Case:
    def make(by: RandomSizes) -> HiddenEffect:
        return ViscoelasticJoint(joint, by.size(size), constants_s, late)

    return _world(f"{name} {joint}", f"creep@joint{joint}", make, waits, MEMORY_BLIND)


def _heat2(by: RandomSizes) -> HiddenEffect:
    return HeatedServo(2, by.sign() * by.size(0.03), by.sign() * by.size(0.02), 600.0)


def _heat3(by: RandomSizes) -> HiddenEffect:
    return HeatedServo(3, by.sign() * by.size(0.15), 0.0, 300.0)


def _prompt(by: RandomSizes) -> HiddenEffect:
    return PromptReading(3, by.size(0.08), 150.0, 4.0)


WORLDS = (
    _creep(2, 25.0, even),
    _creep(3, 90.0, uneven),
    _creep(4, 90.0, even),
    _creep(2, 300.0, uneven),
    _creep(3, 300.0, with_breaks),
    _creep(2, 900.0, even),
    _creep(3, 900.0, uneven),
    _base(120.0, even),
    _world("heat2", "self_heating@joint2", _heat2, uneven),
    _world("heat3", "self_heating@joint3", _heat3, with_breaks),
    _world("slip2", "slip@joint2", lambda by: SlippingHorn(2, by.size(2.0 * DEG), 0.3), even),
    _world("slip3", "slip@joint3", lambda by: SlippingHorn(3, by.size(2.0 * DEG), 0.5), uneven),
    *(
        replace(nothing(MEMORY), name=f"nothing, {name}", waits=waits)
        for name, waits in (("even", even), ("uneven", uneven), ("breaks", with_breaks))
    ),
)
BLIND_WORLDS = (
    _creep(2, 40.0, uneven, late=0.8),
    _creep(3, 200.0, uneven, late=0.5),
    _creep(4, 60.0, with_breaks, fresh=True),
    _creep(2, 500.0, uneven, fresh=True),
    _paces("two paces", 2, 0.06, (30.0, 400.0), even, 0.0),
    _paces("two paces", 3, 0.1, (25.0, 200.0), uneven, 0.9),
    _base(400.0, uneven, MEMORY_BLIND),
    # written after the tool's second pace, its share of the wait and its loads of the fitted arm
    _world("read promptly 3", "creep@joint3", _prompt, uneven, MEMORY_BLIND),
    _paces("three paces", 2, 0.06, (15.0, 120.0, 900.0), uneven, 0.0),
)
"""Written after the tool's effects."""
