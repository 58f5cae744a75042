"""Links that swing behind their servos along a path: coupled with each other, their inertia that of each posture.

The equation of `modes`, in time: M_zz z̈ + D ż + K z = −M_zθ θ̈, by the midpoint rule with M constant over a step.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.motion.modes import links_inertia, mean_inertia


@dataclass(frozen=True, eq=False)
class LinksAlongPath:
    """Inertia of the links of n joints in S moves of F frames, each of so many `substeps`.

    Attributes:
        inertia: (F, S, n, n), kg m², from each frame to the next. mean: (n,), of each joint alone over all postures.
    """

    inertia: Array
    mean: Array
    substeps: int
    _last: dict[tuple[object, ...], tuple[Array, Array]] = field(default_factory=dict)

    @staticmethod
    def of(arm: Arm, path: Array, substeps: int) -> LinksAlongPath:
        """Along angles `path` (S, T, n), rad, with so many steps to a frame."""
        S, T, n = path.shape
        inertia = links_inertia(arm, path[:, :-1].reshape(-1, n)).reshape(S, T - 1, n, n)
        return LinksAlongPath(inertia.swapaxes(0, 1), np.diag(mean_inertia(arm)), substeps)

    def take(self, rows: NDArray[np.bool_]) -> LinksAlongPath:
        """Some of the moves; `rows`: (S,)."""
        return replace(self, inertia=self.inertia[:, rows], _last={})

    def deflections(self, servos: Array, soft: list[int], omega: Array, ratio: Array, h: float) -> Array:
        """(M + 1, P, S, k), rad, of k joints from rest, whose servos turn along (M + 1, P, S, n) at steps of h (s).

        Args:
            soft: the k joints, from 0. omega, ratio: (P, k), rad/s and damping ratio at the mean inertia.
        """
        different, row = np.unique(np.concatenate([omega, ratio], axis=1), axis=0, return_inverse=True)
        row, k = row.reshape(-1), len(soft)
        steps, pushed = self._steps_and_pushes(soft, different, h)
        jumps = np.diff(np.diff(servos, axis=0, prepend=servos[:1]), axis=0) / h
        by_frame = jumps.reshape(len(self.inertia), -1, *jumps.shape[1:])
        thrown = np.einsum("fskn,fupsn->fupsk", pushed, by_frame, optimize=True)
        if len(different) == 1:  # all rows are columns of one product
            kicks, steps = np.moveaxis(thrown, 2, 4), steps[:, 0]  # (F, substeps, S, k, P)
        else:
            kicks = thrown[..., None]  # (F, substeps, P, S, k, 1)
        out = np.zeros((*by_frame.shape[:2], *kicks.shape[2:]))
        state = np.zeros((*kicks.shape[2:-2], 2 * k, kicks.shape[-1]))
        for frame, step in enumerate(steps):
            of_rows = step if len(different) == 1 else step[row]
            for sub in range(self.substeps):
                state[..., :k, :] -= kicks[frame, sub]
                state = of_rows @ state
                out[frame, sub] = state[..., k:, :]
        out = np.moveaxis(out, 4, 2) if len(different) == 1 else out[..., 0]
        return np.concatenate([np.zeros((1, *out.shape[2:])), out.reshape(-1, *out.shape[2:])])

    def _steps_and_pushes(self, soft: list[int], springs: Array, h: float) -> tuple[Array, Array]:
        """Steps (F, G, S, 2k, 2k) of G different springs, and what a turn of a servo is at a link, (F, S, k, n).

        Those of the last springs are kept: most candidates leave the links as they are.
        """
        key = (tuple(soft), springs.tobytes(), h)
        if key not in self._last:
            omega, ratio = np.split(springs, 2, axis=1)
            steps = self._steps(soft, omega, ratio, h)
            pushed = np.asarray(np.linalg.solve(self.inertia[:, :, soft][:, :, :, soft], self.inertia[:, :, soft]))
            self._last.clear()
            self._last[key] = steps, pushed
        return self._last[key]

    def _steps(self, soft: list[int], omega: Array, ratio: Array, h: float) -> Array:
        """(F, G, S, 2k, 2k), of speeds and deflections over a step, for (G, k) springs."""
        springs = self.inertia[:, None, :, soft][..., soft]
        stiff, damped = omega**2 * self.mean[soft], 2.0 * ratio * omega * self.mean[soft]
        eye = np.eye(len(soft))
        half = (0.5 * h * damped + 0.25 * h * h * stiff)[:, None, :, None] * eye
        inverse = np.linalg.inv(springs + half)
        kept, back = inverse @ (springs - half), -h * inverse * stiff[:, None, None]
        moved = np.concatenate([0.5 * h * (eye + kept), eye + 0.5 * h * back], axis=-1)
        return np.concatenate([np.concatenate([kept, back], axis=-1), moved], axis=-2)
