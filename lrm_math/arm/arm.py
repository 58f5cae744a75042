"""The description of a serial arm with revolute joints: geometry, masses, limits. Frozen values in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from lrm_math.arm.collision_shapes import Shapes
from lrm_math.arm.servo_table import ServoTable
from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import ORIGIN, Array, Vector3
from lrm_math.errors import LrmError

BASE = "base"
TOOL = "tool"
MOST_JOINTS = 16
"""Most joints of an arm, those without a motor included: as many as the kernel of inverse kinematics has room for."""
AT_LIMIT = math.radians(1e-6)
ROUND_OFF = 1e-9
"""rad: by which limits of two joints agree."""
NEARLY_PARALLEL = 0.1
"""Sine of the angle between axes that errors of assembly (0.05 rad at either end) can make parallel."""


@dataclass(frozen=True)
class Placement:
    """A fixed pose of six numbers: translation x, y, z (m) and rotations alpha (x), beta (y), gamma (z) in rad."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0
    gamma: float = 0.0


@dataclass(frozen=True)
class Joint:
    """One link of the modified DH chain: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Tz(extra_z); rad and m (thesis Table 4.1).

    `extra_z` is None where the link has no such translation, so that it has no such parameter either. `beta`: Hayati's
    angle, Ry(beta) after Rx(alpha), where two axes are drawn nearly parallel. `name`: as in the robot's description.
    """

    theta: float
    d: float
    a: float
    alpha: float
    extra_z: float | None
    lower: float
    upper: float
    servo: ServoTable | None = None
    beta: float = 0.0
    name: str = ""

    @property
    def leads_parallel(self) -> bool:
        """Whether its axis and the next one are so close to parallel that the link has an angle beta."""
        return abs(math.sin(self.alpha)) < NEARLY_PARALLEL


@dataclass(frozen=True)
class MimicJoint:
    """A joint of the chain without a motor of its own: its angle is `ratio` times that of another joint, and `offset`.

    Attributes:
        link: its link, whose limits are not used: those of the joint that it follows hold for both.
        after: number of joints with a motor that stand before it in the chain.
        leader: number from 0 of the joint that it follows. offset: rad.
    """

    link: Joint
    after: int
    leader: int
    ratio: float
    offset: float = 0.0


@dataclass(frozen=True)
class Body:
    """A rigid body whose weight loads the joints.

    `frame`: the number of the frame it is fixed to (0 base, i after link i of L, L + 1 tool). `com`: its centre of mass
    there (m); with `near_end` it is given before the last translation along z of that frame.
    `loads_joint`: the first joint whose torque counts it (1 to L, those without a motor included).
    `load_at`: from `com` to the centre of the load that it carries, along the axes of its frame (m).
    """

    name: str
    mass: float
    com: Vector3
    frame: int
    loads_joint: int
    near_end: bool = False
    carries_payload: bool = False
    load_at: Vector3 = ORIGIN


@dataclass(frozen=True)
class TypicalSizes:
    """How far an arm of its make usually is from its drawing; by default one of printed parts on RC servos.

    Attributes:
        length, angle: errors of links and tool (m, rad). compliance: of joints (rad/(N·m)).
    """

    length: float = 0.005
    angle: float = 0.05
    compliance: float = 0.1


@dataclass(frozen=True)
class Arm:
    """A serial arm. `gravity` (m/s²) is given in the frame that TCP positions are measured in.

    `joints`: those with a motor, whose angles are commanded. `mimics`: those between them that follow one of these.
    `accepted`: rules of plausibility that a person knows this arm to break. `vehicle`: what it stands on, if that may
    tip over. `table`: z (m) of the plane that it stands on.
    """

    name: str
    gravity: Vector3
    base: Placement
    joints: tuple[Joint, ...]
    tool: Placement
    bodies: tuple[Body, ...]
    auxiliary_servos: tuple[tuple[str, ServoTable], ...] = ()
    shapes: Shapes = field(default_factory=Shapes)
    typical_sizes: TypicalSizes = TypicalSizes()
    accepted: tuple[str, ...] = ()
    mimics: tuple[MimicJoint, ...] = ()
    vehicle: Vehicle | None = None
    table: float | None = None

    def __post_init__(self) -> None:
        for number, mimic in enumerate(self.mimics, start=1):
            if not (0 <= mimic.leader < self.dof and 0 <= mimic.after <= self.dof and math.isfinite(mimic.ratio)):
                raise LrmError(f"mimic{number} follows joint {mimic.leader + 1}; this arm has joints 1 to {self.dof}")
        for fault in contradictions(self.links, self.bodies):
            raise LrmError(fault)
        last = len(self.links) + 1
        for capsule in self.shapes.capsules:
            if not 0 <= capsule.frame <= last:
                raise LrmError(f"capsule '{capsule.name}' stands in frame {capsule.frame}, not in 0 to {last}")

    def __hash__(self) -> int:
        """Computed once: effects and chains are looked up by their arm many times per fit."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, each.name) for each in fields(self)))

    def __getstate__(self) -> dict[str, object]:
        """The arm alone: hashes of texts differ between processes."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def __repr__(self) -> str:
        names = ", ".join(joint.name for joint in self.joints if joint.name)
        return f"<Arm {self.name}: {self.dof} joints{f' ({names})' if names else ''}>"

    @property
    def dof(self) -> int:
        """Number of joints n that have a motor."""
        return len(self.joints)

    @property
    def chain_order(self) -> tuple[tuple[str, Joint, MimicJoint | None], ...]:
        """Every joint from base to tool: its place (`joint1` … or, without a motor, `mimic1` …), link, and coupling."""
        out: list[tuple[str, Joint, MimicJoint | None]] = []
        for i in range(self.dof + 1):
            out += [(f"mimic{k}", m.link, m) for k, m in enumerate(self.mimics, start=1) if m.after == i]
            out += [
                (name, joint, None) for name, joint in zip(self.joint_names[i:], self.joints[i : i + 1], strict=False)
            ]
        return tuple(out)

    @property
    def links(self) -> tuple[Joint, ...]:
        """The L links of the chain, one for each joint, with a motor or without."""
        return tuple(link for _, link, _ in self.chain_order) if self.mimics else self.joints

    @property
    def link_places(self) -> tuple[str, ...]:
        """Place of each link: joint1 … jointN and, where a joint has no motor, mimic1 …"""
        return tuple(place for place, _, _ in self.chain_order) if self.mimics else self.joint_names

    @property
    def frame_names(self) -> tuple[str, ...]:
        """base, the places of the links, tool: names of the frames that bodies are fixed to."""
        return (BASE, *self.link_places, TOOL)

    @property
    def bodies_outwards(self) -> tuple[Body, ...]:
        """The bodies, ordered from base to tool."""
        return outwards(self.bodies)

    @property
    def carries_on_tool(self) -> bool:
        """Whether a load is carried by the tool alone."""
        frames = {body.frame for body in self.bodies if body.carries_payload}
        return frames == {len(self.links) + 1}

    def with_load_at(self, centre: Vector3) -> Arm:
        """The arm whose load has its centre elsewhere than its file says: `centre` is the shift along the tool's axes
        (m). Raises `LrmError`: no body on the tool carries a load."""
        if any(centre) and not self.carries_on_tool:
            raise LrmError(f"{self.name}: no body on the tool carries the load, so the load's centre cannot be shifted")
        moved = (replace(body, load_at=centre) if body.carries_payload else body for body in self.bodies)
        return replace(self, bodies=tuple(moved))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """joint1 … jointN."""
        return tuple(f"joint{i + 1}" for i in range(self.dof))


def link_places(follows: Sequence[bool]) -> tuple[str, ...]:
    """Places of the joints of a chain, joint1 … and mimic1 …, of which some follow others."""
    places, count = [], {True: 0, False: 0}
    for joint in follows:
        count[joint] += 1
        places.append(f"{'mimic' if joint else 'joint'}{count[joint]}")
    return tuple(places)


def within_mimics(joints: Sequence[Joint], mimics: Sequence[MimicJoint]) -> tuple[Joint, ...]:
    """Joints with a motor whose limits keep those that follow them within theirs, too. Raises `LrmError`: none does.

    A range of a whole turn limits nothing, wherever it begins: palletisers' files state 0 to 360° where −90° is meant.
    """
    out = list(joints)
    for mimic in mimics:
        leader_link, link = out[mimic.leader], mimic.link
        if not mimic.ratio or link.upper - link.lower > 2.0 * math.pi - ROUND_OFF:
            continue
        low, high = sorted((limit - mimic.offset) / mimic.ratio for limit in (link.lower, link.upper))
        lower = low if low > leader_link.lower + ROUND_OFF else leader_link.lower
        upper = high if high < leader_link.upper - ROUND_OFF else leader_link.upper
        if not lower < upper:
            ends = (math.degrees(limit) for limit in (leader_link.lower, leader_link.upper, low, high))
            what = (
                "joint {}: its limits are {:.4g} to {:.4g} deg, those of a joint that follows it are {:.4g} to {:.4g}"
            )
            raise LrmError(f"{what.format(mimic.leader + 1, *ends)} deg of it; some angle should be within both")
        out[mimic.leader] = replace(leader_link, lower=lower, upper=upper)
    return tuple(out)


def outwards(bodies: Iterable[Body]) -> tuple[Body, ...]:
    """Bodies ordered from base to tool."""
    return tuple(sorted(bodies, key=lambda body: (body.frame, not body.near_end)))


def contradictions(joints: Sequence[Joint | None], bodies: Sequence[Body]) -> Iterator[str]:
    """Contradictions of bodies with the joints, or against each other; a joint that is not known is None."""
    n = len(joints)
    for number, link in enumerate(joints, start=1):
        if link is not None and link.beta and (number == n or not link.leads_parallel):
            yield f"joint {number}: beta_deg is for links whose two axes are nearly parallel"
    for body in bodies:
        lowest = max(1, min(body.frame, n))
        if not lowest <= body.loads_joint <= n:
            yield (
                f"body '{body.name}' moves with joint {lowest} but loads_joint is {body.loads_joint}; "
                f"it must be {lowest} to {n}"
            )
        joint = joints[body.frame - 1] if 0 < body.frame <= n else None
        if body.near_end and joint is not None and joint.extra_z is None:
            yield f"body '{body.name}': com_from near_end, but joint {body.frame} has no extra_z_mm"
        if body.near_end and body.frame == 0:
            yield f"body '{body.name}': com_from near_end has no meaning in the base frame"
    for before, after in pairwise(outwards(bodies)):
        if after.loads_joint < before.loads_joint:
            yield (
                f"body '{after.name}' stands beyond '{before.name}' but loads joint {after.loads_joint}, before "
                f"joint {before.loads_joint}; bodies further out must not load earlier joints only"
            )


@dataclass(frozen=True, slots=True)
class Violation:
    """The violated joint limit of the branch with the least excess: joint from 1, excess in rad."""

    joint: int
    excess: float

    def __str__(self) -> str:
        over = math.degrees(self.excess)
        return f"outside limits: joint {self.joint} would have to go {over:.2f} deg beyond its limit"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Joint limits (rad), one number per joint."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, arm: Arm) -> JointLimits:
        """Limits of an arm's joints."""
        return cls(tuple(j.lower for j in arm.joints), tuple(j.upper for j in arm.joints))

    @property
    def middle(self) -> tuple[float, ...]:
        """Middle of every joint's range (rad)."""
        return tuple(0.5 * (a + b) for a, b in zip(self.lower, self.upper, strict=True))

    def margins(self, q: Sequence[float]) -> tuple[float, ...]:
        """Distance of every joint to its nearer limit (rad); negative beyond it."""
        return tuple(min(x - a, b - x) for x, a, b in zip(q, self.lower, self.upper, strict=True))

    def clipped(self, q: Sequence[float]) -> tuple[float, ...]:
        """Angles moved to the limits that they are beyond."""
        return tuple([min(max(x, a), b) for x, a, b in zip(q, self.lower, self.upper, strict=True)])

    def violation(self, q: Sequence[float]) -> Violation:
        """The limit with the largest excess."""
        margins = self.margins(q)
        worst = min(range(len(margins)), key=margins.__getitem__)
        return Violation(worst + 1, -margins[worst])


def feasible_approach(arm: Arm, q: Array, side: Array) -> Array:
    """Directions of approach (N, n) to angles q (N, n), rad, requested as `side` (N, n): at a limit from within."""
    limits = JointLimits.of(arm)
    from_above = np.where(q <= np.array(limits.lower) + AT_LIMIT, -1.0, side)
    return np.where(q >= np.array(limits.upper) - AT_LIMIT, 1.0, from_above)


def checked_angles(name: str, q: Sequence[float], dof: int) -> tuple[float, ...]:
    """(n,), rad. Raises `LrmError` unless they are n finite angles."""
    angles = tuple(float(x) for x in q)
    if len(angles) != dof or not all(map(math.isfinite, angles)):
        raise LrmError(f"{name} = {list(q)}; should be {dof} finite joint angles in rad")
    return angles
