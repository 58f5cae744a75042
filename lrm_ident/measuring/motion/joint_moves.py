"""What one joint did in moves, and what was measured of it: its encoder, or a tip that other joints move, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.effects.base import Parameter
from lrm_math.effects.reference import ParameterRef
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.effects import AccelerationLimit, DriveLimit, ServoResponse, SpeedLimit
from lrm_math.motion.simulation import simulate

LIMITS = (SpeedLimit, AccelerationLimit, DriveLimit)
RANK = 1e-6
"""Relative singular value below which columns are one."""


def predicted(effects: Sequence[MotionEffect], rows: Array, drive: JointDrive, substeps: int) -> Array:
    """(P, S, T), readings (rad) at the frames, of a joint's effects for each row of parameters (P, p), SI."""
    values, at = [], 0
    for effect in effects:
        count = len(effect.parameters)
        values.append([rows[:, [k]] for k in range(at, at + count)])
        at += count
    return np.moveaxis(simulate(effects, values, drive)[::substeps], 0, 2)


@dataclass(frozen=True, eq=False)
class JointMoves:
    """What one joint did in S moves of T frames, and what was measured of it in m numbers a frame.

    Attributes:
        target: (S, T, m), what `lever` times the joint's angle should be. lever: (S, T, m), 1 of an encoder, m/rad of a
            tip. counted: (S, T), frames that count.
        beside: (S, T, m, k), what else moves the target, k columns to first order; none of an encoder.
    """

    drive: JointDrive
    target: Array
    lever: Array
    beside: Array
    counted: NDArray[np.bool_]
    substeps: int
    fold: NDArray[np.int64]

    def take(self, rows: NDArray[np.bool_]) -> JointMoves:
        """Some of the moves; `rows`: (S,)."""
        return JointMoves(
            self.drive.take(rows), self.target[rows], self.lever[rows], self.beside[rows], self.counted[rows],
            self.substeps, self.fold[rows],
        )  # fmt: skip

    def lower(self, effect: MotionEffect, parameter: Parameter) -> float:
        """Least value of a parameter (SI)."""
        del effect
        return parameter.lower

    def start(self, values: Mapping[str, float], added: MotionEffect) -> Mapping[str, float]:
        """Values (SI) to start from where an effect is added to a fit with known ones; those left out are scanned.

        A servo that was fitted without a limit is as slow as the limit made it.
        """
        if not isinstance(added, LIMITS):
            return values
        slow = str(ParameterRef(ServoResponse.id, added.place, ServoResponse.parameters[0].name))
        return {key: value for key, value in values.items() if key != slow}

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """(S,), numbers that count in each move."""
        return np.asarray(self.counted.sum(axis=1) * self.target.shape[2])

    @cached_property
    def _span(self) -> Array:
        """(N, r), orthonormal columns of what else moves the target."""
        columns = self.beside[self.counted].reshape(-1, self.beside.shape[3])
        scale = np.linalg.norm(columns, axis=0)
        U, size, _ = np.linalg.svd(columns / np.where(scale > 0.0, scale, 1.0), full_matrices=False)
        return np.asarray(U[:, size > RANK * max(size.max(initial=0.0), 1e-300)])

    def _others(self, error: Array) -> Array:
        """(k,), changes of what else moves the target that explain an error (N,) best."""
        columns = self.beside[self.counted].reshape(-1, self.beside.shape[3])
        scale = np.linalg.norm(columns, axis=0)
        scale = np.where(scale > 0.0, scale, 1.0)
        return np.asarray(np.linalg.lstsq(columns / scale, error, rcond=RANK)[0] / scale)

    def missed(self, effects: Sequence[MotionEffect], rows: Array) -> Array:
        """(P, S, T, m), target less prediction for each row of parameters (P, p), SI, all else as it is."""
        return self.target - self.lever * predicted(effects, rows, self.drive, self.substeps)[..., None]

    def error(self, missed: Array) -> Array:
        """(P, N), what is `missed` (P, S, T, m) at the counted frames."""
        return np.asarray(missed[:, self.counted].reshape(len(missed), -1))

    def residual(self, missed: Array) -> Array:
        """(P, N), the same, less what else may explain it."""
        error = self.error(missed)
        return error if not self.beside.shape[3] else error - (error @ self._span) @ self._span.T

    def held_out(self, missed: Array, others: JointMoves, missed_by_others: Array) -> Array:
        """(S,), mean square of each move of what is missed (S, T, m), all else as the `others`' moves show it."""
        error = self.error(missed[None])[0]
        if self.beside.shape[3]:
            change = others._others(others.error(missed_by_others[None])[0])
            error = error - self.beside[self.counted].reshape(len(error), -1) @ change
        squares = np.zeros(self.target.shape)
        squares[self.counted] = error.reshape(-1, self.target.shape[2]) ** 2
        return np.asarray(squares.sum(axis=(1, 2)) / np.maximum(self.count, 1))
