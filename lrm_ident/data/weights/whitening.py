"""Weights of what was measured: rows of each pose divided by their noise, correlations included (Aitken 1936).

In a fit, its loss weighs whole poses beside that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.observations.observation import Observation
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.sensed import TCP_ONLY, Sensed


@dataclass(frozen=True, eq=False)
class Whitening:
    """Weighting of the rows of N poses.

    Attributes:
        sd: (N,), standard deviation per axis of each position, of the distance where there is no position (m); None if
            it is the same for all, and not stated.
        root: (N, R, R), W with WᵀW the inverse of the covariance of a pose's rows (1/m, 1/rad), zero where a row was
            not measured; None if positions alone were, alike along all axes.
        sensed: which rows there are.
    """

    sd: Array | None = None
    root: Array | None = None
    sensed: Sensed = TCP_ONLY

    @cached_property
    def unit(self) -> float:
        """RMS of sd (m): what one unit of the noise is as a length; one where no sd is stated."""
        return 1.0 if self.sd is None else float(np.sqrt(np.mean(self.sd**2)))

    @cached_property
    def factor(self) -> Array:
        """(N, 1) or (1, 1), 1/sd of each pose."""
        return np.ones((1, 1)) if self.sd is None else 1.0 / self.sd[:, None]

    @cached_property
    def measured(self) -> Array | float:
        """(N,), number of rows of each pose that were measured, or one number for all."""
        return 3.0 if self.root is None else np.count_nonzero(np.einsum("nrr->nr", self.root), axis=1).astype(float)

    def rows(self, dof: int) -> int:
        """Number of rows R of one pose."""
        return self.sensed.rows(dof)

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Whitening:
        """Weights of some poses."""
        sd, root = (None if part is None else part[rows] for part in (self.sd, self.root))
        return replace(self, sd=sd, root=root)

    def __call__(self, rows: Array) -> Array:
        """Rows (N, R) or (N, R, P) in units of their noise (of metres where none is stated)."""
        if self.root is None:
            return rows if self.sd is None else rows * (self.factor if rows.ndim == 2 else self.factor[:, :, None])
        return np.asarray(np.einsum("nrs,ns...->nr...", self.root, rows))

    def undone(self, rows: Array) -> Array:
        """(N, 3), the positions (m) of whitened rows (N, R) of which all parts were measured."""
        if self.root is None:
            return rows / self.factor
        return np.asarray((np.linalg.pinv(self.root) @ rows[:, :, None])[:, :3, 0])

    def jacobian(self, settled: Equilibrium, keys: Sequence[str]) -> Array:
        """(N, R, P), whitened derivatives of what was measured with respect to parameters (SI)."""
        return self(parameter_jacobian(settled, keys, self.sensed))


@dataclass(frozen=True, eq=False)
class RowWeights:
    """Weights of R rows of each of N poses, of mean square near one. `loss`: (N,), weight of each pose in the fit."""

    whitening: Whitening
    loss: Array

    @cached_property
    def _each(self) -> Array:
        """(3 N, 1), of positions that are alike along all axes."""
        sd = self.whitening.sd
        weights = np.ones(len(self.loss)) if sd is None else self.whitening.unit / sd
        return np.repeat(weights * np.sqrt(self.loss), 3)[:, None]

    def __call__(self, columns: Array) -> Array:
        """Weighted columns (R N, m)."""
        if self.whitening.root is None:
            return columns * self._each
        rows = columns.reshape(len(self.loss), len(columns) // len(self.loss), columns.shape[1])  # no column, too
        weight = self.whitening.unit * np.sqrt(self.loss)[:, None, None]
        return (self.whitening(rows) * weight).reshape(columns.shape)

    def positions(self, rows: Array) -> Array:
        """(N, 3), the positions (m) of weighted rows (R N,)."""
        if self.whitening.root is None:
            return (rows[:, None] / self._each).reshape(-1, 3)
        weight = self.whitening.unit * np.sqrt(self.loss)[:, None]
        return self.whitening.undone(rows.reshape(len(self.loss), -1) / weight)


PLAIN = Whitening()
"""Positions alone, all alike."""


def joint_covariance(observations: Sequence[Observation]) -> Array:
    """(N, R, R), lower triangles of the covariance of all that was measured of each pose (SI), positions first; NaN on
    the diagonal: not measured."""
    blocks = [observation.covariance for observation in observations]
    out = np.zeros((len(blocks[0]), *[sum(block.shape[1] for block in blocks)] * 2))
    end = 0
    for each, block in zip(observations, blocks, strict=True):
        rows = slice(end, end := end + block.shape[1])
        out[:, rows, :3] = each.cross
        out[:, rows, rows] = block
    return out


def joint_root(observations: Sequence[Observation]) -> Array:
    """(N, R, R), root of the weights of all that was measured, positions first: of those that are correlated with them
    together, of every other one by itself."""
    counts = [observation.numbers.shape[1] for observation in observations]
    rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    together = [k for k, observation in enumerate(observations) if k == 0 or isinstance(observation.cross, np.ndarray)]
    out = np.zeros((len(observations[0].values), sum(counts), sum(counts)))
    for group in (together, *([k] for k in range(len(counts)) if k not in together)):
        rows_together = np.concatenate([rows[k] for k in group])
        out[:, rows_together[:, None], rows_together] = root_of(joint_covariance([observations[k] for k in group]))
    return out


def known_part(covariance: Array) -> Array:
    """(N, R, R), covariances with ones instead of what was not measured, NaN on the diagonal."""
    missing = np.isnan(np.einsum("nrr->nr", covariance))
    kept = np.where(missing[:, :, None] | missing[:, None, :], 0.0, covariance)
    return np.asarray(kept + missing[:, :, None] * np.eye(missing.shape[1]))


def root_of(covariance: Array) -> Array:
    """(N, R, R), W with WᵀW = C⁻¹ of covariances (N, R, R), of which the lower triangle is read; NaN on the diagonal:
    not measured, zero in W."""
    root = np.linalg.inv(np.linalg.cholesky(known_part(covariance)))
    return np.asarray(np.where(np.isnan(np.einsum("nrr->nr", covariance))[:, :, None], 0.0, root))


def measured_alike(whitening: Whitening) -> Callable[[Poses], Whitening]:
    """Weights of poses that are measured as others were: each has as much information as one of those on average.

    `whitening`: weights of N poses. Parts that some of them lack count accordingly.
    """
    root = None
    if whitening.root is not None:
        values, vectors = np.linalg.eigh(np.einsum("nrs,nrt->st", whitening.root, whitening.root) / len(whitening.root))
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T

    def weights(poses: Poses) -> Whitening:
        n = len(poses)
        sd = None if whitening.sd is None else np.full(n, whitening.unit)
        return Whitening(sd, None if root is None else np.broadcast_to(root, (n, *root.shape)), whitening.sensed)

    return weights
