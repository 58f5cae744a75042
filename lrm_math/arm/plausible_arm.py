"""Whether an arm's lengths, masses, angles and gravity are those of an arm, or are written in other units.

Masses of arms grow nearly as the cube of their lengths: from hobby arms to industrial ones it is 4 to 100 kg/m³.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.plausibility import PlausibleSize, implausible_value, times

LEAST_REACH, MOST_REACH = 0.06, 10.0  # m
LEAST_MASS, MOST_MASS = 0.05, 1500.0  # kg, of all bodies, per cubed metre of reach
LIGHTEST = 0.02  # kg
LENGTHS = {"metres": 1e3, "centimetres": 10.0, "inches": 25.4, "millimetres": 1.0, "micrometres": 1e-3}
"""Millimetres of each unit."""
HEAVIER_LIGHTER = {"millimetres": ("kilograms", "milligrams"), "metres": ("tonnes", "grams")}
"""Units that masses seem to have which are too small, and too large, beside lengths in these units."""
NEAREST_COM, FARTHEST_COM = 1e-4, 10.0
"""Shares of the reach between which the farthest centre of mass is from its frame."""
RIGHT_ANGLE, CLOSE = math.pi / 2.0, 2e-3
NO_TURN = 7.0  # deg: of limits that are all smaller, the unit is rad
GRAVITY = PlausibleSize("gravity", "m/s2", 1.3, 30.0, times(**{"mm/s2": 1e-3, "cm/s2": 1e-2, "g": 9.81}))

Rule: TypeAlias = Literal["size", "mass", "centre-of-mass", "gravity", "angles", "limits"]
"""What is checked of an arm, by the name with which a person accepts it."""
RULES: tuple[Rule, ...] = get_args(Rule)


@dataclass(frozen=True)
class ImplausibleArm:
    """An implausible quantity of an arm: the rule by which it is, what is wrong, and what would be right."""

    rule: Rule
    what: str
    right: str


def reach(arm: Arm) -> float:
    """Sum of an arm's lengths from the base to the TCP (m)."""
    links = sum(float(np.hypot(joint.d, joint.a)) + abs(joint.extra_z or 0.0) for joint in arm.links)
    return links + float(np.linalg.norm([arm.tool.x, arm.tool.y, arm.tool.z]))


def total_mass(arm: Arm) -> float:
    """Mass of all bodies (kg)."""
    return sum(body.mass for body in arm.bodies)


def implausible(arm: Arm, written: str = "millimetres") -> Iterator[ImplausibleArm]:
    """Implausible quantities of an arm that nobody accepted. `written`: the unit of lengths in the arm's file."""
    yield from (fault for fault in _found(arm, written) if fault.rule not in arm.accepted)


def _found(arm: Arm, written: str) -> Iterator[ImplausibleArm]:
    length = reach(arm)
    if length and not LEAST_REACH <= length <= MOST_REACH:
        like = [unit for unit, mm in LENGTHS.items() if LEAST_REACH <= length * mm / LENGTHS[written] <= MOST_REACH]
        seems = f": its lengths look like {' or '.join(like)}" if like else ""
        yield ImplausibleArm("size", f"the arm is {_length(length)} long{seems}", f"lengths are in {written}")
        return
    yield from _masses(arm, length, written)
    yield from _centres_of_mass(arm, length)
    gravity = implausible_value(GRAVITY, float(np.linalg.norm(arm.gravity)))
    if gravity:
        yield ImplausibleArm("gravity", gravity.what, gravity.right)
    angles = [abs(angle) for joint in arm.links for angle in (joint.theta, joint.alpha)]
    radians = [degrees for angle in angles if (degrees := math.degrees(angle)) and _is_right_angle_in_rad(degrees)]
    if radians:
        yield ImplausibleArm("angles", f"an angle of {radians[0]:.4g} deg looks like radians", "angles are in degrees")
    limits = [abs(math.degrees(limit)) for joint in arm.joints for limit in (joint.lower, joint.upper)]
    if max(limits) < NO_TURN:
        what = f"no joint turns farther than {max(limits):.3g} deg: limits_deg looks like radians"
        yield ImplausibleArm("limits", what, "in degrees")


def _masses(arm: Arm, length: float, written: str) -> Iterator[ImplausibleArm]:
    mass, volume = total_mass(arm), length**3
    if not mass or not volume:
        return
    low, high = max(LEAST_MASS * volume, LIGHTEST), MOST_MASS * volume
    if low <= mass <= high:
        return
    heaviest = max(arm.bodies, key=lambda body: body.mass)
    which = f"body '{heaviest.name}' weighs {_mass(heaviest.mass)}, all {_mass(mass)}"
    like = HEAVIER_LIGHTER[written][mass > high]
    size = f"an arm of {_length(length)} weighs {_mass(low)} to {_mass(high)}"
    yield ImplausibleArm("mass", f"{which}: the masses look like {like}", size)


def _centres_of_mass(arm: Arm, length: float) -> Iterator[ImplausibleArm]:
    far = {body.name: float(np.linalg.norm(body.com)) for body in arm.bodies if any(body.com)}
    if not far:
        return
    name, most = max(far.items(), key=lambda item: item[1])
    if not NEAREST_COM * length <= most <= FARTHEST_COM * length:
        size = f"an arm of {_length(length)}; is its unit right?"
        what = f"the centre of mass of body '{name}' is {_length(most)} from its frame, farther than any other"
        yield ImplausibleArm("centre-of-mass", what, size)


def _is_right_angle_in_rad(degrees: float) -> bool:
    times_right = degrees / RIGHT_ANGLE
    return round(times_right) in (1, 2) and abs(degrees - round(times_right) * RIGHT_ANGLE) < CLOSE


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1.0 else f"{round(metres * 1e3, 6):.3g} mm"


def _mass(kg: float) -> str:
    return f"{kg:.4g} kg" if kg >= 1.0 else f"{kg * 1e3:.3g} g"
