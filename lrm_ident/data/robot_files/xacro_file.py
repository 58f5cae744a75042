"""Xacro: whether a robot's file has elements to expand, and its expansion by the package `xacrodoc`.

A definition (`xacro:property`, `xacro:arg`, `xacro:macro`) that nothing uses is a leftover. So is xacro in shapes,
which kinematics and masses do not need.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from lrm_ident.data.robot_files.xml_text import parse_xml, read_xml_text
from lrm_math.errors import FileError

PREFIX = "xacro:"
NAMESPACE = "http://www.ros.org/wiki/xacro"
DEFINITIONS = ("xacro:property", "xacro:arg", "xacro:macro")
EXPAND_FIRST = "expand it first: xacro IN.xacro -o OUT.urdf"
MANIFEST, PACKAGE_NAME = "package.xml", re.compile(r"<name>\s*(\S+?)\s*</name>")
MISSING_PACKAGE = re.compile(r"ackage not found: (\S+)")
EXPRESSIONS = ("${", "$(")
SHAPES = ("visual", "collision", "gazebo", "transmission", "ros2_control", "sensor", "material")
"""Elements that are not read: shapes, and what simulators and drivers add."""


def to_expand(tree: ElementTree.Element) -> str:
    """The first thing in a robot's tree that only xacro can read, in words; "" if there is none."""
    return next(_live(tree), "")


def _live(element: ElementTree.Element) -> Iterator[str]:
    name = element.tag
    if not isinstance(name, str) or name in (*DEFINITIONS, *SHAPES):
        return
    if name.startswith(PREFIX):
        yield f"<{name}>"
    for key, value in element.items():
        if any(sign in value for sign in EXPRESSIONS):
            yield f'{key}="{value}" of <{name}>'
    for child in element:
        yield from _live(child)


def expanded(
    path: Path, tree: ElementTree.Element, without: Collection[str], arguments: Mapping[str, str]
) -> ElementTree.Element:
    """The tree of a file with its xacro elements expanded; `without`: elements that are left out first, everywhere.

    What they refer to (meshes of a package, say) need not exist then. `arguments`: of xacro, by name. Packages
    are found around the file and beside it, as in a workspace of ROS. Raises `FileError`.
    """
    try:
        from xacrodoc import XacroDoc, packages
    except ImportError:
        what = f"{to_expand(tree)} is xacro, which needs the package xacrodoc"
        raise FileError(path, "", what, f"pip install 'lrm-arm[xacro]', or {EXPAND_FIRST}") from None
    tree.attrib.setdefault(f"xmlns:{PREFIX[:-1]}", NAMESPACE)
    text = ElementTree.tostring(tree, encoding="unicode")
    packages.reset()
    packages.update_package_cache(packages_beside(path.resolve()))
    packages.walk_up_from(path.resolve())
    try:
        with _leaving_out(path, without):
            document = XacroDoc.from_string(
                text, resolve_packages=False, rootdir=path.parent, subargs=dict(arguments) or None
            )
        return parse_xml(path, str(document.to_urdf_string()))
    except FileError:
        raise
    except Exception as error:  # xacro raises errors of many kinds, all of them faults of the file
        raise _fault(path, error) from None


def packages_beside(path: Path) -> dict[str, Path]:
    """Folders of the packages in the workspace of a file, by name: the nearest of a name counts.

    A package is a folder with a `package.xml`, up to two folders below the three around the file's own package; else a
    folder of that name there, as people copy it.
    """
    package = next((folder for folder in path.parents if (folder / MANIFEST).is_file()), path.parent)
    packages: dict[str, Path] = {}
    for around in package.parents[:3]:
        for pattern in (f"*/{MANIFEST}", f"*/*/{MANIFEST}"):
            for manifest in sorted(around.glob(pattern)):
                name = PACKAGE_NAME.search(manifest.read_text(encoding="utf-8", errors="replace"))
                if name:
                    packages.setdefault(name[1], manifest.parent)
    for around in package.parents[:3]:
        for folder in sorted(entry for entry in around.iterdir() if entry.is_dir()):
            packages.setdefault(folder.name, folder)
    return packages


def _fault(path: Path, error: Exception) -> FileError:
    """An error of xacro in one line, with what helps."""
    said = next(iter(str(error).splitlines()), type(error).__name__)
    missing = MISSING_PACKAGE.search(said)
    if missing:
        right = f"put the file in or beside the folder {missing[1]}, or one with the package.xml of {missing[1]}"
        return FileError(path, "", f"xacro: package not found: {missing[1]}", right)
    remedies = {"missing attribute 'default'": "give it a default", "substitution argument": "--xacro NAME:=VALUE"}
    return FileError(path, "", f"xacro: {said}", next((remedies[words] for words in remedies if words in said), ""))


@contextmanager
def _leaving_out(path: Path, names: Collection[str]) -> Iterator[None]:
    """Xacro without some elements in the file `path` and those that it includes, found from where it lies."""
    import xacro

    parse = xacro.parse

    def parse_without(inp: Any, filename: str | None = None) -> Any:
        """The document without these elements; arguments as of `xacro.parse`."""
        if inp is None and filename is not None and (where := Path(xacro.root_dir or "", filename)).is_file():
            inp = read_xml_text(where).text
        document = parse(inp, filename)
        for name in names:
            for element in list(document.getElementsByTagName(name)):
                element.parentNode.removeChild(element)
        return document

    xacro.parse = parse_without
    xacro.init_stacks(str(path.resolve()))
    try:
        yield
    finally:
        xacro.parse, xacro.filestack = parse, None
