"""The arm as its description file (schema `lrm/arm/1`) gives it, in SI units."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .screws import rotation_matrix

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class FramePlacement:
    """Pose of the base in the world or of the TCP on the last link: m, and angles about its own x, y, z in rad."""

    xyz_m: Vector3
    angles_rad: Vector3


@dataclass(frozen=True)
class LinkDescription:
    """Denavit-Hartenberg parameters of a link (theta, d, a, alpha, beta about y, then extra z); its joint's limits."""

    theta_rad: float
    d_m: float
    a_m: float
    alpha_rad: float
    extra_z_m: float
    limits_rad: tuple[float, float]
    beta_rad: float = 0.0


@dataclass(frozen=True)
class BodyDescription:
    """A rigid mass. frame: 0 base, 1..N the end of that link, N + 1 the tool.

    com_m is given in that frame, or, if near_end, in the frame before its last translation along z.
    loads_joint is the most distal joint whose torque includes the body.
    """

    name: str
    mass_kg: float
    com_m: Vector3
    frame: int
    loads_joint: int
    near_end: bool = False
    carries_payload: bool = False


@dataclass(frozen=True)
class ArmDescription:
    """A serial arm: base, links 1..N, tool, bodies, and gravity in world axes in m/s2."""

    name: str
    gravity_m_per_s2: Vector3
    base: FramePlacement
    links: tuple[LinkDescription, ...]
    tool: FramePlacement
    bodies: tuple[BodyDescription, ...]

    def tilted(self, turn_rad: ArrayLike) -> ArmDescription:
        """The arm under gravity that is turned by a rotation vector (3,) in world axes."""
        gravity = rotation_matrix(turn_rad) @ np.array(self.gravity_m_per_s2)
        return replace(self, gravity_m_per_s2=_vector(gravity.tolist()))


def load_arm(path: str | Path) -> ArmDescription:
    """Read an arm description (mm, g and deg in the file)."""
    data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    links = tuple(_link(entry) for entry in data["joint"])
    return ArmDescription(
        name=data["name"],
        gravity_m_per_s2=_vector(data["gravity_m_per_s2"]),
        base=_placement(data["base"]),
        links=links,
        tool=_placement(data["tool"]),
        bodies=tuple(_body(entry, len(links)) for entry in data["body"]),
    )


def _placement(entry: dict[str, Any]) -> FramePlacement:
    return FramePlacement(
        _vector([entry.get(f"{name}_mm", 0.0) / 1000.0 for name in "xyz"]),
        _vector([math.radians(entry.get(f"{name}_deg", 0.0)) for name in ("alpha", "beta", "gamma")]),
    )


def _link(entry: dict[str, Any]) -> LinkDescription:
    low, high = entry["limits_deg"]
    return LinkDescription(
        theta_rad=math.radians(entry.get("theta_deg", 0.0)),
        d_m=entry.get("d_mm", 0.0) / 1000.0,
        a_m=entry.get("a_mm", 0.0) / 1000.0,
        alpha_rad=math.radians(entry.get("alpha_deg", 0.0)),
        extra_z_m=entry.get("extra_z_mm", 0.0) / 1000.0,
        limits_rad=(math.radians(low), math.radians(high)),
        beta_rad=math.radians(entry.get("beta_deg", 0.0)),
    )


def _body(entry: dict[str, Any], joints: int) -> BodyDescription:
    names = ["base", *(f"joint{number}" for number in range(1, joints + 1)), "tool"]
    return BodyDescription(
        name=entry["name"],
        mass_kg=entry["mass_g"] / 1000.0,
        com_m=_vector([value / 1000.0 for value in entry["com_mm"]]),
        frame=names.index(entry["frame"]),
        loads_joint=entry["loads_joint"],
        near_end=entry.get("com_from") == "near_end",
        carries_payload=entry.get("carries_payload", False),
    )


def _vector(values: list[float]) -> Vector3:
    x, y, z = values
    return float(x), float(y), float(z)
