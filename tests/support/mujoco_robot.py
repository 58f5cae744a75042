"""A robot as MuJoCo moves it, its shapes left out: positions of its tip and gravity's torques, of the motors alone."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.robot_files.urdf import Urdf
from lrm_ident.data.robot_files.urdf_arm import ImportedArm
from lrm_ident.data.robot_files.xacro_file import SHAPES
from lrm_math.arrays import Array

INERTIA = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}
NO_MASS = "1e-14"


@dataclass
class MujocoRobot:
    """A robot in MuJoCo.

    Attributes:
        base, tip: the links between which the arm stands. motors: names of its joints that have one.
        couplings: for joints that follow: leader, ratio and offset (rad), as the file states them.
    """

    model: Any
    base: str
    tip: str
    motors: list[str]
    couplings: dict[str, tuple[str, float, float]]

    @staticmethod
    def of(path: Path, robot: Urdf, found: ImportedArm) -> MujocoRobot:
        """The peer of an imported arm: MuJoCo reads an MJCF itself, of a URDF the tree that xacro expanded."""
        motors = [joint.name for joint in found.arm.joints]
        if robot.tree.find("link") is not None and path.suffix.lower() != ".xml":
            return MujocoRobot(_urdf(robot.tree), found.base, found.tip, motors, _couplings(robot.tree))
        return MujocoRobot(_mjcf(path), found.base, found.tip, motors, _couplings(robot.tree))

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Position of the tip in the base (3,), m, and gravity's torques on the motors (n,), N·m, by virtual work."""
        import mujoco

        data = mujoco.MjData(self.model)
        data.qpos[:] = self._angles(q)
        mujoco.mj_forward(self.model, data)
        (at, R), (tip, _) = (self._pose(data, link) for link in (self.base, self.tip))
        still = self._angles(np.zeros(len(q)))
        C = np.array([self._angles(one) - still for one in np.eye(len(q))])
        return R.T @ (tip - at), -(C[:, self._hinges] @ data.qfrc_bias[self._speeds])

    @property
    def _names(self) -> list[str]:
        """Names of all joints; without one, by their number."""
        return [self.model.joint(k).name or f"joint{k + 1}" for k in range(self.model.njnt)]

    @property
    def _hinges(self) -> list[int]:
        return [int(self.model.jnt_qposadr[k]) for k in range(self.model.njnt) if self.model.jnt_type[k] == 3]

    @property
    def _speeds(self) -> list[int]:
        return [int(self.model.jnt_dofadr[k]) for k in range(self.model.njnt) if self.model.jnt_type[k] == 3]

    def _pose(self, data: Any, link: str) -> tuple[Array, Array]:
        """A link's place in the world; MuJoCo's world is a URDF's root."""
        import mujoco

        if mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, link) >= 0:
            return data.body(link).xpos.copy(), data.body(link).xmat.reshape(3, 3).copy()
        if mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, link) >= 0:
            return data.site(link).xpos.copy(), data.site(link).xmat.reshape(3, 3).copy()
        return np.zeros(3), np.eye(3)

    def _angles(self, q: Array) -> Array:
        """MuJoCo's coordinates: motors as given, followers as coupled, all else at rest."""
        out = self.model.qpos0.copy()
        given = dict(zip(self.motors, q.tolist(), strict=True))
        for k, name in enumerate(self._names):
            if self.model.jnt_type[k] == 3:
                out[int(self.model.jnt_qposadr[k])] = self._angle(name, given)
        return np.asarray(out)

    def _angle(self, name: str, given: dict[str, float], before: tuple[str, ...] = ()) -> float:
        leader, ratio, offset = self.couplings.get(name, ("", 0.0, 0.0))
        known = {*self._names} - {*before}
        if name not in given and leader in known:
            return ratio * self._angle(leader, given, (*before, name)) + offset
        if name in given:
            return given[name]
        number = self._names.index(name)
        low, high = self.model.jnt_range[number] if self.model.jnt_limited[number] else (-np.inf, np.inf)
        return min(max(0.0, low), high)


def _couplings(tree: ElementTree.Element) -> dict[str, tuple[str, float, float]]:
    out = {}
    for joint in tree.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint"):
            ratio, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            out[str(joint.get("name"))] = (str(mimic.get("joint")), ratio, offset)
    return out


def _urdf(tree: ElementTree.Element) -> Any:
    import mujoco

    tree = deepcopy(tree)
    for parent in list(tree.iter()):
        for child in [child for child in parent if not isinstance(child.tag, str) or child.tag in SHAPES]:
            parent.remove(child)
        for child in [child for child in parent if isinstance(child.tag, str) and child.tag.startswith("xacro:")]:
            parent.remove(child)
    for link in tree.findall("link"):
        inertial = link.find("inertial")
        inertial = ElementTree.SubElement(link, "inertial") if inertial is None else inertial
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        mass = ElementTree.SubElement(inertial, "mass", value="0") if mass is None else mass
        mass.set("value", mass.get("value", "0") if float(mass.get("value", "0")) > 0.0 else NO_MASS)
        if inertia is not None:
            inertial.remove(inertia)
        ElementTree.SubElement(inertial, "inertia", INERTIA)
    own = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(own, "compiler", fusestatic="false", discardvisual="true", strippath="true")
    for attribute in [name for name in tree.attrib if name.startswith("xmlns")]:
        del tree.attrib[attribute]
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(tree, encoding="unicode"))


def _mjcf(path: Path) -> Any:
    from lrm_ident.data.robot_files import mjcf_robot

    return mjcf_robot.read_bare(path).compiled
