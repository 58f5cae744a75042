"""Robots' files as vendors write them: fixed chains, roots on a wall, grippers that stand, leftovers of xacro."""

from __future__ import annotations

import numpy as np

MESH = "package://some_arm_description/meshes/part.stl"
SHAPES = f'<visual><geometry><mesh filename="{MESH}"/></geometry></visual>'
XACRO = ' xmlns:xacro="http://www.ros.org/wiki/xacro"'


def numbers(values: object) -> str:
    """Numbers by spaces, exact."""
    return " ".join(map(repr, np.asarray(values, dtype=float).tolist()))


def link(name: str, rng: np.random.Generator, shapes: str = "") -> str:
    """A link with a mass of an arm's, shapes as given."""
    inertia = '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>'
    place = f'<origin xyz="{numbers(rng.normal(0, 0.04, 3))}"/>'
    mass = f'<mass value="{rng.uniform(0.05, 0.4)}"/>'
    return f'<link name="{name}"><inertial>{place}{mass}{inertia}</inertial>{shapes}</link>'


def joint(name: str, kind: str, ends: tuple[str, str], rng: np.random.Generator, more: str = "") -> str:
    """A joint at a random place; `more`: its axis and limits."""
    xyz, rpy = numbers(rng.uniform(-0.15, 0.15, 3)), numbers(rng.uniform(-3, 3, 3))
    placed = f'<parent link="{ends[0]}"/><child link="{ends[1]}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return f'<joint name="{name}" type="{kind}">{placed}{more}</joint>'


def turning(rng: np.random.Generator, limits: tuple[float, float] = (-2.0, 2.5)) -> str:
    """Axis of any direction, and limits (rad)."""
    lower, upper = limits
    axis = numbers(rng.normal(0, 1, 3))
    return f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="50" velocity="1"/>'


def vendor_parts(seed: int, shapes: str = SHAPES) -> str:
    """Links and joints: `world`, held at an angle `base`, three to six joints, `tip`; beside it a jaw of no range."""
    rng = np.random.default_rng(seed)
    parts = ['<link name="world"/>', link("base", rng, shapes), joint("mount", "fixed", ("world", "base"), rng)]
    before = "base"
    for number in range(1, 4 + seed % 4):
        name = f"l{number}"
        parts += [link(name, rng, shapes), joint(f"j{number}", "revolute", (before, name), rng, turning(rng))]
        before = name
        if rng.random() < 0.4:
            parts += [link(f"f{number}", rng), joint(f"k{number}", "fixed", (before, f"f{number}"), rng)]
            before = f"f{number}"
    jaw = joint("jaw_joint", "revolute", (before, "jaw"), rng, turning(rng, (0.0, 0.0)))
    tip = '<link name="tip"/>' + joint("tip_joint", "fixed", (before, "tip"), rng)
    return "\n".join([*parts, link("jaw", rng), jaw, tip])
