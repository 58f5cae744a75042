"""The part of an arm that is the same wherever it is mounted: links, servos, bodies between base and tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import zip_longest
from typing import TypeAlias

from lrm_math.arm.arm import Arm, Body, Joint, MimicJoint
from lrm_math.arm.servo_table import ServoTable

Both: TypeAlias = tuple[float | None, float | None]
"""One value of either arm (SI)."""
LENGTH, ANGLE, MASS, PULSE, RATIO = 1e-4, math.radians(0.01), 1e-3, 1e-6, 1e-4
"""m, rad, kg, s, 1: files of one arm differ by less, as they round its drawing to 0.1 mm, 0.01 deg, 1 g and 1 µs."""


def arm_part_difference(first: Arm, other: Arm) -> str:
    """First difference of two arms that are no matter of how they are mounted, in words; empty if there is none.

    Base, gravity, tool, the bodies of the tool and joint limits may differ.
    """
    if first.dof != other.dof:
        return f"{first.name} has {first.dof} joints, {other.name} {other.dof}"
    return next(_differences(first, other), "")


def _differences(first: Arm, other: Arm) -> Iterator[str]:
    names = first.name, other.name
    if first.link_places != other.link_places:
        yield f"{first.name} has the joints {', '.join(first.link_places)}, {other.name} {', '.join(other.link_places)}"
        return
    for k, mimics in enumerate(zip(first.mimics, other.mimics, strict=True), start=1):
        yield from _of_mimics(f"mimic {k}", *mimics, names)
    for number, pair in enumerate(zip(first.links, other.links, strict=True), start=1):
        for name, unit, si, tolerance, values in _of_joints(*pair):
            if _differ(values, tolerance):
                yield _words(f"joint {number}: {name}", unit, si, values, names)
        if pair[0].servo is not None and pair[1].servo is not None:
            yield from (f"joint {number}: {words}" for words in _of_servos(pair[0].servo, pair[1].servo, names))
    for body, its_other in zip_longest(_bodies(first), _bodies(other)):
        if body is None or its_other is None:
            there, (has, lacks) = (body, names) if its_other is None else (its_other, names[::-1])
            yield f"body '{there.name}' of {has} has no counterpart in {lacks}"
        else:
            yield from _of_bodies(body, its_other, names)


def _of_joints(first: Joint, other: Joint) -> Iterator[tuple[str, str, float, float, Both]]:
    """Name, unit, its size (SI), tolerance (SI), and both values of every dimension of a link."""
    for name in ("theta", "alpha", "beta"):
        yield name, "deg", math.radians(1.0), ANGLE, (getattr(first, name), getattr(other, name))
    for name in ("d", "a", "extra_z"):
        yield name, "mm", 1e-3, LENGTH, (getattr(first, name), getattr(other, name))


def _of_mimics(where: str, first: MimicJoint, other: MimicJoint, names: tuple[str, str]) -> Iterator[str]:
    if first.leader != other.leader:
        yield f"{where} follows joint {first.leader + 1} in {names[0]}, joint {other.leader + 1} in {names[1]}"
    if _differ((first.ratio, other.ratio), RATIO):
        yield _words(f"{where}: ratio", "", 1.0, (first.ratio, other.ratio), names)
    if _differ((first.offset, other.offset), ANGLE):
        yield _words(f"{where}: offset", "deg", math.radians(1.0), (first.offset, other.offset), names)


def _of_servos(first: ServoTable, other: ServoTable, names: tuple[str, str]) -> Iterator[str]:
    for angle, pulse in zip(first.angle, first.pulse, strict=True):
        values = pulse, float(other.pulse_of(angle))
        if _differ(values, PULSE):
            yield _words(f"pulse at {math.degrees(angle):g} deg", "us", 1e-6, values, names)


def _of_bodies(first: Body, other: Body, names: tuple[str, str]) -> Iterator[str]:
    if first.loads_joint != other.loads_joint or first.frame != other.frame or first.near_end != other.near_end:
        yield f"body '{first.name}' of {names[0]} is fixed elsewhere than '{other.name}' of {names[1]}"
    if _differ((first.mass, other.mass), MASS):
        yield _words(f"body '{first.name}': mass", "g", 1e-3, (first.mass, other.mass), names)
    for axis, values in zip("xyz", zip(first.com, other.com, strict=True), strict=True):
        if _differ(values, LENGTH):
            yield _words(f"body '{first.name}': {axis} of the centre of mass", "mm", 1e-3, values, names)


def _bodies(arm: Arm) -> tuple[Body, ...]:
    """The bodies between base and tool."""
    return tuple(body for body in arm.bodies_outwards if body.frame <= len(arm.links))


def _differ(values: Both, tolerance: float) -> bool:
    first, other = values
    if first is None or other is None:
        return first is not other
    return abs(first - other) > tolerance


def _words(what: str, unit: str, si: float, values: Both, names: tuple[str, str]) -> str:
    said = [
        f"{'missing' if value is None else f'{value / si:g} {unit}'} in {name}"
        for value, name in zip(values, names, strict=True)
    ]
    return f"{what} is {said[0]}, {said[1]}"
