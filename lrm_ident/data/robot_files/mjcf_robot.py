"""A robot's own MJCF read by MuJoCo: as links and joints, like a URDF, and what it takes to write its frames back.

A link's frame stands on its joint's anchor with the joint at zero: MuJoCo's body frame may lie beside it, and its angle
zero elsewhere (`ref`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.rigid_motion import homogeneous, inverse, rotation_matrix, shift, turn
from lrm_ident.data.robot_files.urdf import POLYNOMIAL, Urdf, append_joint, numbers, read_urdf, urdf_of
from lrm_ident.data.robot_files.xml_text import parse_xml, read_xml_text
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

KINDS = ("floating", "ball", "prismatic", "revolute")
"""Types of joints, in MuJoCo's order."""
NO_MASS = 1e-12
"""kg, and kg·m²: what a body has whose mass is not known."""
MUJOCO_READS = ".xml", ".urdf"


@dataclass(frozen=True, eq=False)
class MjcfRobot:
    """A robot as MuJoCo has it: `spec` and `compiled` are MuJoCo's own; `unweighed`: bodies without a mass."""

    path: Path
    spec: Any
    compiled: Any
    unweighed: str = ""

    @cached_property
    def robot(self) -> Urdf:
        """Its links and joints. Raises `FileError`."""
        return _as_links(self)

    @cached_property
    def bodies(self) -> dict[str, int]:
        """The links that are bodies, all others are sites, and their numbers."""
        return {self.link(body): body for body in range(self.compiled.nbody)}

    def link(self, body: int) -> str:
        """The link that a body is."""
        return str(self.compiled.body(body).name or f"body{body}")

    @cached_property
    def _spec_bodies(self) -> dict[int, Any]:
        return {body.id: body for body in self.spec.bodies}

    def spec_body(self, link: str) -> Any:
        """The body as MuJoCo's `MjSpec` has it."""
        return self._spec_bodies[self.bodies[link]]

    def joints_of(self, body: int) -> range:
        """Numbers of the joints of a body, in the order in which they turn it."""
        first = int(self.compiled.body_jntadr[body])
        return range(first, first + int(self.compiled.body_jntnum[body]))

    def anchor(self, body: int) -> Array:
        """(4, 4), a link's frame in its body's: where its last joint is, none: the body's own."""
        joints = self.joints_of(body)
        return self.joint_anchor(joints[-1]) if joints else np.eye(4)

    def joint_anchor(self, joint: int) -> Array:
        """(4, 4), a joint's place in its body's frame."""
        return shift(self.compiled.jnt_pos[joint].tolist())

    def zero(self, body: int) -> Array:
        """(4, 4), turn of the last joint of a body from the angle that the file draws it at to zero."""
        joints = self.joints_of(body)
        return self.joint_zero(joints[-1]) if joints else np.eye(4)

    def joint_zero(self, joint: int) -> Array:
        """(4, 4), turn of a joint from the angle that the file draws it at to zero."""
        compiler = self.compiled
        if self.kind(joint) != "revolute":
            return np.eye(4)
        return turn(compiler.jnt_axis[joint].tolist(), -self.drawn_at(joint))

    def kind(self, joint: int) -> str:
        """Type of a joint, by URDF's names."""
        return KINDS[int(self.compiled.jnt_type[joint])]

    def drawn_at(self, joint: int) -> float:
        """Angle of a joint as the file draws it (rad)."""
        return float(self.compiled.qpos0[self.compiled.jnt_qposadr[joint]])

    def joint_name(self, joint: int) -> str:
        """The joint's name, or one by its number."""
        return str(self.compiled.joint(joint).name or f"joint{joint + 1}")


def read_robot(path: Path, arguments: Mapping[str, str] | None = None) -> Urdf:
    """Links, joints and masses of a URDF, a xacro file (`arguments`) or an MJCF, whatever its ending.

    Raises as their readers do.
    """
    if parse_xml(path, read_xml_text(path).text).tag == "mujoco":
        return read_bare(path).robot
    return read_urdf(path, arguments)


def read_mjcf(path: Path) -> MjcfRobot:
    """Reads an MJCF with its meshes. Raises `FileError`, or `LrmError` where MuJoCo is not installed."""
    return _read(path, _as_it_is)


def read_bare(path: Path) -> MjcfRobot:
    """Reads an MJCF without its pictures and meshes. Raises as `read_mjcf`."""
    return _read(path, _bare)


def _read(path: Path, prepare: Callable[[Path, Any], str]) -> MjcfRobot:
    try:
        import mujoco
    except ImportError:
        raise LrmError("an MJCF is read with MuJoCo; pip install 'lrm-arm[mujoco]'") from None
    if not path.is_file():
        raise FileError(path, "", "no such file")
    if path.suffix not in MUJOCO_READS:
        raise FileError(path, "", f"MuJoCo reads no {path.suffix or 'nameless'} file", "name it .xml")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        unweighed = prepare(path, spec)
        compiled = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise FileError(path, "", f"MuJoCo: {' '.join(str(error).split())}") from None
    return MjcfRobot(path, spec, compiled, unweighed)


def _as_it_is(_path: Path, _spec: Any) -> str:
    """Changes nothing."""
    return ""


def _bare(path: Path, spec: Any) -> str:
    """Leaves out pictures and meshes, whose files need not exist; gives the bodies without a mass then, in words.

    Meshes stay that a body's mass is computed from, where they are all there. A shape keeps its name: contacts and
    tendons may refer to it.
    """
    import mujoco

    for element in (*spec.keys, *spec.hfields, *spec.skins, *spec.textures):
        spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    from_shapes = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    shapes = [shape for shape in spec.geoms if shape.meshname or shape.hfieldname]
    weighed = [shape for shape in shapes if from_shapes or not shape.parent.explicitinertial]
    missing = [mesh for mesh in spec.meshes if mesh.file and not _is_there(path, spec, mesh)]
    lost = {shape.parent.name for shape in weighed if shape.meshname in {_mesh_name(mesh) for mesh in missing}}
    for shape in shapes:
        if missing or shape not in weighed:
            shape.type, shape.size = mujoco.mjtGeom.mjGEOM_SPHERE, [0.001, 0.0, 0.0]
            shape.meshname = shape.hfieldname = ""
            shape.mass = 0.0 if shape in weighed else shape.mass
    needed = {shape.meshname for shape in shapes}
    for mesh in [mesh for mesh in spec.meshes if _mesh_name(mesh) not in needed]:
        spec.delete(mesh)
    if not lost:
        return ""
    spec.compiler.boundmass = spec.compiler.boundinertia = NO_MASS
    return f"no mesh {missing[0].file}, of which the mass of {', '.join(sorted(lost))} is computed"


def _mesh_name(mesh: Any) -> str:
    """Name of a mesh; without one it has that of its file."""
    return str(mesh.name or Path(mesh.file).stem)


def _is_there(path: Path, spec: Any, mesh: Any) -> bool:
    """Whether a mesh's file exists, from where the file lies or its folder of meshes."""
    folder = Path(spec.meshdir or spec.compiler.meshdir or "")
    return any((path.parent / place / mesh.file).is_file() for place in (folder, Path()))


def _as_links(robot_file: MjcfRobot) -> Urdf:
    tree, compiled = ElementTree.Element("robot", name=robot_file.path.stem), robot_file.compiled
    for body in range(compiled.nbody):
        link = ElementTree.SubElement(tree, "link", name=robot_file.link(body))
        if body:
            _add_mass(link, robot_file, body)
            _add_joints(tree, robot_file, body)
    for site in range(compiled.nsite):
        name, body = compiled.site(site).name, int(compiled.site_bodyid[site])
        if name and name not in robot_file.bodies:
            ElementTree.SubElement(tree, "link", name=name)
            origin = inverse(robot_file.anchor(body)) @ _pose(compiled.site_quat[site], compiled.site_pos[site])
            append_joint(tree, f"{name}_site", "fixed", robot_file.link(body), name, origin)
    robot = urdf_of(robot_file.path, tree)
    x, y, z = compiled.opt.gravity.tolist()
    return replace(robot, gravity=(x, y, z), notices=tuple(_closed_loops(robot_file)), unweighed=robot_file.unweighed)


def _closed_loops(robot_file: MjcfRobot) -> Iterator[str]:
    """Notices of equalities, beside those of two joints, that may couple joints of the arm."""
    import mujoco

    kinds = {mujoco.mjtEq.mjEQ_CONNECT: "connect", mujoco.mjtEq.mjEQ_WELD: "weld", mujoco.mjtEq.mjEQ_TENDON: "tendon"}
    active = robot_file.compiled.eq_type[np.asarray(robot_file.compiled.eq_active0, dtype=bool)]
    closing = [f"{int((active == kind).sum())} <{name}>" for kind, name in kinds.items() if (active == kind).any()]
    if closing:
        yield f"the <equality> of {' and '.join(closing)} is not read: joints that it couples count as free"


def _pose(quaternion: Array, position: Array) -> Array:
    return homogeneous(rotation_matrix(quaternion), position)


def _add_joints(tree: ElementTree.Element, robot_file: MjcfRobot, body: int) -> None:
    """The joints of a body in a chain; between two of them stands a link without mass."""
    compiled, joints = robot_file.compiled, robot_file.joints_of(body)
    parent = int(compiled.body_parentid[body])
    before, name = robot_file.link(parent), robot_file.link(body)
    stands = inverse(robot_file.anchor(parent)) @ _pose(compiled.body_quat[body], compiled.body_pos[body])
    if not joints:
        append_joint(tree, f"{name}_fixed", "fixed", before, name, stands)
    for joint in joints:
        after = name if joint == joints[-1] else f"{name}_{robot_file.joint_name(joint)}"
        if after != name:
            ElementTree.SubElement(tree, "link", name=after)
        _add_joint(
            tree,
            robot_file,
            joint,
            (before, after),
            stands @ robot_file.joint_anchor(joint) @ robot_file.joint_zero(joint),
        )
        before, stands = after, inverse(robot_file.joint_anchor(joint))


def _add_joint(
    tree: ElementTree.Element, robot_file: MjcfRobot, joint: int, ends: tuple[str, str], origin: Array
) -> None:
    compiled, kind = robot_file.compiled, robot_file.kind(joint)
    limited = bool(compiled.jnt_limited[joint])
    kind = kind if limited or kind != "revolute" else "continuous"
    element = append_joint(tree, robot_file.joint_name(joint), kind, *ends, origin)
    ElementTree.SubElement(element, "axis", xyz=numbers(compiled.jnt_axis[joint]))
    if limited:
        low, high = map(repr, compiled.jnt_range[joint].tolist())
        ElementTree.SubElement(element, "limit", lower=low, upper=high)
    _add_coupling(element, robot_file, joint)


def _add_coupling(element: ElementTree.Element, robot_file: MjcfRobot, joint: int) -> None:
    """The equality by which a joint follows another one, q - q_drawn = a + b (p - p_drawn): as a `<mimic>`."""
    import mujoco

    compiled = robot_file.compiled
    for number in np.flatnonzero(compiled.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        leader = int(compiled.eq_obj2id[number])
        if int(compiled.eq_obj1id[number]) != joint or not compiled.eq_active0[number]:
            continue
        a, b, *more = compiled.eq_data[number][:5].tolist()
        mimic = ElementTree.SubElement(element, "mimic", offset=repr(a + robot_file.drawn_at(joint)))
        if leader >= 0:
            offset = a + robot_file.drawn_at(joint) - b * robot_file.drawn_at(leader)
            mimic.attrib.update(joint=robot_file.joint_name(leader), multiplier=repr(b), offset=repr(offset))
        if leader >= 0 and any(more):
            mimic.set(POLYNOMIAL, numbers([a, b, *more]))


def _add_mass(link: ElementTree.Element, robot_file: MjcfRobot, body: int) -> None:
    mass = float(robot_file.compiled.body_mass[body])
    if mass > 10.0 * NO_MASS:
        inertial = ElementTree.SubElement(link, "inertial")
        com = robot_file.compiled.body_ipos[body] - robot_file.anchor(body)[:3, 3]
        ElementTree.SubElement(inertial, "origin", xyz=numbers(com))
        ElementTree.SubElement(inertial, "mass", value=repr(mass))
