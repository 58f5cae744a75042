"""How far tools are from a goal, with the exact slopes and curvatures by which a descent gets there quickly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.newton import LEVER

TINY = 1e-12
"""rad: keeps turns by nothing out of divisions."""


@dataclass(frozen=True, eq=False)
class Farness:
    """K tools and a goal. Half of `square` is what descends.

    Attributes:
        pull: (K, 6), the way to the goal (m), and `LEVER`² times the least turn to it, a vector (m²), both in the
            base's frame: minus the gradient of square / 2 by the tool's motion (m) and turn (rad).
        angle: (K,), rad, that turn's size; of an approach, the angle between directions; else zero.
        square: (K,), m², of the distance and of `LEVER` times the angle, together.
        toward: (K, 3), the tool's z. axis: (K, 3), the unit vector that the turn is about, zero where there is none.
    """

    pull: Array
    angle: Array
    square: Array
    toward: Array
    axis: Array
    goal: Goal

    def curvature(self, J: Array) -> Array:
        """(K, n, n), the Hessian of square / 2 by joints, base first, with the Jacobian (K, 6, n) (m/rad above 1).

        A motion of an inner joint turns the screw of an outer one: ∂²p = a × (b × (p − o)), and ∂b = a × b.
        """
        v, w = J[:, :3].transpose(0, 2, 1), J[:, 3:].transpose(0, 2, 1)
        turned = v @ v.transpose(0, 2, 1)
        bent = _cross(self.pull[:, None, :3], w) @ v.transpose(0, 2, 1)
        if self.goal.rotation is not None:
            along = w @ self.axis[:, :, None]
            side = 0.5 * self.angle / np.tan(np.maximum(0.5 * self.angle, TINY))
            side = side[:, None, None]
            turned += LEVER**2 * (side * (w @ w.transpose(0, 2, 1)) + (1.0 - side) * (along @ along.transpose(0, 2, 1)))
            bent += 0.5 * (_cross(self.pull[:, None, 3:], w) @ w.transpose(0, 2, 1))
        elif self.goal.approach is not None:
            z, n = self.toward[:, None], self.axis[:, None]
            moved = _cross(w, z)
            ahead = moved @ _cross(n, z).transpose(0, 2, 1)
            aside = moved @ n.transpose(0, 2, 1)
            flat = (self.angle / np.tan(np.maximum(self.angle, TINY)))[:, None, None]
            turned += LEVER**2 * (ahead @ ahead.transpose(0, 2, 1) + flat * (aside @ aside.transpose(0, 2, 1)))
            pull = LEVER**2 * self.angle[:, None, None] * _cross(n, z)
            bent += _cross(pull, w) @ moved.transpose(0, 2, 1)
        upper = np.triu(bent)
        return np.asarray(turned - upper - np.triu(bent, 1).transpose(0, 2, 1))


def farness(tcp: Array, goal: Goal) -> Farness:
    """Of tool frames (K, 4, 4) from a goal."""
    count = len(tcp)
    pull = np.zeros((count, 6))
    pull[:, :3] = np.array(goal.position) - tcp[:, :3, 3]
    square = (pull[:, :3] ** 2).sum(axis=1)
    toward, axis, angle = tcp[:, :3, 2], np.zeros((count, 3)), np.zeros(count)
    if goal.rotation is not None:
        turn = np.array(goal.rotation) @ tcp[:, :3, :3].transpose(0, 2, 1)
        axis = 0.5 * np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
        )
        cosine = 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0)
    elif goal.approach is not None:
        axis = _cross(toward, np.array(goal.approach)[None])
        cosine = toward @ np.array(goal.approach)
    else:
        return Farness(pull, angle, square, toward, axis, goal)
    sine = np.sqrt((axis**2).sum(axis=1))
    angle = np.arctan2(sine, cosine)
    axis = axis / np.maximum(sine, TINY)[:, None]
    pull[:, 3:] = LEVER**2 * angle[:, None] * axis
    return Farness(pull, angle, square + (LEVER * angle) ** 2, toward, axis, goal)


def _cross(a: Array, b: Array) -> Array:
    """Cross products over the last axis, the others broadcast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
