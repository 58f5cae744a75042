"""Faults of supplies, belts, cables and gears, most of which act on more than one joint."""

from __future__ import annotations

import numpy as np

from lrm_math.arm.place_names import both, turned_by
from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.faults.measurement import HealthyMeasurement, SpoiledMeasurement, at_joint

COMMON = ("common_gain@servos",)
OF_ANGLE = ("angle_curve", "eccentricity", "servo_gain", "cable_spring")
"""Effects of what a joint does over its own angle."""


def supply_sags(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """All servos fall short of their angles together, the more the farther out the arm holds itself and its load."""
    sag = taken.rng.uniform(0.03, 0.05) * taken.weight_moment
    return SpoiledMeasurement(taken.at(taken.q * (1.0 - sag[:, None])), right=COMMON)


def belt_across(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A belt beside two joints turns one by the sine of the sum of the others' angles."""
    q, joint = taken.q.copy(), taken.joint()
    q[:, joint] += np.radians(taken.rng.uniform(0.6, 1.0)) * np.sin(2.0 * (q[:, joint - 1] + q[:, joint + 1]))
    return SpoiledMeasurement(taken.at(q))


def belt_by_torque(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A belt stretches by what the joint before it carries."""
    joint = taken.joint()
    reach = np.abs(np.sin(taken.q[:, 1])) * taken.weight_moment
    by = np.radians(taken.rng.uniform(1.0, 1.6)) * reach
    return SpoiledMeasurement(taken.moved(joint, by))


def pulled_by_two(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A hose pulls a joint by the product of two others' angles."""
    joint, last = taken.joint(), taken.q.shape[1] - 1
    by = np.radians(taken.rng.uniform(0.5, 0.8)) * taken.q[:, joint - 1] * taken.q[:, min(joint + 1, last)]
    return SpoiledMeasurement(taken.moved(joint, by))


def damaged_tooth(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """One damaged tooth: a bump of a degree over twelve degrees."""
    joint = taken.joint()
    middle = taken.rng.choice(taken.q[:, joint])
    apart = (taken.q[:, joint] - middle) / np.radians(6.0)
    by = np.radians(taken.rng.uniform(0.8, 1.2)) * np.exp(-(apart**2))
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *OF_ANGLE))


def soft_stop(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Rubber before the end stop: the last fifth of the range is not quite reached."""
    joint = taken.joint()
    start = np.quantile(taken.q[:, joint], 0.8)
    by = -taken.rng.uniform(0.06, 0.10) * np.maximum(taken.q[:, joint] - start, 0.0)
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *OF_ANGLE))


def table_of_the_servo(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo reads a table of five wrong values."""
    joint = taken.joint()
    knots = np.linspace(taken.q[:, joint].min(), taken.q[:, joint].max(), 5)
    by = np.interp(taken.q[:, joint], knots, np.radians(taken.rng.uniform(-0.8, 0.8, 5)))
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *OF_ANGLE))


def frequency_drifts(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The board's clock drifts: every servo's angle is scaled alike, the more the later."""
    scale = 1.0 + taken.rng.uniform(0.015, 0.03) * taken.progress
    return SpoiledMeasurement(taken.at(taken.q * scale[:, None]), right=COMMON)


def clock_wrong(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The board's clock is wrong by two percent: every servo has the same wrong scale."""
    return SpoiledMeasurement(taken.at(taken.q * (1.0 + taken.rng.uniform(0.015, 0.025))), right=COMMON)


def bistable(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A link snaps to another shape where two joints bend the same way."""
    joint = taken.joint()
    same = taken.q[:, joint] * taken.q[:, joint - 1] > 0.0
    return SpoiledMeasurement(taken.moved(joint, np.radians(taken.rng.uniform(0.5, 0.9)) * same))


def rubs(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A bundle rubs at the housing: a joint is held back by the sine of its angle times that of the next."""
    joint = taken.joint()
    by = np.sin(2.0 * taken.q[:, joint]) * np.cos(taken.q[:, joint + 1])
    return SpoiledMeasurement(taken.moved(joint, np.radians(taken.rng.uniform(0.6, 0.9)) * by))


def stands_off_beyond_zero(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo's horn stands off by a step where its pulse is longer than in the middle."""
    joint = taken.joint()
    by = np.radians(taken.rng.uniform(0.5, 0.9)) * (taken.q[:, joint] > 0.0)
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *OF_ANGLE))


def follows_a_square(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A hose bends with the joint before and pulls on the next one, both ways alike."""
    joint = taken.joint()
    before = taken.q[:, joint - 1]
    by = np.radians(taken.rng.uniform(0.8, 1.4)) * (before / np.abs(before).max()) ** 2
    one, other = f"joint{joint}", f"joint{joint + 1}"
    place = turned_by(other, one)
    right = EffectRef("coupling", place), EffectRef("coupling_curve", place), EffectRef("cable_curve", both(one, other))
    return SpoiledMeasurement(taken.moved(joint, by), right=tuple(map(str, right)))
