"""The kinematic chain as a product of one-parameter motions ("slots").

Base: T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma). Link i: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Tz(extra z) (modified DH,
thesis section 4.1), then the bending of link i about x and y at its middle. Tool: Rx Ry Rz T(x, y, z).

Where consecutive axes are (nearly) parallel, Ry(beta) follows Rx(alpha): four numbers do not describe every small
deviation of such axes, whose common normal jumps far along them (Hayati & Mirmirani 1985).

A joint without a motor (`mimicK`) turns by its own amount and a multiple of that of the joint it follows. Amounts of
slots are always their own; `driven` adds what following joints are turned by, so that a motion of the other moves both.

Effects add amounts (rad or m) to slots. A slot's amount is a float where it is the same for all poses, or an array
`(N,)`; the same code serves both, so one pose costs scalar Python and a batch numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, MimicJoint, Placement
from lrm_math.arrays import ORIGIN, Array, Vector3

Number: TypeAlias = "float | Array"
Vector: TypeAlias = "list[Number]"
Angle: TypeAlias = "tuple[Number, Number] | None"
"""(cos, sin) of a rotation; None for a translation or a rotation by zero."""

X, Y, Z = 0, 1, 2
ROUND_OFF = 1e-15
PLANE = ((Y, Z), (Z, X), (X, Y))  # the two axes that a rotation about x, y, z mixes
INVERSE = ((Z, Y), (X, Z), (Y, X))  # and its inverse


@dataclass(frozen=True)
class Slot:
    """One elementary motion of the chain: a rotation (rad) or a translation (m) along one axis.

    `joint` is the number from 0 of the joint angle that drives it, or None.
    """

    place: str
    name: str
    rotates: bool
    axis: int
    nominal: float
    joint: int | None = None

    @property
    def key(self) -> str:
        """`place.name`, for instance `joint2.theta`."""
        return f"{self.place}.{self.name}"

    @cached_property
    def to_hinge(self) -> bool:
        """Whether it is a translation to the hinge at the middle of a link, or back."""
        return self.place.startswith("link") and not self.rotates


@dataclass(frozen=True)
class AttachedBody:
    """A body fixed to the frame before slot number `before`; `mass` in kg, centre of mass `com` (m) in that frame.

    `load_at`: from `com` to the centre of the load that it carries (m).
    """

    before: int
    mass: float
    com: Vector3
    carries_payload: bool
    load_at: Vector3 = ORIGIN


@dataclass(frozen=True, eq=False)
class Chain:
    """All slots from base to TCP and the bodies between them, ordered outwards.

    `moved[k]`: the first body that slot k moves. `counted[k]`: the first body that the load of slot k includes; the two
    differ only for arms whose file says that a body loads a joint that does not carry it. `index`: number of a slot by
    its key. `frame_ends`: number of slots before the frames base, after link 1 … L, tool. `couplings`: of each joint
    that follows another one its slot, that of the other joint, and how far it turns for each rad of that one.
    """

    dof: int
    gravity: Vector3
    slots: tuple[Slot, ...]
    index: dict[str, int]
    bodies: tuple[AttachedBody, ...]
    moved: tuple[int, ...]
    counted: tuple[int, ...]
    frame_ends: tuple[int, ...]
    joint_slots: tuple[int, ...]
    couplings: tuple[tuple[int, int, float], ...] = ()

    def values(self, q: Sequence[Number]) -> list[Number]:
        """Amount of every slot of the nominal arm at joint angles q, one float or `(N,)` per joint (rad).

        The translations to the middle of a link and from it (`back`, `on`) cancel as long as it does not bend, and are
        left out; `hinges` gives them.
        """
        return [
            (0.0 if slot.to_hinge else slot.nominal) + (0.0 if slot.joint is None else q[slot.joint])
            for slot in self.slots
        ]

    def driven(self, values: Sequence[Number]) -> Sequence[Number]:
        """Amounts by which the slots move in all, from their own: a following joint turns with the one it follows."""
        if not self.couplings:
            return values
        out = list(values)
        for k, leader, ratio in self.couplings:
            out[k] = values[k] + ratio * values[leader]
        return out

    @cached_property
    def turning_slots(self) -> tuple[int, ...]:
        """Turns of all joints from base to tool, those without a motor included."""
        return tuple(sorted({*self.joint_slots, *(k for k, _, _ in self.couplings)}))

    @cached_property
    def turns(self) -> Array:
        """(L, n), C: how far each joint of the chain turns for each rad of the joints with a motor."""
        row = {k: i for i, k in enumerate(self.turning_slots)}
        out = np.zeros((len(row), self.dof))
        out[[row[k] for k in self.joint_slots], range(self.dof)] = 1.0
        for k, leader, ratio in self.couplings:
            out[row[k]] = ratio * out[row[leader]]
        return out

    @cached_property
    def rotates(self) -> NDArray[np.bool_]:
        """(S,), whether each slot is a rotation."""
        return np.array([slot.rotates for slot in self.slots])

    @cached_property
    def hinges(self) -> dict[str, tuple[tuple[int, float], ...]]:
        """Slots of each link that translate to its hinge and back, and their amounts (m)."""
        out: dict[str, tuple[tuple[int, float], ...]] = {}
        for k, slot in enumerate(self.slots):
            if slot.to_hinge:
                out[slot.place] = (*out.get(slot.place, ()), (k, slot.nominal))
        return out

    @cached_property
    def length(self) -> float:
        """m, the sum of all dimensions from the first joint to the TCP, an upper bound of the reach."""
        return sum(abs(s.nominal) for s in self.slots if not s.rotates and not s.place.startswith(("base", "link")))


@lru_cache(maxsize=64)
def chain_of(arm: Arm, bends_at_ends: frozenset[str] = frozenset()) -> Chain:
    """The chain of an arm; links of `bends_at_ends` have hinges at both ends too, beside that at their middle."""
    shifts, turns = _placement_slots(BASE, arm.base)
    slots = [*shifts, *turns]
    frame_ends = [len(slots)]
    chain_order, last = arm.chain_order, len(arm.links) - 1
    for i, (place, link, mimic) in enumerate(chain_order):
        slots += _link_slots(place, link, _nominal_angle(arm, link, mimic), _motor_of(arm, place), i == last)
        frame_ends.append(len(slots))
        if i < last:
            slots += _bending_slots(link, f"link{i + 1}", f"link{i + 1}" in bends_at_ends)
    shifts, turns = _placement_slots(TOOL, arm.tool)
    slots += [*turns, *shifts]
    frame_ends.append(len(slots))
    bodies = arm.bodies_outwards
    attachments = [
        AttachedBody(frame_ends[b.frame] - (1 if b.near_end else 0), b.mass, b.com, b.carries_payload, b.load_at)
        for b in bodies
    ]
    moved = [sum(b.before <= k for b in attachments) for k in range(len(slots))]
    numbers = {place: number for number, place in enumerate(arm.link_places, start=1)}
    loads = [_first_joint_loaded(slot, numbers) for slot in slots]
    index = {slot.key: k for k, slot in enumerate(slots)}
    led = [(place, mimic) for place, _, mimic in chain_order if mimic is not None]
    counted = [
        min(moved[k], sum(b.loads_joint < joint for b in bodies)) if joint else moved[k]
        for k, joint in enumerate(loads)
    ]
    return Chain(
        dof=arm.dof,
        gravity=arm.gravity,
        slots=tuple(slots),
        index=index,
        bodies=tuple(attachments),
        moved=tuple(moved),
        counted=tuple(counted),
        frame_ends=tuple(frame_ends),
        joint_slots=tuple(k for k, slot in enumerate(slots) if slot.joint is not None),
        couplings=tuple(
            (index[f"{place}.theta"], index[f"joint{mimic.leader + 1}.theta"], mimic.ratio) for place, mimic in led
        ),
    )


def _motor_of(arm: Arm, place: str) -> int | None:
    """Number from 0 of the joint angle that drives the joint at a place; None: it has no motor."""
    return arm.joint_names.index(place) if place in arm.joint_names else None


def _nominal_angle(arm: Arm, link: Joint, mimic: MimicJoint | None) -> float:
    """Own amount of a joint's turn at zero (rad): of a mimic joint less what the theta of the other one turns it by."""
    return link.theta if mimic is None else link.theta + mimic.offset - mimic.ratio * arm.joints[mimic.leader].theta


def _first_joint_loaded(slot: Slot, numbers: dict[str, int]) -> int | None:
    """First joint whose bodies load a slot: its joint, along or about its axis, the next one of a link; else None.

    `numbers`: of each joint's place, from 1 along the chain.
    """
    if slot.place in numbers and slot.name in ("theta", "d"):
        return numbers[slot.place]
    if slot.place.startswith("link"):
        return min(int(slot.place.removeprefix("link")) + 1, len(numbers))
    return None


def _placement_slots(place: str, p: Placement) -> tuple[list[Slot], list[Slot]]:
    """Translations of a place, and its rotations."""
    shifts = [Slot(place, name, False, axis, getattr(p, name)) for axis, name in enumerate(("x", "y", "z"))]
    turns = [Slot(place, name, True, axis, getattr(p, name)) for axis, name in enumerate(("alpha", "beta", "gamma"))]
    return shifts, turns


def _link_slots(place: str, joint: Joint, theta: float, motor: int | None, last: bool) -> Iterable[Slot]:
    yield Slot(place, "theta", True, Z, theta, joint=motor)
    yield Slot(place, "d", False, Z, joint.d)
    yield Slot(place, "a", False, X, joint.a)
    yield Slot(place, "alpha", True, X, joint.alpha)
    if joint.leads_parallel and not last:
        yield Slot(place, "beta", True, Y, joint.beta)
    if joint.extra_z is not None:
        yield Slot(place, "extra_z", False, Z, joint.extra_z)


def _bending_slots(joint: Joint, place: str, at_ends: bool) -> Iterable[Slot]:
    """Rotations about x and y of the link's far frame, at the link's middle: the pseudo-rigid-body hinge of a beam.

    A cantilever under a moment at its end turns by M L/EI and shifts by M L²/2EI: a hinge at half its length.
    """
    half = [(axis, length) for axis, length in enumerate(_half_length(joint)) if length]
    back = [Slot(place, f"back_{'xyz'[axis]}", False, axis, -length) for axis, length in half]
    middle = [Slot(place, name, True, axis, 0.0) for name, axis in (("x", X), ("y", Y))]
    on = [Slot(place, f"on_{'xyz'[axis]}", False, axis, length) for axis, length in half]
    if not at_ends:
        yield from (*back, *middle, *on)
        return
    near, far = ([replace(slot, name=f"{end}_{slot.name}") for slot in middle] for end in ("near", "far"))
    inner = [[replace(slot, name=f"near_{slot.name}") for slot in part] for part in (back, on)]
    yield from (*back, *inner[0], *near, *inner[1], *middle, *on, *far)


def _half_length(joint: Joint) -> list[float]:
    """Half the translation from a joint to its link's far frame, in that frame (m); below a nanometre it is zero."""
    c, s = math.cos(joint.alpha), math.sin(joint.alpha)
    x, y, z = joint.a, s * joint.d, c * joint.d
    if joint.beta:
        cb, sb = math.cos(joint.beta), math.sin(joint.beta)
        x, z = cb * x - sb * z, sb * x + cb * z
    translation = (x, y, z + (joint.extra_z or 0.0))
    return [0.5 * component if abs(component) > 1e-9 else 0.0 for component in translation]


def is_zero(value: Number) -> bool:
    """Whether an amount is zero for all poses."""
    return isinstance(value, float) and value == 0.0


def trig(chain: Chain, values: Sequence[Number]) -> list[Angle]:
    """(cos, sin) of every rotating slot's turn by own amounts; None for translations and for rotations by zero."""
    turns = chain.driven(values)
    return [trig_of(value) if slot.rotates else None for slot, value in zip(chain.slots, turns, strict=True)]


def trig_of(value: Number) -> Angle:
    """(cos, sin) of one angle, None for zero; a right angle for all poses has cosine zero exactly, which saves work."""
    if isinstance(value, float):
        if value == 0.0:
            return None
        c, s = math.cos(value), math.sin(value)
        return (0.0, math.copysign(1.0, s)) if abs(c) < ROUND_OFF else (c, s)
    return np.cos(value), np.sin(value)


def pull_back(chain: Chain, values: Sequence[Number], angles: Sequence[Angle]) -> Vector:
    """TCP position: the tip's origin transformed inwards, three numbers (m)."""
    p: Vector = [0.0, 0.0, 0.0]
    for k in range(len(chain.slots) - 1, -1, -1):
        slot = chain.slots[k]
        if slot.rotates:
            rotate(p, PLANE[slot.axis], angles[k])
        elif not is_zero(values[k]):
            p[slot.axis] = p[slot.axis] + values[k]
    return p


def rotate(v: Vector, plane: tuple[int, int], angle: Angle) -> None:
    """Rotates three components in place, v <- R(axis, angle) v in `PLANE[axis]`; in `INVERSE[axis]` by R transposed."""
    if angle is not None:
        c, s = angle
        i, j = plane
        if is_zero(c):
            v[i], v[j] = -s * v[j], s * v[i]
        else:
            v[i], v[j] = c * v[i] - s * v[j], s * v[i] + c * v[j]


def rotation_about(axis: int, angle: float) -> Array:
    """(3, 3), rotation by an angle (rad) about the axis x, y or z (0, 1, 2)."""
    out, (i, j) = np.eye(3), PLANE[axis]
    out[i, i] = out[j, j] = np.cos(angle)
    out[j, i] = np.sin(angle)
    out[i, j] = -out[j, i]
    return out
