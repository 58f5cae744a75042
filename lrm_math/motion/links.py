"""Links that swing behind their servos along a path: coupled with each other, their inertia that of each posture.

The equation of `modes`, in time: M_zz z̈ + D ż + K z = −M_zθ θ̈, by the midpoint rule with M constant over a step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.motion.modes import links_inertia, mean_inertia


@dataclass(frozen=True, eq=False)
class LinksAlongPath:
    """Inertia of the links of n joints in S moves of M steps.

    Attributes:
        inertia: (M, S, n, n), kg m². mean: (n,), of each joint alone over all postures.
    """

    inertia: Array
    mean: Array

    @staticmethod
    def of(arm: Arm, path: Array, substeps: int) -> LinksAlongPath:
        """Along angles `path` (S, T, n), rad, with so many steps to a frame."""
        S, T, n = path.shape
        inertia = links_inertia(arm, path[:, :-1].reshape(-1, n)).reshape(S, T - 1, n, n)
        return LinksAlongPath(np.repeat(inertia.swapaxes(0, 1), substeps, axis=0), np.diag(mean_inertia(arm)))

    def take(self, rows: NDArray[np.bool_]) -> LinksAlongPath:
        """Some of the moves; `rows`: (S,)."""
        return replace(self, inertia=self.inertia[:, rows])

    def deflections(self, servos: Array, soft: list[int], omega: Array, ratio: Array, h: float) -> Array:
        """(M + 1, P, S, k), rad, of k joints from rest, whose servos turn along (M + 1, P, S, n) at steps of h (s).

        Args:
            soft: the k joints, from 0. omega, ratio: (P, k), rad/s and damping ratio at the mean inertia.
        """
        springs, led = self.inertia[:, :, soft][:, :, :, soft], self.inertia[:, :, soft]
        stiff, damped = omega**2 * self.mean[soft], 2.0 * ratio * omega * self.mean[soft]
        pushed = np.linalg.solve(springs, led)  # (M, S, k, n)
        half = (0.5 * h * damped + 0.25 * h * h * stiff)[None, :, None]  # (1, P, 1, k)
        inverse = np.linalg.inv(springs[:, None] + half[..., None] * np.eye(len(soft)))
        jumps = np.diff(np.diff(servos, axis=0, prepend=servos[:1]), axis=0) / h
        thrown = np.einsum("mskn,mpsn->mpsk", pushed, jumps)
        out = np.zeros((len(servos), *servos.shape[1:3], len(soft)))
        speed, away, pull = np.zeros_like(out[0]), np.zeros_like(out[0]), h * stiff[:, None]
        for k in range(len(jumps)):
            speed = speed - thrown[k]
            force = (springs[k] @ speed[..., None])[..., 0] - half[0] * speed - pull * away
            then = (inverse[k] @ force[..., None])[..., 0]
            away = away + 0.5 * h * (speed + then)
            speed = then
            out[k + 1] = away
        return out
