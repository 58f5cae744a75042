"""Elements of robot descriptions in XML: numbers, and joints of a URDF with their places."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

from lrm_ident.data.robot_files.rigid_motion import to_xyz_rpy
from lrm_math.arrays import Array


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
