"""Joint offsets in a robot's `<ros2_control>` description: parameters of the Dynamixel and Feetech drivers.

Both read an angle as what the encoder says less the offset: the one in rad, the other in counts. A joint that stands at
δ where it reads zero has an offset lower by δ. Newer Feetech drivers have a homing offset in the servo in its place,
against which the limits are moved, so that they stay where they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from lrm_ident.data.robot_files.lerobot_calibration import COUNTS, check_names, zero_offsets
from lrm_math.errors import FileError
from lrm_math.model.model import Model
from lrm_math.text_file import read_utf8

DYNAMIXEL, FEETECH = "dynamixel_hardware/DynamixelHardware", "feetech_ros2_driver/FeetechHardwareInterface"
XACRO = "http://www.ros.org/wiki/xacro"
OFFSET, HOMING, LIMITS = "offset", "homing_offset", ("range_min", "range_max")
PER_RAD = COUNTS / (2.0 * math.pi)
DIGITS = 9
"""Decimals of an offset in rad."""


def with_offsets(path: Path, model: Model) -> str:
    """Text of a description (URDF or xacro, not expanded) with the model's zeros; all else stays.

    Raises `FileError`: no such description, a driver without offsets, a joint that is missing, or no number.
    """
    tree = _parsed(path)
    joints = {_plain(joint): joint for part in tree.iter("ros2_control") for joint in part.iter("joint")}
    driver = _driver(path, tree)
    check_names(path, model, joints)
    for name, offset in zero_offsets(model).items():
        if driver == DYNAMIXEL:
            _add(path, joints[name], OFFSET, -offset, "0.0")
        else:
            _shift_counts(path, joints[name], round(offset * PER_RAD))
    return ElementTree.tostring(tree, encoding="unicode") + "\n"


def _shift_counts(path: Path, joint: ElementTree.Element, counts: int) -> None:
    if _parameter(joint, OFFSET) is not None:
        _add(path, joint, OFFSET, -counts, "0")
        return
    if _parameter(joint, HOMING) is None:
        what = "neither offset nor homing_offset among its <param>"
        raise FileError(path, f"joint {_plain(joint)}", what, "write the one that your driver reads, with its value")
    _add(path, joint, HOMING, -counts, "0")
    for name in LIMITS:
        if _parameter(joint, name) is not None:
            _add(path, joint, name, counts, "0")


def _add(path: Path, joint: ElementTree.Element, name: str, change: float, default: str) -> None:
    """Adds to a parameter, a whole number to a whole number."""
    element = _parameter(joint, name)
    if element is None:
        element = ElementTree.SubElement(joint, "param", name=name)
    text = (element.text or default).strip()
    try:
        value: float = int(text) if isinstance(change, int) else float(text)
    except ValueError:
        where, right = f"joint {_plain(joint)}", "a number; expand a xacro expression first"
        raise FileError(path, where, f"{name} = {text}", right) from None
    element.text = repr(round(value + change, DIGITS))


def _parameter(joint: ElementTree.Element, name: str) -> ElementTree.Element | None:
    return next((param for param in joint.findall("param") if param.get("name") == name), None)


def _plain(joint: ElementTree.Element) -> str:
    """Name of a joint without the prefix that a xacro puts before it."""
    return (joint.get("name") or "").rpartition("}")[2]


def _driver(path: Path, tree: ElementTree.Element) -> str:
    named = list(dict.fromkeys(_plugins(tree)))
    drivers = [name for name in named if name in (DYNAMIXEL, FEETECH)]
    if len(drivers) != 1:
        what = f"its driver is {', '.join(named) or 'not named in a <plugin>'}"
        raise FileError(path, "ros2_control", what, f"one of {DYNAMIXEL}, {FEETECH} has offsets")
    return drivers[0]


def _plugins(tree: ElementTree.Element) -> Iterator[str]:
    for part in tree.iter("ros2_control"):
        yield from ((plugin.text or "").strip() for plugin in part.iter("plugin"))


def _parsed(path: Path) -> ElementTree.Element:
    ElementTree.register_namespace("xacro", XACRO)
    keeping = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        tree = ElementTree.fromstring(read_utf8(path), keeping)
    except ElementTree.ParseError as error:
        raise FileError(path, "", f"cannot be read as XML ({error})") from None
    if next(tree.iter("ros2_control"), None) is None:
        raise FileError(path, "", "no <ros2_control> in it", "the file that names the driver and its joints")
    return tree
