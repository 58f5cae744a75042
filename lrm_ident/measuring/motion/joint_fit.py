"""Fit of one joint's effects to moves: least squares of what the model predicts from commands alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from lrm_ident.measuring.motion.moves import FOLDS, Moves
from lrm_math.arrays import Array
from lrm_math.effects.base import Parameter
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.simulation import simulate

DIFFERENCE = 1e-3
"""Step of the differences, in typical sizes: friction makes the prediction piecewise smooth."""
MOST_EVALUATIONS, SCREENING_EVALUATIONS, FOLD_EVALUATIONS = 25, 10, 4
TOLERANCE = 1e-5
MOST_STARTS = 24


@dataclass(frozen=True, eq=False)
class JointMoves:
    """What one joint did in S moves: its drive, readings (S, T) in rad, and which of them count."""

    drive: JointDrive
    reading: Array
    counted: NDArray[np.bool_]
    substeps: int
    fold: NDArray[np.int64]

    @staticmethod
    def of(moves: Moves, joint: int) -> JointMoves:
        """Those of a joint from 0."""
        return JointMoves(moves.drive(joint), moves.reading[:, :, joint], moves.counted, moves.substeps, moves.fold)

    def take(self, rows: NDArray[np.bool_]) -> JointMoves:
        """Some of the moves; `rows`: (S,)."""
        drive, reading, counted = self.drive.take(rows), self.reading[rows], self.counted[rows]
        return JointMoves(drive, reading, counted, self.substeps, self.fold[rows])

    def predicted(self, effects: Sequence[MotionEffect], rows: Array) -> Array:
        """(P, S, T), readings (rad) that the model predicts for each row of parameters (P, p), SI."""
        values, at = [], 0
        for effect in effects:
            count = len(effect.parameters)
            values.append([rows[:, [k]] for k in range(at, at + count)])
            at += count
        found = simulate(effects, values, self.drive)
        return np.moveaxis(found[:: self.substeps], 0, 2)

    def residual(self, effects: Sequence[MotionEffect], rows: Array) -> Array:
        """(P, N), reading less prediction (rad) at the counted frames."""
        return np.asarray((self.reading - self.predicted(effects, rows))[:, self.counted])


@dataclass(frozen=True, eq=False)
class JointFit:
    """Fitted effects of one joint.

    Attributes:
        values: (p,), SI. covariance: (p, p); zero rows at a bound. residual: (S, T), rad, NaN where none counts.
    """

    effects: tuple[MotionEffect, ...]
    data: JointMoves
    values: Array
    covariance: Array
    residual: Array

    @property
    def parameters(self) -> list[Parameter]:
        """Of all effects, in the order of `values`."""
        return [parameter for effect in self.effects for parameter in effect.parameters]

    @property
    def keys(self) -> list[str]:
        """Of all effects, in the order of `values`."""
        return [key for effect in self.effects for key in effect.keys]

    @property
    def by_key(self) -> dict[str, float]:
        """Values by key (SI)."""
        return dict(zip(self.keys, self.values.tolist(), strict=True))

    @property
    def sigma(self) -> dict[str, float]:
        """Standard errors by key (SI)."""
        return dict(zip(self.keys, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def squares(self) -> float:
        """Sum of the squared residual (rad²)."""
        return float(np.nansum(self.residual**2))

    @cached_property
    def held_out(self) -> Array:
        """(S,), mean squared error (rad²) of each move, predicted by a fit without its fold."""
        out = np.empty(len(self.data.reading))
        for fold in range(FOLDS):
            rows = self.data.fold == fold
            if not rows.any():
                continue
            known = _solve(self.effects, self.data.take(~rows), self.values, FOLD_EVALUATIONS)[0]
            own = self.data.take(rows)
            error = own.reading - own.predicted(self.effects, known[None])[0]
            out[rows] = np.nanmean(np.where(own.counted, error**2, np.nan), axis=1)
        return out

    @property
    def held_out_rms(self) -> float:
        """rad, over all counted frames of the held-out moves."""
        count = self.data.counted.sum(axis=1)
        return float(np.sqrt(np.sum(self.held_out * count) / count.sum()))


def fit_joint(
    effects: Sequence[MotionEffect], data: JointMoves, known: Mapping[str, float], most: int = MOST_EVALUATIONS
) -> JointFit:
    """Fits effects of a joint. `known`: values to start from, by key (SI); others start at the best of their scans.

    `most`: evaluations.
    """
    own = tuple(effects)
    start = _best_start(own, data, known)
    values, J, residual = _solve(own, data, start, most)
    parameters = [parameter for effect in own for parameter in effect.parameters]
    free = np.array([p.lower < v < p.upper for p, v in zip(parameters, values.tolist(), strict=True)])
    covariance = np.zeros((len(values), len(values)))
    scale = np.array([p.typical for p in parameters])[free]
    normal = (J[:, free] * scale).T @ (J[:, free] * scale)
    variance = float(residual @ residual) / max(len(residual) - len(values), 1)
    covariance[np.ix_(free, free)] = (
        variance * np.linalg.pinv(normal, rcond=1e-12, hermitian=True) * np.outer(scale, scale)
    )
    error = np.full(data.reading.shape, np.nan)
    error[data.counted] = residual
    return JointFit(own, data, values, covariance, error)


def _best_start(effects: Sequence[MotionEffect], data: JointMoves, known: Mapping[str, float]) -> Array:
    """(p,), the best of the combinations of starting values."""
    choices = [
        (known[key],) if key in known else parameter.scan
        for effect in effects
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
    ]
    rows = np.array(list(itertools.islice(itertools.product(*choices), MOST_STARTS)))
    if len(rows) == 1:
        return np.asarray(rows[0])
    costs = np.sum(data.residual(effects, rows) ** 2, axis=1)
    return np.asarray(rows[int(np.nanargmin(costs))])


def _solve(effects: Sequence[MotionEffect], data: JointMoves, start: Array, most: int) -> tuple[Array, Array, Array]:
    """Values (p,), derivatives of the prediction (N, p) and residual (N,) at the least squares."""
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    lower, upper = (np.array([getattr(p, name) for p in parameters]) for name in ("lower", "upper"))
    typical = np.array([p.typical for p in parameters])

    @lru_cache(maxsize=2)
    def both(at: bytes) -> tuple[Array, Array]:
        """Residual and derivatives, by one-sided differences into the bounds, all simulated at once."""
        x = np.frombuffer(at)
        side = np.where(x + DIFFERENCE > upper / typical, -DIFFERENCE, DIFFERENCE)
        found = data.residual(effects, np.concatenate([x[None], x + np.diag(side)]) * typical)
        return found[0], ((found[1:] - found[0]) / side[:, None]).T

    def residual(x: Array) -> Array:
        return both(x.tobytes())[0]

    def derivative(x: Array) -> Array:
        return both(x.tobytes())[1]

    inside = np.clip(start, lower, upper) / typical
    found = least_squares(
        residual, inside, derivative, (lower / typical, upper / typical), method="trf",
        ftol=TOLERANCE, xtol=TOLERANCE, gtol=1e-12, max_nfev=most,
    )  # fmt: skip
    x = np.where(found.active_mask < 0, lower / typical, np.where(found.active_mask > 0, upper / typical, found.x))
    return x * typical, -np.asarray(found.jac) / typical, np.asarray(found.fun)
