"""Pose error of tool frames from a goal, with its exact gradient and Hessian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.newton import CHAR_LENGTH

TINY = 1e-12
"""rad: avoids division by a zero rotation."""


@dataclass(frozen=True, eq=False)
class PoseError:
    """Errors of K tool frames from a goal.

    `pull`: (K, 6), displacement to the goal (m), and `CHAR_LENGTH`² times the rotation vector to it (m²), base frame:
    minus the gradient of square / 2 by the tool's displacement (m) and rotation (rad). `angle`: (K,), rad, of that
    rotation; for an approach the angle between directions; else zero. `square`: (K,), m², sum of squares of the
    distance and of `CHAR_LENGTH` times the angle. `toward`: (K, 3), the tool's z. `axis`: (K, 3), unit vector of the
    rotation, zero where there is none.
    """

    pull: Array
    angle: Array
    square: Array
    toward: Array
    axis: Array
    goal: Goal

    def curvature(self, J: Array) -> Array:
        """(K, n, n), the Hessian of square / 2 by joints, base first, with the Jacobian (K, 6, n) (m/rad above 1).

        A motion of an inboard joint turns the screw of an outboard one: ∂²p = a × (b × (p − o)), and ∂b = a × b.
        """
        v, w = J[:, :3].transpose(0, 2, 1), J[:, 3:].transpose(0, 2, 1)
        turned = v @ v.transpose(0, 2, 1)
        bent = _cross(self.pull[:, None, :3], w) @ v.transpose(0, 2, 1)
        if self.goal.rotation is not None:
            along = w @ self.axis[:, :, None]
            side = 0.5 * self.angle / np.tan(np.maximum(0.5 * self.angle, TINY))
            side = side[:, None, None]
            turned += CHAR_LENGTH**2 * (
                side * (w @ w.transpose(0, 2, 1)) + (1.0 - side) * (along @ along.transpose(0, 2, 1))
            )
            bent += 0.5 * (_cross(self.pull[:, None, 3:], w) @ w.transpose(0, 2, 1))
        elif self.goal.approach is not None:
            z, n = self.toward[:, None], self.axis[:, None]
            moved = _cross(w, z)
            ahead = moved @ _cross(n, z).transpose(0, 2, 1)
            aside = moved @ n.transpose(0, 2, 1)
            flat = (self.angle / np.tan(np.maximum(self.angle, TINY)))[:, None, None]
            turned += CHAR_LENGTH**2 * (ahead @ ahead.transpose(0, 2, 1) + flat * (aside @ aside.transpose(0, 2, 1)))
            pull = CHAR_LENGTH**2 * self.angle[:, None, None] * _cross(n, z)
            bent += _cross(pull, w) @ moved.transpose(0, 2, 1)
        upper = np.triu(bent)
        return np.asarray(turned - upper - np.triu(bent, 1).transpose(0, 2, 1))


def pose_error(tcp: Array, goal: Goal) -> PoseError:
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
        return PoseError(pull, angle, square, toward, axis, goal)
    sine = np.sqrt((axis**2).sum(axis=1))
    angle = np.arctan2(sine, cosine)
    axis = axis / np.maximum(sine, TINY)[:, None]
    pull[:, 3:] = CHAR_LENGTH**2 * angle[:, None] * axis
    return PoseError(pull, angle, square + (CHAR_LENGTH * angle) ** 2, toward, axis, goal)


def _cross(a: Array, b: Array) -> Array:
    """Cross products over the last axis, the others broadcast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
