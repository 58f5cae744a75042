"""How near did the bodies come, in every tick? Told by the board's log and the arm file, with no code of the guard.

Angles by the servo tables, Denavit-Hartenberg matrices, and points along each capsule's axis: the smallest distance of
such a point to a box or another axis, less the radii. The pulses are those of the board, rounded to its counts.
"""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from lrm_math.arrays import Array

POINTS = 25
"""Points along an axis."""
BLOCK = 2000
"""Poses at once."""


@dataclass(frozen=True)
class PermittedTime:
    """From `start` to `end` (s of the board's clock) pairs with the ground may overlap by `depths` (m, by name) while
    the tip is between `low` and `high` (m)."""

    start: float
    end: float
    low: Array
    high: Array
    depths: dict[str, float]


@dataclass(frozen=True)
class DistanceResult:
    """Ticks looked at, how many of them broke the rule, the smallest spare distance (m, against what is required), its
    pair, and the tolerance (m) for the board's rounding."""

    ticks: int
    violations: int
    least_spare: float
    pair: str
    tolerance: float


def ticks_of(log: Path, config: Any) -> tuple[Array, Array]:
    """Times (N,), s, and angles (N, n), rad, of the frames of a board's log in which all joints have pulses."""
    servos = config.servos[: config.dof]
    with log.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["event"] == "arm"]
    counts = np.array([[float(row[f"ch{s.channel}"] or 0) for s in servos] for row in rows])
    on = (counts > 0).all(axis=1)
    pulses, t = counts[on] * config.clock.count_s, np.array([float(row["t_ns"]) * 1e-9 for row in rows])[on]
    return t, np.stack([np.interp(p, s.table.pulse, s.table.angle) for p, s in zip(pulses.T, servos, strict=True)], 1)


def check(arm_file: Path, t: Array, q: Array, permitted: Sequence[PermittedTime], count_rad: float) -> DistanceResult:
    """Checks every tick (N,), s, of angles (N, n), rad; `count_rad`: angle of one of the board's counts."""
    arm = tomllib.loads(arm_file.read_text(encoding="utf-8"))
    margin = arm["collision"]["margin_mm"] * 1e-3
    links = [np.hypot(j["a_mm"], j["d_mm"] + j.get("extra_z_mm", 0.0)) * 1e-3 for j in arm["joint"]]
    tool = float(np.linalg.norm([arm["tool"].get(f"{axis}_mm", 0.0) for axis in "xyz"])) * 1e-3
    tolerance = 0.5 * count_rad * float(sum(sum(links[k:]) + tool for k in range(len(links))))
    violations, least, pair = 0, np.inf, ""
    for first in range(0, len(q), BLOCK):
        block = slice(first, first + BLOCK)
        frames = frames_of(arm, q[block])
        tips = frames[-1][:, :3, 3]
        spare = {
            names: apart - required(names, t[block], tips, permitted, margin)
            for names, apart in distances(arm, frames).items()
        }
        violations += int((np.min([*spare.values()], axis=0) < -tolerance).sum())
        nearest = min(spare, key=lambda names: float(spare[names].min()))
        if spare[nearest].min() < least:
            least, pair = float(spare[nearest].min()), " and ".join(nearest)
    return DistanceResult(len(q), violations, least, pair, tolerance)


def required(names: tuple[str, str], t: Array, tips: Array, permitted: Sequence[PermittedTime], margin: float) -> Array:
    """(N,), m, that a pair has to keep at times (N,), s, with tips (N, 3), m."""
    out = np.full(len(t), margin)
    for time in permitted if names[1] == "ground" else ():
        if names[0] in time.depths:
            inside = ((tips > time.low) & (tips < time.high)).all(axis=1)
            out[inside & (t >= time.start) & (t <= time.end)] = -time.depths[names[0]]
    return out


def frames_of(arm: dict[str, Any], q: Array) -> list[Array]:
    """Frames (N, 4, 4), m: base, end of each link, tool, of angles (N, n), rad."""
    base, tool = arm["base"], arm["tool"]
    frame = _move(base) @ _turned(base)
    out = [np.repeat(frame[None], len(q), axis=0)]
    for number, joint in enumerate(arm["joint"]):
        turn = np.array([_about(2, angle) for angle in np.radians(joint["theta_deg"]) + q[:, number]])
        rest = _along(joint["a_mm"], 0, joint["d_mm"]) @ _about(0, np.radians(joint["alpha_deg"]))
        out.append(out[-1] @ turn @ rest @ _along(0, 0, joint.get("extra_z_mm", 0.0)))
    out.append(out[-1] @ _turned(tool) @ _move(tool))
    return out


def distances(arm: dict[str, Any], frames: list[Array]) -> dict[tuple[str, str], Array]:
    """Distance (N,), m, of every pair that may collide."""
    ignored = {frozenset(pair) for pair in arm["collision"]["ignore"]}
    numbers = {"base": 0, "tool": len(frames) - 1} | {f"joint{i}": i for i in range(1, len(frames) - 1)}
    at = {c["name"]: numbers[c["frame"]] for c in arm["capsule"]}
    radius = {c["name"]: c["radius_mm"] * 1e-3 for c in arm["capsule"]}
    axis = {c["name"]: _points(frames[at[c["name"]]], c["from_mm"], c["to_mm"]) for c in arm["capsule"]}
    found = {}
    for a, b in combinations(at, 2):
        if abs(at[a] - at[b]) > 1 and frozenset((a, b)) not in ignored:
            found[a, b] = _between(axis[a], axis[b]) - radius[a] - radius[b]
    for box in arm["box"]:
        for name in at:
            if at[name] > 1 and frozenset((name, box["name"])) not in ignored:
                found[name, box["name"]] = _to_box(axis[name], box, frames[0]) - radius[name]
    return found


def _points(frame: Array, start: Sequence[float], end: Sequence[float]) -> Array:
    """(N, POINTS, 3), m, along an axis."""
    along = np.linspace(0.0, 1.0, POINTS)[:, None]
    local = 1e-3 * (np.array(start) + along * (np.array(end) - np.array(start)))
    return np.asarray(np.einsum("nij,pj->npi", frame[:, :3, :3], local) + frame[:, None, :3, 3])


def _between(points: Array, other: Array) -> Array:
    """(N,), smallest distance of points (N, P, 3) to the segment through others (N, P, 3)."""
    start, along = other[:, :1], other[:, -1:] - other[:, :1]
    share = ((points - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.asarray(np.linalg.norm(points - nearest, axis=-1).min(axis=1))


def _to_box(points: Array, box: dict[str, Any], base: Array) -> Array:
    """(N,), smallest distance of points (N, P, 3) to a box; below zero inside."""
    frame = base[0] if box.get("frame") == "base" else np.eye(4)
    local = (points - frame[:3, 3]) @ frame[:3, :3] - 1e-3 * np.array(box["center_mm"])
    beyond = np.abs(local) - 0.5e-3 * np.array(box["size_mm"])
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray((outside + np.minimum(beyond.max(axis=-1), 0.0)).min(axis=1))


def _about(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(4)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out


def _along(x: float, y: float, z: float) -> Array:
    out = np.eye(4)
    out[:3, 3] = 1e-3 * np.array([x, y, z])
    return out


def _move(place: dict[str, float]) -> Array:
    return _along(*(place.get(f"{axis}_mm", 0.0) for axis in "xyz"))


def _turned(place: dict[str, float]) -> Array:
    a, b, c = (np.radians(place.get(f"{angle}_deg", 0.0)) for angle in ("alpha", "beta", "gamma"))
    return np.asarray(_about(0, a) @ _about(1, b) @ _about(2, c))
