"""Worlds with a memory: what is hidden, where, and how long the arm waited between two readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm_file import shipped_arms
from validation.hidden_effects.case_generator import DEG, RandomSizes, stable_seed
from validation.memory.effects import (
    HeatedServo,
    ManyPaceJoint,
    PromptReading,
    SlippingHorn,
    ViscoelasticBase,
    ViscoelasticJoint,
)
from validation.synthetic import (
    Dataset,
    GroundTruth,
    HiddenEffect,
    Schedule,
    base_displacement_to_deviations,
    load_arm,
    random_poses,
    simulate,
)
from validation.synthetic.screws import Array

ARM, NOISE_M, LOADS_KG = "lrm-lab", 3e-4, (0.0, 0.0663)
Waits = Callable[[np.random.Generator, int], Array]


@dataclass(frozen=True)
class MemoryWorld:
    """A hidden cause. `right`: names of the tool's that are true of it; none: nothing is hidden.

    later: whether it was written after the tool's effects.
    """

    name: str
    right: tuple[str, ...]
    make: Callable[[RandomSizes], HiddenEffect | None]
    waits: Waits
    later: bool = False


def even(_: np.random.Generator, count: int) -> Array:
    """A reading every 15 s."""
    return np.full(count, 15.0)


def uneven(rng: np.random.Generator, count: int) -> Array:
    """Mostly 5 to 60 s."""
    return np.asarray(np.round(np.exp(rng.normal(np.log(18.0), 0.6, count)), 1), dtype=np.float64)


def with_breaks(rng: np.random.Generator, count: int) -> Array:
    """Ten seconds, and now and then some minutes."""
    return np.where(rng.random(count) < 0.06, rng.uniform(120.0, 900.0, count), 10.0)


def _joint(joint: int, constant_s: float, waits: Waits, late: float = 0.0, fresh: bool = False) -> MemoryWorld:
    return MemoryWorld(
        f"creep{joint} {constant_s:g} s",
        (f"creep@joint{joint}",),
        lambda by: ViscoelasticJoint(joint, by.size({2: 0.05, 3: 0.08, 4: 0.12}[joint]), constant_s, late, fresh),
        waits,
        later=late > 0.0 or fresh,
    )


WORLDS: tuple[MemoryWorld, ...] = (
    _joint(2, 25.0, even),
    _joint(3, 90.0, uneven),
    _joint(4, 90.0, even),
    _joint(2, 300.0, uneven),
    _joint(3, 300.0, with_breaks),
    _joint(2, 900.0, even),
    _joint(3, 900.0, uneven),
    MemoryWorld(
        "creep base 120 s", ("creep@base",), lambda by: ViscoelasticBase((by.size(0.02), by.size(0.03)), 120.0), even
    ),
    MemoryWorld(
        "heat2",
        ("self_heating@joint2",),
        lambda by: HeatedServo(2, by.sign() * by.size(0.03), by.sign() * by.size(0.02), 600.0),
        uneven,
    ),
    MemoryWorld(
        "heat3", ("self_heating@joint3",), lambda by: HeatedServo(3, by.sign() * by.size(0.15), 0.0, 300.0), with_breaks
    ),
    MemoryWorld("slip2", ("slip@joint2",), lambda by: SlippingHorn(2, by.size(2.0 * DEG), 0.3), even),
    MemoryWorld("slip3", ("slip@joint3",), lambda by: SlippingHorn(3, by.size(2.0 * DEG), 0.5), uneven),
    # written after the tool's effects
    _joint(2, 40.0, uneven, late=0.8),
    _joint(3, 200.0, uneven, late=0.5),
    _joint(4, 60.0, with_breaks, fresh=True),
    _joint(2, 500.0, uneven, fresh=True),
    MemoryWorld(
        "two paces 2", ("creep@joint2",), lambda by: ManyPaceJoint(2, by.size(0.06), (30.0, 400.0)), even, True
    ),
    MemoryWorld(
        "two paces 3", ("creep@joint3",), lambda by: ManyPaceJoint(3, by.size(0.1), (25.0, 200.0), 0.9), uneven, True
    ),
    MemoryWorld(
        "creep base 400 s",
        ("creep@base",),
        lambda by: ViscoelasticBase((by.size(0.02), by.size(0.03)), 400.0),
        uneven,
        True,
    ),
    # written after the tool's second pace, its share of the wait and its loads of the fitted arm
    MemoryWorld(
        "read promptly 3", ("creep@joint3",), lambda by: PromptReading(3, by.size(0.08), 150.0, 4.0), uneven, True
    ),
    MemoryWorld(
        "three paces 2",
        ("creep@joint2",),
        lambda by: ManyPaceJoint(2, by.size(0.06), (15.0, 120.0, 900.0)),
        uneven,
        True,
    ),
    # nothing hidden
    MemoryWorld("nothing, even", (), lambda _: None, even),
    MemoryWorld("nothing, uneven", (), lambda _: None, uneven),
    MemoryWorld("nothing, breaks", (), lambda _: None, with_breaks),
)


def measured(world: MemoryWorld, seed: int, count: int) -> tuple[Dataset, Dataset]:
    """Data that the tool sees, and as many other poses of the same arm without noise, at the same times."""
    arm = load_arm(shipped_arms()[ARM])
    hidden = world.make(RandomSizes(arm, np.random.default_rng(stable_seed(world.name, seed, "sizes"))))
    drawn = GroundTruth.random(arm, stable_seed(world.name, seed, "arm"), () if hidden is None else (hidden,))
    truth = base_displacement_to_deviations(arm, drawn)
    rng = np.random.default_rng(stable_seed(world.name, seed, "order"))
    schedule = Schedule(np.cumsum(world.waits(rng, count)), np.ones(count), np.zeros(len(arm.links)))

    def at(what: str, noise: float) -> Dataset:
        q = random_poses(arm, count, stable_seed(world.name, seed, what))
        return simulate(
            arm, truth, q, rng.choice(LOADS_KG, count), noise, stable_seed(world.name, seed, "noise"), schedule
        )

    return at("poses", NOISE_M), at("unseen", 0.0)


def true_parameters(hidden: HiddenEffect) -> dict[str, float]:
    """The tool's parameters, by key, that a hidden cause makes (SI); none of one that has another formula."""
    match hidden:
        case ViscoelasticJoint(joint, compliance):
            return {f"creep.joint{joint}.k_rad_per_Nm": compliance}
        case PromptReading(joint, compliance):
            return {f"creep.joint{joint}.k_rad_per_Nm": compliance}
        case ViscoelasticBase((about_x, about_y)):
            return {"creep.base.k_x_rad_per_Nm": about_x, "creep.base.k_y_rad_per_Nm": about_y}
        case HeatedServo(joint, zero, scale):
            names = {"a_rad_per_Nm2": zero, "g_rad_per_rad_per_Nm2": scale}
            return {f"self_heating.joint{joint}.{name}": value for name, value in names.items()}
        case SlippingHorn(joint, bound):
            return {f"slip.joint{joint}.b_rad": bound}
        case _:
            return {}
