"""Forty robots' files of a generator: encodings, leftovers of xacro, walls, other roots, mimic joints, MJCF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.support.mimic_robots import chain_mjcf, palletiser
from tests.support.vendor_robots import MESH, XACRO, joint, link, turning, vendor_parts

DECLARED = '<?xml version="1.0"?>\n'


@dataclass(frozen=True)
class RobotFile:
    """A file as written, its ending, and its bare text for MuJoCo; `base`: where the arm begins, None: its root."""

    content: bytes
    plain: str
    ending: str = ".urdf"
    base: str | None = None


def _urdf(parts: str, more: str = "") -> str:
    return f'<robot name="v"{more}>{parts}</robot>'


def _mimics(seed: int) -> str:
    """A chain of fixed and turning joints on a wall, of which one to three follow others."""
    rng, parts, before = np.random.default_rng(seed), ['<link name="world"/>'], "world"
    leaders: list[str] = []
    for number in range(1, 6):
        follows = bool(leaders) and number > 2 + seed % 2
        led = (
            f'<mimic joint="{rng.choice(leaders)}" multiplier="{rng.choice([-1.0, 0.5])}" offset="0.1"/>'
            if follows
            else ""
        )
        leaders += [] if follows else [f"j{number}"]
        more = turning(rng, (-9.0, 9.0) if follows else (-2.0, 2.5)) + led
        parts += [link(f"l{number}", rng), joint(f"j{number}", "revolute", (before, f"l{number}"), rng, more)]
        parts += [link(f"f{number}", rng), joint(f"k{number}", "fixed", (f"l{number}", f"f{number}"), rng)]
        before = f"f{number}"
    return "".join([*parts, '<link name="tip"/>', joint("t", "fixed", (before, "tip"), rng)])


WRITTEN: dict[str, Callable[[str], bytes]] = {
    "plain": lambda parts: _urdf(parts).encode(),
    "blank lines first": lambda parts: f"\n \r\n{DECLARED}{_urdf(parts)}".encode(),
    "latin-1": lambda parts: f'<?xml version="1.0" encoding="ISO-8859-1"?><!-- Ä -->{_urdf(parts)}'.encode("latin-1"),
    "undeclared latin-1": lambda parts: _urdf(f"<!-- © -->{parts}").encode("latin-1"),
    "utf-16": lambda parts: f'<?xml version="1.0" encoding="UTF-16"?>{_urdf(parts)}'.encode("utf-16"),
    "byte order mark": lambda parts: f"{DECLARED}{_urdf(parts)}".encode("utf-8-sig"),
    "xacro in a comment": lambda parts: _urdf(f"<!-- <xacro:gripper/> -->{parts}", XACRO).encode(),
    "dead property": lambda parts: _urdf(f'<xacro:property name="w" value="${{pi}}"/>{parts}', XACRO).encode(),
    "dead macro": lambda parts: _urdf(f'<xacro:macro name="m"><xacro:insert_block/></xacro:macro>{parts}').encode(),
    "xacro in shapes": lambda parts: _urdf(parts.replace(MESH, "$(find none)/${part}.stl")).encode(),
    "a link beside it": lambda parts: _urdf(f'<link name="room"/>{parts}').encode(),
}


def many_robots() -> dict[str, RobotFile]:
    """The forty, by what is odd about them."""
    found: dict[str, RobotFile] = {}
    for number, (name, write) in enumerate(WRITTEN.items()):
        for ending in (".urdf", ".xacro"):
            parts = vendor_parts(seed := 100 + 2 * number + (ending == ".xacro"))
            on_wall = (None, "base")[seed % 2]
            found[f"{name}, {ending}, {on_wall or 'root'}"] = RobotFile(write(parts), _urdf(parts), ending, on_wall)
    for seed in range(6):
        text = _urdf(_mimics(seed))
        found[f"followers, {seed}"] = RobotFile(text.encode(), text)
    for seed in range(11):
        text = chain_mjcf(50 + seed, count=4 + seed % 4)
        found[f"MJCF with followers, {seed}"] = RobotFile(text.encode(), text, ".xml")
    found["palletiser"] = RobotFile(palletiser().encode(), palletiser())
    return found
