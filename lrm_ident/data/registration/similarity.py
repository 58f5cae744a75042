"""Similarity transformation between two clouds of points (Umeyama 1991); rotation alone: Kabsch (1976)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.rigid_motion import skew
from lrm_math.arrays import Array

ROBUST_PASSES = 4
LINE = 1e-3
"""m: points that lie nearer to one line do not show a turn about it."""
MAD_TO_SD = 1.0 / 1.538  # of the norm of an isotropic normal vector in space


@dataclass(frozen=True, eq=False)
class Similarity:
    """x ↦ scale · rotation @ x + translation (m). `rotation`: (3, 3), orthogonal; its determinant is −1 if mirrored."""

    rotation: Array
    translation: Array
    scale: float = 1.0

    def apply(self, points: Array) -> Array:
        """(N, 3), the image of points (N, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def similarity(source: Array, target: Array, weight: Array, mirrored: bool, scale: float | None = None) -> Similarity:
    """The least-squares similarity that takes `source` to `target`, (N, 3) each in m, weights (N,) (Umeyama 1991).

    Args:
        mirrored: whether the rotation is to be a rotary reflection.
        scale: the given scale; None: the best one.
    """
    share = weight / weight.sum()
    centre, goal = share @ source, share @ target
    x, y = source - centre, target - goal
    U, D, Vt = np.linalg.svd((y * share[:, None]).T @ x)
    S = np.ones(3)
    S[2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt)) * (-1.0 if mirrored else 1.0)
    rotation = (U * S) @ Vt
    spread = float(share @ (x**2).sum(axis=1))
    factor = (float(D @ S) / spread if spread > 0 else 1.0) if scale is None else scale
    return Similarity(rotation, goal - factor * rotation @ centre, factor)


def robust_similarity(source: Array, target: Array, mirrored: bool, scale: float | None = None) -> Similarity:
    """Similarity with the weights of a Cauchy loss at the scale of the median residual: wrong points count little."""
    weight = np.ones(len(source))
    for _ in range(ROBUST_PASSES):
        motion = similarity(source, target, weight, mirrored, scale)
        weight = cauchy_weight(np.linalg.norm(target - motion.apply(source), axis=1))
    return motion


def cauchy_weight(distance: Array) -> Array:
    """(N,), weights 1 / (1 + (d/s)²) of distances (N,), s being three times their robust standard deviation."""
    scale = 3.0 * MAD_TO_SD * float(np.median(distance))
    return np.ones_like(distance) if scale == 0.0 else np.asarray(1.0 / (1.0 + (distance / scale) ** 2))


def rigid_motion_between(source: Array, target: Array, turns: bool) -> Similarity:
    """The rigid motion that takes points (N, 3) to others (m): a shift of what does not turn, else by Kabsch 1976; the
    smallest one of points on a line."""
    centre, goal = source.mean(axis=0), target.mean(axis=0)
    rotation = np.eye(3)
    if turns:
        _, size, Vt = np.linalg.svd(source - centre)
        if size[1] > LINE:
            return robust_similarity(source, target, mirrored=False, scale=1.0)
        if size[0] > LINE:
            rotation = _smallest_turn(Vt[0], (target - goal).T @ ((source - centre) @ Vt[0]))
    return Similarity(rotation, goal - rotation @ centre)


def _smallest_turn(first: Array, second: Array) -> Array:
    """(3, 3), rotation of one direction to another."""
    u, v = first / np.linalg.norm(first), second / np.linalg.norm(second)
    K, cosine = skew(np.cross(u, v)), float(u @ v)
    return np.asarray(np.eye(3) + K + K @ K / max(1.0 + cosine, 1e-9))
