"""Every door that is driven by the tests, and the modules of the project that write to a motor."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

from tests.conftest import ROOT
from tests.doors.door import DoorKind
from tests.support.source_files import files, imported_names, syntax_tree

SHIPPED = ("lrm_math", "lrmd", "lrm_ident", "lrm_ros2", "lrm_skills", "lerobot_robot_lrm")
WRITERS = {"serial", "scservo_sdk", "dynamixel_sdk", "smbus", "smbus2", "can"}
"""Packages that a motor is reached by."""
CALLS = {
    "send_action", "sync_write", "write_with_retries", "enable_torque", "disable_torque", "move", "jog", "hold", "arm",
    "relax", "estop", "put", "write", "skill",
}  # fmt: skip
"""Methods by which an arm moves, stops, or gets torque, of an object whose last name is one of `MOVERS`."""
ACTION_STEPS = ("ActionProcessorStep",)
"""Endings of LeRobot's classes whose heirs make what a robot is sent."""
MOVERS = {"rover", "robot", "host", "bus", "line", "door", "session"}


@cache
def door_kinds() -> tuple[DoorKind, ...]:
    """Kinds of all modules `*_door.py` beside this one."""
    names = sorted(path.stem for path in Path(__file__).parent.glob("*_door.py"))
    return tuple(kind for name in names for kind in import_module(f"{__package__}.{name}").DOORS)


def motor_writers() -> set[str]:
    """Dotted names of shipped modules that reach a motor, by what they import or call."""
    return {_dotted(path) for package in SHIPPED for path in files(package) if any(_reasons(path))}


def _dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    if "src" in parts:
        parts = parts[parts.index("src") + 1 :]
    return ".".join(part for part in parts if part != "__init__")


def _reasons(path: Path) -> Iterator[str]:
    yield from (name for name in imported_names(path) if name.split(".")[0] in WRITERS)
    for node in ast.walk(syntax_tree(path)):
        if isinstance(node, ast.ClassDef):
            yield from (name for name in map(_last_name, node.bases) if name.endswith(ACTION_STEPS))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            of = _last_name(node.func.value)
            if node.func.attr in CALLS and of.strip("_") in MOVERS:
                yield f"{of}.{node.func.attr}"


def _last_name(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""
