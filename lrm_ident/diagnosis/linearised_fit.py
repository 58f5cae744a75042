"""The fit seen linearly at its minimum: what any further columns would explain, in the fit and held out.

With A the fitted parameters' columns (taken out of everything by projection; Frisch–Waugh–Lovell), r the residual and C
further columns of typical size, θ minimises |r − Aβ − Cθ|² + (σ/s)² |θ|²: a weak prior of s typical sizes keeps
directions that the data cannot tell from running away. Folds do the same on their training rows; nothing is refitted
from scratch, so thousands of hypotheses cost seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

PRIOR_SIZES = 3.0  # typical sizes that a parameter may well have
NUMERICAL_RANK = 1e-9


@dataclass(frozen=True, eq=False)
class Fold:
    """Training rows with A projected out, test rows as a fit to the training rows leaves them."""

    train: NDArray[np.int64]
    test: NDArray[np.int64]
    basis: Array
    backward: Array
    test_columns: Array
    train_residual: Array
    test_residual: Array

    def train_of(self, C: Array) -> Array:
        """Training rows of C without what A explains."""
        inside = C[self.train]
        return inside - self.basis @ (self.basis.T @ inside)

    def test_of(self, C: Array) -> Array:
        """Test rows of C, less what the training fit of A would predict for them."""
        return C[self.test] - self.test_columns @ (self.backward @ (self.basis.T @ C[self.train]))


@dataclass(frozen=True, eq=False)
class Explained:
    """What columns explain.

    Attributes:
        theta: (m,), estimate in typical sizes. error: (m,), its standard error, at most the prior's.
        in_sample: sum of squares that the fit would still leave (m²).
        held_out: (N,), squared 3-D distance of each pose, predicted by the other folds (m²).
    """

    theta: Array
    error: Array
    in_sample: float
    held_out: Array

    @property
    def rms(self) -> float:
        """Held-out RMS of the 3-D distance (m)."""
        return float(np.sqrt(self.held_out.mean()))


@dataclass(frozen=True, eq=False)
class Prepared:
    """Columns with the fitted parameters taken out: of all rows (3 N, m), and of each fold's training and test rows."""

    inside: Array
    train: tuple[Array, ...]
    test: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Bench:
    """A fit at its minimum, ready to have columns tried on it.

    Attributes:
        residual: (3 N,), what the fitted parameters leave (m).
        basis: (3 N, P), orthonormal basis of their columns.
        sigma: m per axis, the noise against which the prior is weighed.
    """

    residual: Array
    basis: Array
    folds: tuple[Fold, ...]
    sigma: float

    @property
    def freedom(self) -> int:
        """Rows less fitted parameters."""
        return len(self.residual) - int(self.basis.shape[1])

    def prepare(self, C: Array) -> Prepared:
        """Takes the fitted parameters out of columns (3 N, m)."""
        inside = C - self.basis @ (self.basis.T @ C)
        return Prepared(inside, tuple(f.train_of(C) for f in self.folds), tuple(f.test_of(C) for f in self.folds))

    def explain(self, *parts: Prepared) -> Explained:
        """What the columns of all parts explain together."""
        if not parts:
            held_out = np.empty(len(self.residual))
            for fold in self.folds:
                held_out[fold.test] = fold.test_residual**2
            return Explained(np.zeros(0), np.zeros(0), float(self.residual @ self.residual), _by_pose(held_out))
        inside = np.concatenate([part.inside for part in parts], axis=1)
        gram, prior = inside.T @ inside, np.eye(inside.shape[1]) * (self.sigma / PRIOR_SIZES) ** 2
        inverse = np.linalg.inv(gram + prior)
        theta = inverse @ (inside.T @ self.residual)
        left = self.residual - inside @ theta
        scale = float(left @ left) / max(self.freedom - len(theta), 1)
        held_out = np.empty(len(self.residual))
        for number, fold in enumerate(self.folds):
            train = np.concatenate([part.train[number] for part in parts], axis=1)
            test = np.concatenate([part.test[number] for part in parts], axis=1)
            answer = np.linalg.solve(train.T @ train + prior, train.T @ fold.train_residual)
            held_out[fold.test] = (fold.test_residual - test @ answer) ** 2
        error = np.sqrt(max(scale, self.sigma**2) * np.diag(inverse))
        return Explained(theta, error, float(left @ left), _by_pose(held_out))


def bench(A: Array, residual: Array, test_poses: Sequence[NDArray[np.int64]], sigma: float) -> Bench:
    """A bench from the fitted parameters' columns A (3 N, P), the residual (3 N,) and the poses of each fold."""
    basis = _orthonormal(A)
    projected = residual - basis @ (basis.T @ residual)
    return Bench(projected, basis, tuple(_fold(A, projected, poses) for poses in test_poses), sigma)


def _by_pose(squares: Array) -> Array:
    return np.asarray(squares.reshape(-1, 3).sum(axis=1))


def _fold(A: Array, residual: Array, poses: NDArray[np.int64]) -> Fold:
    test = (3 * poses[:, None] + np.arange(3)).reshape(-1)
    train = np.setdiff1d(np.arange(len(residual)), test)
    basis, singular, rows = np.linalg.svd(A[train], full_matrices=False)
    keep = singular > NUMERICAL_RANK * singular.max(initial=0.0)
    basis, backward = basis[:, keep], (rows[keep].T / singular[keep])
    outside = residual[test] - A[test] @ (backward @ (basis.T @ residual[train]))
    inside = residual[train] - basis @ (basis.T @ residual[train])
    return Fold(train, test, basis, backward, A[test], inside, outside)


def _orthonormal(A: Array) -> Array:
    basis, singular, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(basis[:, singular > NUMERICAL_RANK * singular.max(initial=0.0)])


def rank_of(columns: Array, whole: Array) -> int:
    """How many directions of projected columns (3 N, m) are more than a thousandth of what they were (3 N, m)."""
    scale = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    return int(np.count_nonzero(np.linalg.svd(columns / scale, compute_uv=False) > 1e-3))


def coincidence(a: Array, b: Array) -> float:
    """Smallest principal cosine between the smaller of two column spaces and the larger one: 1 if it lies inside."""
    small, large = sorted((_orthonormal(a), _orthonormal(b)), key=lambda basis: basis.shape[1])
    if not small.shape[1]:
        return 0.0
    return float(np.linalg.svd(large.T @ small, compute_uv=False).min())


def paired(better: Array, worse: Array) -> float:
    """How surely the first predicts better: mean difference of squared errors over its standard error (Vuong 1989)."""
    difference = worse - better
    spread = float(difference.std(ddof=1)) / np.sqrt(len(difference))
    return float(difference.mean() / spread) if spread > 0 else 0.0
