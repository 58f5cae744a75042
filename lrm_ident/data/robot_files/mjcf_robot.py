"""A robot's own MJCF read by MuJoCo: as links and joints, like a URDF, and what it takes to write its frames back.

A link's frame stands on its joint's anchor with the joint at zero: MuJoCo's body frame may lie beside it, and its angle
zero elsewhere (`ref`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.rigid_motion import homogeneous, inverse, rotation_matrix, shift, turn
from lrm_ident.data.robot_files.urdf import Urdf, append_joint, numbers, urdf_of
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

KINDS = ("floating", "ball", "prismatic", "revolute")
"""Types of joints, in MuJoCo's order."""
SEVERAL = "compound"


@dataclass(frozen=True, eq=False)
class MjcfRobot:
    """A robot as MuJoCo has it: `spec` and `compiled` are MuJoCo's own."""

    path: Path
    spec: Any
    compiled: Any

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

    def hinge(self, body: int) -> int | None:
        """Number of the joint of a body, of its first one."""
        return int(self.compiled.body_jntadr[body]) if self.compiled.body_jntnum[body] else None

    def anchor(self, body: int) -> Array:
        """(4, 4), a link's frame in its body's: where its joint is, none: the body's own."""
        joint = self.hinge(body)
        return np.eye(4) if joint is None else shift(self.compiled.jnt_pos[joint].tolist())

    def zero(self, body: int) -> Array:
        """(4, 4), turn of a joint from the angle that the file draws it at to zero."""
        joint, own = self.hinge(body), self.compiled
        if joint is None or KINDS[int(own.jnt_type[joint])] != "revolute":
            return np.eye(4)
        return turn(own.jnt_axis[joint].tolist(), -float(own.qpos0[own.jnt_qposadr[joint]]))


def read_mjcf(path: Path) -> MjcfRobot:
    """Reads an MJCF with its meshes. Raises `FileError`, or `LrmError` where MuJoCo is not installed."""
    try:
        import mujoco
    except ImportError:
        raise LrmError("an MJCF is read with MuJoCo; pip install 'lrm-arm[mujoco]'") from None
    if not path.is_file():
        raise FileError(path, "", "no such file")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        compiled = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise FileError(path, "", f"MuJoCo: {' '.join(str(error).split())}") from None
    return MjcfRobot(path, spec, compiled)


def _as_links(own: MjcfRobot) -> Urdf:
    tree, compiled = ElementTree.Element("robot", name=own.path.stem), own.compiled
    for body in range(compiled.nbody):
        link = ElementTree.SubElement(tree, "link", name=own.link(body))
        if body:
            _add_mass(link, own, body)
            _add_joint(tree, own, body)
    for site in range(compiled.nsite):
        name, body = compiled.site(site).name, int(compiled.site_bodyid[site])
        if name and name not in own.bodies:
            ElementTree.SubElement(tree, "link", name=name)
            origin = inverse(own.anchor(body)) @ _pose(compiled.site_quat[site], compiled.site_pos[site])
            append_joint(tree, f"{name}_site", "fixed", own.link(body), name, origin)
    robot = urdf_of(own.path, tree)
    x, y, z = compiled.opt.gravity.tolist()
    return replace(robot, gravity=(x, y, z))


def _pose(quaternion: Array, position: Array) -> Array:
    return homogeneous(rotation_matrix(quaternion), position)


def _add_joint(tree: ElementTree.Element, own: MjcfRobot, body: int) -> None:
    compiled, joint = own.compiled, own.hinge(body)
    parent = int(compiled.body_parentid[body])
    stands = _pose(compiled.body_quat[body], compiled.body_pos[body])
    origin = inverse(own.anchor(parent)) @ stands @ own.anchor(body) @ own.zero(body)
    ends = (own.link(parent), own.link(body))
    if joint is None:
        append_joint(tree, f"{ends[1]}_fixed", "fixed", *ends, origin)
        return
    kind = KINDS[int(compiled.jnt_type[joint])] if int(compiled.body_jntnum[body]) == 1 else SEVERAL
    limited = bool(compiled.jnt_limited[joint])
    name = compiled.joint(joint).name or f"joint{joint + 1}"
    element = append_joint(tree, name, kind if limited or kind != "revolute" else "continuous", *ends, origin)
    ElementTree.SubElement(element, "axis", xyz=numbers(compiled.jnt_axis[joint]))
    if limited:
        low, high = map(repr, compiled.jnt_range[joint].tolist())
        ElementTree.SubElement(element, "limit", lower=low, upper=high)


def _add_mass(link: ElementTree.Element, own: MjcfRobot, body: int) -> None:
    mass = float(own.compiled.body_mass[body])
    if mass > 0.0:
        inertial = ElementTree.SubElement(link, "inertial")
        com = own.compiled.body_ipos[body] - own.anchor(body)[:3, 3]
        ElementTree.SubElement(inertial, "origin", xyz=numbers(com))
        ElementTree.SubElement(inertial, "mass", value=repr(mass))
