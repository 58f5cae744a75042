"""Fit of one joint's effects to moves: least squares of what the model predicts from commands alone.

What is measured is the joint's encoder, or a tip that other joints move, too: their first-order changes are projected
out of every residual (variable projection; Golub & Pereyra 1973). Standard errors are clustered by moves (sandwich of
Liang & Zeger 1986): residuals of one move are alike where an encoder's rounding stays the same at a stop.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtri, stdtrit

from lrm_ident.measuring.motion.joint_moves import JointMoves
from lrm_ident.measuring.motion.moves import FOLDS
from lrm_math.arrays import Array
from lrm_math.effects.base import Parameter
from lrm_math.motion.base import MotionEffect

DIFFERENCE = 1e-3
"""Step of the differences, in typical sizes: friction makes the prediction piecewise smooth."""
MOST_EVALUATIONS, SCREENING_EVALUATIONS, FOLD_EVALUATIONS = 25, 10, 4
TOLERANCE = 1e-5
MOST_STARTS = 24
UNSEEN = 1e-6
"""Of the strongest derivative, in typical sizes: a parameter with a weaker one stays as it is."""
LEAST_CLUSTERS = 5
"""Moves below which their scatter says nothing."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """Fitted effects of one joint.

    Attributes:
        values: (p,), SI. covariance: (p, p), as if none of them had bounds; zero rows where no move shows a parameter.
        residual: (S, T, m), NaN where none counts.
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
        """Sum of the squared residual (rad² or m²)."""
        return float(np.nansum(self.residual**2))

    @cached_property
    def held_out(self) -> Array:
        """(S,), mean squared error (rad² or m²) of each move, predicted by a fit without its fold."""
        data, out = self.data, np.empty(len(self.data.target))
        folds = [rows for fold in range(FOLDS) if (rows := data.fold == fold).any()]
        begun = data.missed(self.effects, _beside(self.effects, data, self.values))  # all folds begin with it
        kept = [data.take(~rows) for rows in folds]
        solutions = [
            _solve(self.effects, others, self.values, FOLD_EVALUATIONS, begun[:, ~rows])[0]
            for rows, others in zip(folds, kept, strict=True)
        ]
        for rows, others, missed in zip(folds, kept, data.missed(self.effects, np.array(solutions)), strict=True):
            out[rows] = data.take(rows).held_out(missed[rows], others, missed[~rows])
        return out

    @property
    def held_out_rms(self) -> float:
        """rad or m, over all counted frames of the held-out moves."""
        return float(np.sqrt(np.sum(self.held_out * self.data.count) / self.data.count.sum()))


def fit_joint(
    effects: Sequence[MotionEffect], data: JointMoves, values_known: Mapping[str, float], most: int = MOST_EVALUATIONS
) -> JointFit:
    """Fits effects of a joint. `values_known`: values to start from, by key (SI); others start at the best of scans.

    `most`: evaluations.
    """
    effects_of_joint = tuple(effects)
    start = _best_start(effects_of_joint, data, values_known)
    values, J, residual = _solve(effects_of_joint, data, start, most)
    parameters = [parameter for effect in effects_of_joint for parameter in effect.parameters]
    scale = np.array([p.typical for p in parameters])
    covariance = _clustered(J * scale, residual, data.count) * np.outer(scale, scale)
    error = np.full(data.target.shape, np.nan)
    error[data.counted] = residual.reshape(-1, data.target.shape[2])
    return JointFit(effects_of_joint, data, values, covariance, error)


def _lower(effects: Sequence[MotionEffect], data: JointMoves) -> Array:
    return np.array([data.lower(effect, parameter) for effect in effects for parameter in effect.parameters])


def _clustered(J: Array, residual: Array, count: NDArray[np.int64]) -> Array:
    """(p, p), covariance of least squares with derivatives (N, p) and residuals (N,) that are alike within a move.

    Moves follow one another by `count` (S,). A move that pulls the fit towards itself has a small residual, so each
    counts as it would be predicted without it (CR3, Bell & McCaffrey 2002; Cameron & Miller 2015), with the factor
    (G − 1) / G, and Student's for so few moves. Not below that of white noise.
    """
    N, p = J.shape
    counts = count[count > 0]
    inverse = np.linalg.pinv(J.T @ J, rcond=1e-12, hermitian=True)
    white = float(residual @ residual) / max(N - p, 1) * inverse
    if len(counts) < LEAST_CLUSTERS or not p:
        return np.asarray(white)
    begins = np.concatenate([[0], np.cumsum(counts)[:-1]])
    scores = np.add.reduceat(J * residual[:, None], begins, axis=0)
    shares = np.add.reduceat(J[:, :, None] * J[:, None], begins, axis=0) @ inverse
    scores = (np.linalg.pinv(np.eye(p) - shares, rcond=1e-6) @ scores[:, :, None])[:, :, 0]
    G = len(counts)
    few = (G - 1) / G * (stdtrit(G - 1, 0.975) / ndtri(0.975)) ** 2
    sandwich = few * inverse @ (scores.T @ scores) @ inverse
    least = np.diag(white)
    wider = np.sqrt(np.maximum(least / np.maximum(np.diag(sandwich), 1e-12 * least + 1e-300), 1.0))
    covariance = np.asarray(sandwich * np.outer(wider, wider))
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), least))  # one move alone may determine a parameter
    return covariance


def _best_start(effects: Sequence[MotionEffect], data: JointMoves, values: Mapping[str, float]) -> Array:
    """(p,), the best of the combinations of starting values."""
    choices = [
        (values[key],) if key in values else parameter.scan
        for effect in effects
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
    ]
    rows = np.array(list(itertools.islice(itertools.product(*choices), MOST_STARTS)))
    if len(rows) == 1:
        return np.asarray(rows[0])
    costs = np.sum(data.residual(data.missed(effects, rows)) ** 2, axis=1)
    return np.asarray(rows[int(np.nanargmin(costs))])


def _solve(
    effects: Sequence[MotionEffect], data: JointMoves, start: Array, most: int, begun: Array | None = None
) -> tuple[Array, Array, Array]:
    """Values (p,), derivatives of the prediction (N, p) and residual (N,) at the least squares.

    `begun`: what is missed with the rows `_beside` the start, where it is known.
    """
    lower, upper, typical = _bounds(effects, data)
    inside = np.clip(start, lower, upper) / typical

    @lru_cache(maxsize=2)
    def both(at: bytes) -> tuple[Array, Array]:
        """Residual and derivatives, by one-sided differences into the bounds, all simulated at once."""
        x = np.frombuffer(at)
        known = begun if at == inside.tobytes() else None
        residuals = data.residual(data.missed(effects, _beside(effects, data, x * typical)) if known is None else known)
        J = ((residuals[1:] - residuals[0]) / _sides(x, upper / typical)[:, None]).T
        size = np.linalg.norm(J, axis=0)
        return residuals[0], np.where(size > UNSEEN * size.max(initial=0.0), J, 0.0)

    def residual(x: Array) -> Array:
        return both(x.tobytes())[0]

    def derivative(x: Array) -> Array:
        return both(x.tobytes())[1]

    solution = least_squares(
        residual, inside, derivative, (lower / typical, upper / typical), method="trf",
        ftol=TOLERANCE, xtol=TOLERANCE, gtol=1e-12, max_nfev=most,
    )  # fmt: skip
    x = np.where(
        solution.active_mask < 0, lower / typical, np.where(solution.active_mask > 0, upper / typical, solution.x)
    )
    return x * typical, -np.asarray(solution.jac) / typical, np.asarray(solution.fun)


def _bounds(effects: Sequence[MotionEffect], data: JointMoves) -> tuple[Array, Array, Array]:
    """Least, largest and typical values (SI), (p,) each."""
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    return _lower(effects, data), np.array([p.upper for p in parameters]), np.array([p.typical for p in parameters])


def _sides(x: Array, upper: Array) -> Array:
    """(p,), steps of the differences, in typical sizes."""
    return np.where(x + DIFFERENCE > upper, -DIFFERENCE, DIFFERENCE)


def _beside(effects: Sequence[MotionEffect], data: JointMoves, values: Array) -> Array:
    """(p + 1, p), values (SI) inside their bounds, and those with one of them changed each."""
    lower, upper, typical = _bounds(effects, data)
    x = np.clip(values, lower, upper) / typical
    return np.asarray(np.concatenate([x[None], x + np.diag(_sides(x, upper / typical))]) * typical)
