"""Robot descriptions in URDF, read strictly: links, joints, one chain from a base to a tip, and its own kinematics."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.rigid_motion import from_xyz_rpy, shift, to_xyz_rpy, turn
from lrm_ident.data.robot_files.xacro_file import SHAPES, expanded, to_expand
from lrm_ident.data.robot_files.xml_text import parse_xml, read_xml_text
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import FileError, name_suggestion

TURNING = ("revolute", "continuous")
MOMENTS = "ixx", "iyy", "izz", "ixy", "ixz", "iyz"
POLYNOMIAL = "polycoef"
"""Attribute of a `<mimic>` of MuJoCo's that is not linear."""
ENDS = "--tip {} ends before it"
TURNS_ALONE = "an arm's joint turns by itself, or with one that does in proportion; " + ENDS
RING = "follows itself", "a joint follows another one"
GRAVITY: Vector3 = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class UrdfMimic:
    """`<mimic>` of a joint: its angle is `ratio` times that of the joint `leader`, and `offset` (rad)."""

    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """One `<joint>`: its `origin` (4, 4) in the parent link's frame (m), unit `axis` in its own; limits in rad.

    `effort`: the torque that it may exert (N·m); 0 where none is stated.
    `fault`: what keeps it from being a joint of an arm, and what would be right; beside the arm it may stand.
    `mimic`: how it follows a joint that follows none itself; None: it does not.
    `rest_angle`: the angle within its limits that is nearest to zero, or that of a following joint then (rad).
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Vector3
    lower: float
    upper: float
    effort: float = 0.0
    fault: tuple[str, str] | None = None
    mimic: UrdfMimic | None = None
    rest_angle: float = 0.0

    @property
    def turns(self) -> bool:
        """Whether it is a revolute joint."""
        return self.kind in TURNING

    def motion(self, q: float) -> Array:
        """(4, 4), pose of the child link in the parent's at an angle (rad); a joint that does not turn stands still."""
        return self.origin @ turn(self.axis, q) if self.turns else self.origin

    @property
    def commanded(self) -> bool:
        """Whether it is a revolute joint that follows no other one."""
        return self.turns and self.mimic is None


@dataclass(frozen=True)
class UrdfMass:
    """`<inertial>` of a link: mass (kg) and centre of mass in the link's frame (m).

    `density`: of the box that has its moments of inertia (kg/m³); 0 where none has.
    """

    mass: float
    com: Vector3
    density: float = 0.0


@dataclass(frozen=True, eq=False)
class Urdf:
    """A robot: its links (None: without mass), and for each child link the joint that carries it.

    `gravity`: in the frame of its root link (m/s²); a URDF stands upright on that.
    `notices`: what was wrong with its file and is overlooked. `unweighed`: links without a known mass, in words.
    """

    path: Path
    name: str
    links: dict[str, UrdfMass | None]
    joints: dict[str, UrdfJoint]
    tree: ElementTree.Element
    gravity: Vector3 = GRAVITY
    notices: tuple[str, ...] = ()
    unweighed: str = ""

    @property
    def root(self) -> str:
        """The link that no joint carries."""
        return next(link for link in self.links if link not in self.joints)

    @property
    def tips(self) -> list[str]:
        """Links that carry no other link."""
        parents = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in parents]

    def chain(self, base: str, tip: str) -> list[UrdfJoint]:
        """The joints from one link out to another. Raises `FileError`: no such link, or the tip is not carried."""
        for link in (base, tip):
            if link not in self.links:
                raise FileError(self.path, "", f"no link '{link}'", name_suggestion(link, list(self.links)))
        out: list[UrdfJoint] = []
        link = tip
        while link != base:
            if link not in self.joints or len(out) > len(self.joints):
                raise FileError(self.path, "", f"'{base}' does not carry '{tip}'", f"the root is '{self.root}'")
            out.insert(0, self.joints[link])
            link = out[0].parent
        return out

    def standing(self, link: str) -> Array:
        """(4, 4), pose of a link in the root link, joints between at the angle nearest to zero. Raises `FileError`."""
        path = self.chain(self.root, link)
        return tip_pose(path, [joint.rest_angle for joint in path if joint.turns])

    def carried_by(self, link: str, without: str) -> Iterator[tuple[str, Array]]:
        """The link and what it carries but for the branch that begins with the link `without`, and where (4, 4).

        Joints of such branches stand at the angle nearest to zero.
        """
        yield link, np.eye(4)
        for child, joint in self.joints.items():
            if joint.parent == link and child != without:
                start = joint.motion(joint.rest_angle)
                yield from ((name, start @ pose) for name, pose in self.carried_by(child, without))


def with_followers(chain: Sequence[UrdfJoint], q: Sequence[float]) -> list[float]:
    """Angles of all turning joints of a chain, from those of its commanded ones (rad)."""
    commanded = dict(zip((joint.name for joint in chain if joint.commanded), q, strict=True))
    return [
        commanded[joint.name]
        if joint.mimic is None
        else joint.mimic.ratio * commanded[joint.mimic.leader] + joint.mimic.offset
        for joint in chain
        if joint.turns
    ]


def tip_pose(chain: Sequence[UrdfJoint], q: Sequence[float]) -> Array:
    """(4, 4), pose of a chain's tip in its base link, angles of its turning joints in rad: URDF's own kinematics."""
    angles = iter(q)
    pose = np.eye(4)
    for joint in chain:
        pose = pose @ joint.motion(next(angles) if joint.turns else 0.0)
    return pose


def read_urdf(path: Path, arguments: Mapping[str, str] | None = None) -> Urdf:
    """Reads the links, joints and masses of a URDF or a xacro file; what else xacro refers to need not exist.

    `arguments`: of xacro, by name. Raises `FileError`; where there is xacro to expand, the package `xacrodoc` does it.
    """
    return _read(path, SHAPES, arguments or {})


def read_whole_urdf(path: Path) -> Urdf:
    """Reads a URDF or a xacro file with all that it has, to be written again. Raises `FileError`."""
    return _read(path, (), {})


def _read(path: Path, without: Collection[str], arguments: Mapping[str, str]) -> Urdf:
    file = read_xml_text(path)
    tree = parse_xml(path, file.text)
    robot = urdf_of(path, expanded(path, tree, without, arguments) if to_expand(tree) else tree)
    return replace(robot, notices=(*file.notices, *robot.notices))


def parse_urdf(path: Path, text: str) -> Urdf:
    """The robot that the text of a URDF describes; errors name `path`. Raises `FileError`."""
    return urdf_of(path, parse_xml(path, text))


def urdf_of(path: Path, tree: ElementTree.Element) -> Urdf:
    """The robot that the tree of a URDF describes; errors name `path`. Raises `FileError`."""
    if tree.tag != "robot":
        raise FileError(path, "", f"the first element is <{tree.tag}>", "a URDF begins with <robot>")
    elements = tree.findall("link")
    links = {_named(path, link): _mass(path, link) for link in elements}
    if not links:
        raise FileError(path, "", "has no <link>", _where_links_are(tree))
    if len(links) < len(elements):
        names = [_named(path, link) for link in elements]
        twice = next(name for name in names if names.count(name) > 1)
        raise FileError(path, "", f"two links of one name: {twice}")
    joints: dict[str, UrdfJoint] = {}
    for element in tree.findall("joint"):
        joint = _joint(path, element)
        for link in (joint.parent, joint.child):
            if link not in links:
                raise FileError(path, f"joint {joint.name}", f"no link '{link}'", name_suggestion(link, list(links)))
        if joint.child in joints:
            what = f"link '{joint.child}' hangs on joint '{joints[joint.child].name}' too"
            raise FileError(path, f"joint {joint.name}", what, "a link has one parent")
        if joint.name in {other.name for other in joints.values()}:
            raise FileError(path, "", f"two joints of one name: {joint.name}")
        joints[joint.child] = joint
    joints = _resolved(joints)
    parents = {joint.parent for joint in joints.values()}
    loose = [link for link in links if joints and link not in joints and link not in parents]
    notices = [f"link '{link}' hangs on no joint and carries none: it is not read" for link in loose]
    shaped = {_named(path, link) for link in elements if link.find("visual") is not None} & {*joints}
    if any(mass is not None for mass in links.values()):
        weightless = (link for link in sorted(shaped) if links[link] is None)
        notices += [f"link '{link}' has a shape and no mass: it counts as weightless" for link in weightless]
    links = {link: mass for link, mass in links.items() if link not in loose}
    robot = Urdf(path, tree.get("name") or path.stem, links, joints, tree, notices=tuple(notices))
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        raise FileError(path, "", f"{len(roots)} links have no parent: {', '.join(roots) or 'it is a ring'}", "one has")
    return robot


def _where_links_are(tree: ElementTree.Element) -> str:
    macros = [element.get("name") for element in tree.iter() if element.tag == "xacro:macro"]
    return (
        f"it defines the xacro macro {macros[0]}: import the file that calls it" if macros else "is it a robot's file?"
    )


def _resolved(joints: dict[str, UrdfJoint]) -> dict[str, UrdfJoint]:
    """The joints, each follower of a follower as one of the joint that leads both; what cannot be has a fault."""
    by_name = {joint.name: joint for joint in joints.values()}

    def resolved(joint: UrdfJoint) -> UrdfJoint:
        """One joint, as a follower of its last leader."""
        ratio, offset, leader = 1.0, 0.0, joint
        for _ in joints:
            if leader.mimic is None or leader.fault is not None:
                break
            ratio, offset = ratio * leader.mimic.ratio, ratio * leader.mimic.offset + offset
            name = leader.mimic.leader
            if name not in by_name:
                return replace(joint, fault=(f"follows joint {name}, which is none", name_suggestion(name, [*by_name])))
            leader = by_name[name]
        if leader is joint:
            return joint if joint.mimic is None else replace(joint, fault=joint.fault or RING)
        if leader.mimic is not None or not leader.turns:
            what = "follows others in a ring" if leader.fault is None else leader.fault[0]
            kind = f"is {leader.kind or 'of no type'}" if leader.mimic is None else what
            return replace(
                joint, fault=(f"follows joint {leader.name}, which {kind}", TURNS_ALONE.format(joint.parent))
            )
        rest = ratio * leader.rest_angle + offset
        return replace(joint, mimic=UrdfMimic(leader.name, ratio, offset), rest_angle=rest)

    return {child: resolved(joint) if joint.turns else joint for child, joint in joints.items()}


def _named(path: Path, element: ElementTree.Element) -> str:
    name = element.get("name")
    if not name:
        raise FileError(path, "", f"a <{element.tag}> without a name")
    return name


def _mass(path: Path, link: ElementTree.Element) -> UrdfMass | None:
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return None
    where = f"link {link.get('name')}"
    (value,) = _numbers(path, where, mass, "value", "", 1)
    if value < 0.0:
        raise FileError(path, where, f"mass {value:g} kg", "a mass is not negative")
    x, y, z = _origin(path, where, inertial)[:3, 3].tolist()
    return UrdfMass(value, (x, y, z), _density(value, inertial.find("inertia"))) if value > 0.0 else None


def _density(mass: float, inertia: ElementTree.Element | None) -> float:
    """Density of the box with a link's mass and moments of inertia (kg/m³); 0: they are none of a body."""
    try:
        xx, yy, zz, xy, xz, yz = (float("0" if inertia is None else inertia.get(name, "0")) for name in MOMENTS)
    except ValueError:
        return 0.0
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    squares = 6.0 / mass * (moments.sum() - 2.0 * moments)
    return mass / math.sqrt(squares.prod()) if squares.min() > 0.0 else 0.0


def _joint(path: Path, element: ElementTree.Element) -> UrdfJoint:
    name, kind = _named(path, element), element.get("type") or ""
    where = f"joint {name}"
    ends = [element.find(end) for end in ("parent", "child")]
    parent, child = ("" if end is None else end.get("link") or "" for end in ends)
    if not (parent and child):
        raise FileError(path, where, "names no parent and child link")
    axis = np.array(_numbers(path, where, element.find("axis"), "xyz", "1 0 0", 3))
    length = float(np.linalg.norm(axis))
    x, y, z = (axis / (length or 1.0)).tolist()
    limit, low, high = element.find("limit"), -2.0 * math.pi, 2.0 * math.pi
    if kind == "revolute":
        (low,), (high,) = (_numbers(path, where, limit, side, "0", 1) for side in ("lower", "upper"))
    (effort,) = _numbers(path, where, limit, "effort", "0", 1)
    joint = UrdfJoint(name, kind, parent, child, _origin(path, where, element), (x, y, z), low, high, effort)
    if not joint.turns:
        return joint
    joint = replace(joint, mimic=_mimic(path, where, element), rest_angle=min(max(0.0, low), high))
    return replace(joint, fault=_fault(element, joint, length))


def _fault(element: ElementTree.Element, joint: UrdfJoint, length: float) -> tuple[str, str] | None:
    mimic, count = element.find("mimic"), len(element.findall("mimic"))
    if count > 1:
        return f"follows {count} joints at once", TURNS_ALONE.format(joint.parent)
    if mimic is not None and POLYNOMIAL in mimic.attrib:
        what = f"follows joint {mimic.get('joint')} by a polynomial ({mimic.get(POLYNOMIAL)})"
        return what, TURNS_ALONE.format(joint.parent)
    if mimic is not None and mimic.get("joint") is None:
        degrees = math.degrees(float(mimic.get("offset", "0")))
        return f"is held at {degrees:.3g} deg", f"a joint that does not turn is fixed; {ENDS.format(joint.parent)}"
    if mimic is not None:
        return None if length >= 1e-9 else ("its axis has no direction", "")
    if joint.kind == "revolute" and element.find("limit") is None:
        return "a revolute joint without <limit>", "or is it of type continuous?"
    if length < 1e-9:
        return "its axis has no direction", ""
    return None if joint.lower < joint.upper else (f"limits {joint.lower:g} to {joint.upper:g} rad", "lower < upper")


def _mimic(path: Path, where: str, element: ElementTree.Element) -> UrdfMimic | None:
    """How a joint follows another one, as its `<mimic>` states it."""
    mimic = element.find("mimic")
    if mimic is None:
        return None
    (ratio,), (offset,) = (
        _numbers(path, where, mimic, key, default, 1) for key, default in (("multiplier", "1"), ("offset", "0"))
    )
    return UrdfMimic(mimic.get("joint") or "", ratio, offset)


def _origin(path: Path, where: str, element: ElementTree.Element) -> Array:
    origin = element.find("origin")
    xyz, rpy = (_numbers(path, where, origin, name, "0 0 0", 3) for name in ("xyz", "rpy"))
    return from_xyz_rpy(xyz, rpy) if any(rpy) else shift(xyz)


def _numbers(
    path: Path, where: str, element: ElementTree.Element | None, name: str, default: str, count: int
) -> list[float]:
    text = default if element is None else element.get(name, default)
    try:
        values: list[Any] = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise FileError(path, where, f'{name}="{text}"', f"should be {count} number{'s' * (count > 1)}")
    return values


def numbers(values: Iterable[float]) -> str:
    """Numbers by spaces, exact to round-off."""
    return " ".join(repr(float(value)) for value in values)


def append_joint(
    tree: ElementTree.Element, name: str, kind: str, parent: str, child: str, origin: Array
) -> ElementTree.Element:
    """A `<joint>` more of a URDF, at `origin` (4, 4) in its parent link (m)."""
    element = ElementTree.SubElement(tree, "joint", name=name, type=kind)
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)
    set_origin(element, origin)
    return element


def set_origin(element: ElementTree.Element, T: Array) -> None:
    """Gives an element an `<origin>` (4, 4), m, or changes the one that it has."""
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.Element("origin")
        element.insert(0, origin)
    for name, values in zip(("xyz", "rpy"), to_xyz_rpy(T), strict=True):
        origin.set(name, numbers(values))
