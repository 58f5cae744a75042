"""The arm as its description file gives it, in SI units."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Placement:
    """Place of the base in the world or of the TCP on the last link: lengths in m, angles about own x, y, z in rad."""

    xyz_m: Vector
    angles_rad: Vector


@dataclass(frozen=True)
class Link:
    """Shape of a link behind its joint (theta, d, a, alpha, then extra z) and the joint's range."""

    theta_rad: float
    d_m: float
    a_m: float
    alpha_rad: float
    extra_z_m: float
    limits_rad: tuple[float, float]


@dataclass(frozen=True)
class Body:
    """A rigid mass. frame: 0 base, 1..N the end of that link, N + 1 the tool.

    com_m is given in that frame, or, if near_end, in the frame before its last translation along z.
    loads_joint is the first joint whose torque counts the body.
    """

    name: str
    mass_kg: float
    com_m: Vector
    frame: int
    loads_joint: int
    near_end: bool = False
    carries_payload: bool = False


@dataclass(frozen=True)
class Rig:
    """A serial arm: base, links 1..N, tool, bodies, and gravity in world axes in m/s2."""

    name: str
    gravity_m_per_s2: Vector
    base: Placement
    links: tuple[Link, ...]
    tool: Placement
    bodies: tuple[Body, ...]


def load_arm(path: str | Path) -> Rig:
    """Read an arm description (schema lrm/arm/1; mm, g and deg in the file)."""
    data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    links = tuple(_link(entry) for entry in data["joint"])
    return Rig(
        name=data["name"],
        gravity_m_per_s2=_vector(data["gravity_m_per_s2"]),
        base=_placement(data["base"]),
        links=links,
        tool=_placement(data["tool"]),
        bodies=tuple(_body(entry, len(links)) for entry in data["body"]),
    )


def _placement(entry: dict[str, Any]) -> Placement:
    return Placement(
        _vector([_metres(entry.get(f"{name}_mm", 0.0)) for name in "xyz"]),
        _vector([math.radians(entry.get(f"{name}_deg", 0.0)) for name in ("alpha", "beta", "gamma")]),
    )


def _link(entry: dict[str, Any]) -> Link:
    low, high = entry["limits_deg"]
    return Link(
        theta_rad=math.radians(entry.get("theta_deg", 0.0)),
        d_m=_metres(entry.get("d_mm", 0.0)),
        a_m=_metres(entry.get("a_mm", 0.0)),
        alpha_rad=math.radians(entry.get("alpha_deg", 0.0)),
        extra_z_m=_metres(entry.get("extra_z_mm", 0.0)),
        limits_rad=(math.radians(low), math.radians(high)),
    )


def _body(entry: dict[str, Any], joints: int) -> Body:
    names = ["base", *(f"joint{number}" for number in range(1, joints + 1)), "tool"]
    return Body(
        name=entry["name"],
        mass_kg=entry["mass_g"] / 1000.0,
        com_m=_vector([_metres(value) for value in entry["com_mm"]]),
        frame=names.index(entry["frame"]),
        loads_joint=entry["loads_joint"],
        near_end=entry.get("com_from") == "near_end",
        carries_payload=entry.get("carries_payload", False),
    )


def _metres(mm: float) -> float:
    return mm / 1000.0


def _vector(values: list[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)
