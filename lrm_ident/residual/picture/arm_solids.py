"""Links of an arm as solids to draw: the capsules of its collision shapes, or tubes where its file has none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array, Vector3

THICKNESS, TAPER = 0.035, 0.6
"""Radius of the first tube in parts of the arm's length; radius of the last one in parts of the first."""


@dataclass(frozen=True)
class ArmSolids:
    """Capsules between points of an arm: the origins of its n + 2 frames, base to TCP, then `points`.

    Attributes:
        points: the frame (0 base, i after joint i, n + 1 tool) and the place in it (m) of every further point.
        links: numbers of the two points of every capsule, and its radius (m).
        shaped: whether the arm's file gives the shapes; else tubes are drawn from origin to origin.
    """

    points: tuple[tuple[int, Vector3], ...]
    links: tuple[tuple[int, int, float], ...]
    shaped: bool


def arm_solids(arm: Arm, frames: Array) -> ArmSolids:
    """The solids of an arm. `frames`: (n + 2, 4, 4), in any pose (m)."""
    if arm.shapes.capsules:
        return _capsules(arm)
    lengths = np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1)
    first = THICKNESS * float(lengths.sum())
    taper = np.linspace(1.0, TAPER, len(lengths))
    tubes = ((i, i + 1, float(first * taper[i])) for i in range(len(lengths)) if lengths[i] > 0.1 * first)
    return ArmSolids((), tuple(tubes), shaped=False)


def _capsules(arm: Arm) -> ArmSolids:
    points: dict[tuple[int, Vector3], int] = {(i, (0.0, 0.0, 0.0)): i for i in range(len(arm.frame_names))}
    links = tuple(
        (
            points.setdefault((capsule.frame, capsule.start), len(points)),
            points.setdefault((capsule.frame, capsule.end), len(points)),
            capsule.radius,
        )
        for capsule in arm.shapes.capsules
    )
    return ArmSolids(tuple(points)[len(arm.frame_names) :], links, shaped=True)


def placed(solids: ArmSolids, frames: Array) -> Array:
    """(N, K, 3), the K further points in frames (N, n + 2, 4, 4); m."""
    out = np.empty((len(frames), len(solids.points), 3))
    for k, (frame, point) in enumerate(solids.points):
        out[:, k] = frames[:, frame, :3, :3] @ np.array(point) + frames[:, frame, :3, 3]
    return out
