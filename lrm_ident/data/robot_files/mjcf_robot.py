"""A robot's own MJCF read by MuJoCo: as links and joints, like a URDF, and what it takes to write its frames back.

A link's frame stands on its joint's anchor with the joint at zero: MuJoCo's body frame may lie beside it, and its angle
zero elsewhere (`ref`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.robot_files.rigid_motion import homogeneous, inverse, shift, turn
from lrm_ident.data.robot_files.urdf import Urdf, append_joint, numbers, parse_urdf
from lrm_ident.data.weights.rotations import rotation_matrix
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

KINDS = ("floating", "ball", "prismatic", "revolute")
"""Types of joints, in MuJoCo's order."""
SEVERAL = "compound"


@dataclass(frozen=True, eq=False)
class MjcfRobot:
    """A robot as MuJoCo has it. `spec`, `compiled`: MuJoCo's own; `robot`: its links and joints."""

    path: Path
    spec: Any
    compiled: Any
    robot: Urdf

    def is_body(self, link: str) -> bool:
        """Whether a link is a body; else it is a site."""
        return link in self._bodies

    def body(self, link: str) -> int:
        """Number of a link's body."""
        return self._bodies[link]

    def spec_body(self, link: str) -> Any:
        """The body as MuJoCo's `MjSpec` has it."""
        return self._spec_bodies[self.body(link)]

    @cached_property
    def _bodies(self) -> dict[str, int]:
        return {_link(self.compiled, body): body for body in range(self.compiled.nbody)}

    @cached_property
    def _spec_bodies(self) -> dict[int, Any]:
        return {body.id: body for body in self.spec.bodies}

    def anchor(self, body: int) -> Array:
        """(4, 4), a link's frame in its body's: where its joint is, none: the body's own."""
        return _anchor(self.compiled, body)

    def zero(self, body: int) -> Array:
        """(4, 4), turn of a joint from the angle that the file draws it at to zero."""
        return _zero(self.compiled, body)


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
    return MjcfRobot(path, spec, compiled, _as_links(path, compiled))


def _as_links(path: Path, compiled: Any) -> Urdf:
    tree = ElementTree.Element("robot", name=path.stem)
    for body in range(compiled.nbody):
        link = ElementTree.SubElement(tree, "link", name=_link(compiled, body))
        if body:
            _add_mass(link, compiled, body)
            _add_joint(tree, compiled, body)
    taken = {link.get("name") for link in tree.findall("link")}
    for site in range(compiled.nsite):
        name = compiled.site(site).name
        if name and name not in taken:
            body = int(compiled.site_bodyid[site])
            ElementTree.SubElement(tree, "link", name=name)
            stands = homogeneous(rotation_matrix(compiled.site_quat[site]), compiled.site_pos[site])
            origin = inverse(_anchor(compiled, body)) @ stands
            append_joint(tree, f"{name}_site", "fixed", _link(compiled, body), name, origin)
    return parse_urdf(path.with_suffix(".mjcf"), ElementTree.tostring(tree, encoding="unicode"))


def _add_joint(tree: ElementTree.Element, compiled: Any, body: int) -> None:
    parent, joint = int(compiled.body_parentid[body]), _hinge(compiled, body)
    stands = homogeneous(rotation_matrix(compiled.body_quat[body]), compiled.body_pos[body])
    origin = inverse(_anchor(compiled, parent)) @ stands @ _anchor(compiled, body) @ _zero(compiled, body)
    ends = (_link(compiled, parent), _link(compiled, body))
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


def _add_mass(link: ElementTree.Element, compiled: Any, body: int) -> None:
    mass = float(compiled.body_mass[body])
    if mass > 0.0:
        inertial = ElementTree.SubElement(link, "inertial")
        com = compiled.body_ipos[body] - _anchor(compiled, body)[:3, 3]
        ElementTree.SubElement(inertial, "origin", xyz=numbers(com))
        ElementTree.SubElement(inertial, "mass", value=repr(mass))


def _link(compiled: Any, body: int) -> str:
    return str(compiled.body(body).name or f"body{body}")


def _hinge(compiled: Any, body: int) -> int | None:
    return int(compiled.body_jntadr[body]) if compiled.body_jntnum[body] else None


def _anchor(compiled: Any, body: int) -> Array:
    joint = _hinge(compiled, body)
    return np.eye(4) if joint is None else shift(compiled.jnt_pos[joint].tolist())


def _zero(compiled: Any, body: int) -> Array:
    joint = _hinge(compiled, body)
    if joint is None or KINDS[int(compiled.jnt_type[joint])] != "revolute":
        return np.eye(4)
    drawn_at = float(compiled.qpos0[compiled.jnt_qposadr[joint]])
    return turn(compiled.jnt_axis[joint].tolist(), -drawn_at)
