"""The fit linearised at its minimum: what any further columns would explain, in sample and held out.

With A the fitted parameters' columns (projected out of everything; Frisch–Waugh–Lovell theorem), r the residual and C
further columns of typical size, θ minimises |r − Aβ − Cθ|² + (σ/s)² |θ|²: a ridge, i.e. a Gaussian prior of s typical
sizes, which bounds directions that the data cannot determine. Each fold solves the same problem on its training rows;
nothing is refitted from scratch, so thousands of hypotheses cost seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE
from lrm_ident.fitting.loss import robust_scale
from lrm_math.arrays import Array

PRIOR_SD = 3.0  # of a parameter, in typical sizes
NUMERICAL_RANK = 1e-9
AT_ONCE = 40  # sets of columns that are projected together


@dataclass(frozen=True, eq=False)
class Fold:
    """Training rows with A projected out, test rows as a fit to the training rows leaves them.

    The training rows of A are U S Vᵀ: `basis` is U, `inverse_factor` is V S⁻¹.
    """

    train: NDArray[np.int64]
    test: NDArray[np.int64]
    basis: Array
    inverse_factor: Array
    test_columns: Array
    train_residual: Array
    test_residual: Array


@dataclass(frozen=True, eq=False)
class Explanation:
    """What columns explain.

    Attributes:
        theta: (m,), estimate in typical sizes. error: (m,), its standard error, at most the prior's.
        in_sample: residual sum of squares that the fit would still leave (m²).
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
class ProjectedColumns:
    """Columns C with A projected out.

    Attributes:
        all_rows: (3 N, m).
        absent: (F, P + Q, m), for each fold what its training rows lack of `all_rows`: the part that A explains there,
            and the test rows; so the training rows' products are those of all rows less those of these.
        test: (F, Q, m), test rows less what the training fit of A predicts for them; zero beyond a fold's rows.
    """

    all_rows: Array
    absent: Array
    test: Array

    @cached_property
    def orthonormal(self) -> Array:
        """(3 N, rank), orthonormal basis of `all_rows`."""
        return _svd(self.all_rows)[0]


@dataclass(frozen=True, eq=False)
class LinearisedFit:
    """A fit linearised at its minimum, on which further columns are tried.

    Attributes:
        residual: (3 N,), what the fitted parameters leave (m).
        basis: (3 N, P), orthonormal basis of their columns.
        sigma: m per axis, the noise against which the prior is weighed.
        rows: of each pose, R; 3 N above stands for R N.
    """

    residual: Array
    basis: Array
    folds: tuple[Fold, ...]
    sigma: float
    rows: int = 3

    @property
    def degrees_of_freedom(self) -> int:
        """Measured rows less fitted parameters."""
        measured = (self.residual != 0.0) | self.basis.any(axis=1)
        return int(np.count_nonzero(measured)) - int(self.basis.shape[1])

    @cached_property
    def _test_rows(self) -> NDArray[np.int64]:
        """(F, Q), test rows of each fold, filled up with the number of a row that does not exist."""
        out = np.full((len(self.folds), max(len(fold.test) for fold in self.folds)), len(self.residual))
        for row, fold in zip(out, self.folds, strict=True):
            row[: len(fold.test)] = fold.test
        return out

    @cached_property
    def _bases(self) -> Array:
        """(F, P, 3 N), Uᵀ of each fold, zero at test rows."""
        out = np.zeros((len(self.folds), max(fold.basis.shape[1] for fold in self.folds), len(self.residual)))
        for rows, fold in zip(out, self.folds, strict=True):
            rows[: fold.basis.shape[1], fold.train] = fold.basis.T
        return out

    @cached_property
    def _predictors(self) -> Array:
        """(F, Q, P), test rows of A V S⁻¹ of each fold."""
        out = np.zeros((*self._test_rows.shape, self._bases.shape[1]))
        for rows, fold in zip(out, self.folds, strict=True):
            rows[: len(fold.test), : fold.basis.shape[1]] = fold.test_columns @ fold.inverse_factor
        return out

    @cached_property
    def own(self) -> ProjectedColumns:
        """The residual as a column."""
        return self._parts(self.residual[:, None])

    def project(self, C: Array) -> ProjectedColumns:
        """Projects the fitted parameters out of columns C (3 N, m)."""
        return self._parts(C - self.basis @ (self.basis.T @ C))

    def project_each(self, sets: Sequence[Array]) -> list[ProjectedColumns]:
        """`project` of each of some sets of columns (3 N, m), many at a time: the bases are read once for all."""
        found: list[ProjectedColumns] = []
        for start in range(0, len(sets), AT_ONCE):
            chunk = sets[start : start + AT_ONCE]
            whole = self.project(np.concatenate(chunk, axis=1))
            ends = np.cumsum([C.shape[1] for C in chunk])[:-1]
            parts = (np.split(getattr(whole, name), ends, axis=-1) for name in ("all_rows", "absent", "test"))
            found += [ProjectedColumns(*map(np.ascontiguousarray, part)) for part in zip(*parts, strict=True)]
        return found

    def _parts(self, C: Array) -> ProjectedColumns:
        (count, size, rows), m = self._bases.shape, C.shape[1]
        explained = (self._bases.reshape(-1, rows) @ C).reshape(count, size, m)
        test = np.concatenate([C, np.zeros((1, m))])[self._test_rows]
        return ProjectedColumns(C, np.concatenate([explained, test], axis=1), test - self._predictors @ explained)

    def explain(self, *parts: ProjectedColumns) -> Explanation:
        """What the columns of all parts explain together (nothing: the fit as it is)."""
        prior, own = (self.sigma / PRIOR_SD) ** 2, self.own
        if not parts:
            held_out = self._by_pose(own.test[:, :, 0])
            return Explanation(np.zeros(0), np.zeros(0), float(self.residual @ self.residual), held_out)
        columns, absent, test = (
            np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in ("all_rows", "absent", "test")
        )
        gram = columns.T @ columns + np.eye(columns.shape[1]) * prior
        along, missing = columns.T @ self.residual, absent.transpose(0, 2, 1)
        theta = np.linalg.solve(gram - missing @ absent, along[:, None] - missing @ own.absent)
        squared = self._by_pose((own.test - test @ theta)[:, :, 0])
        inverse = np.linalg.inv(gram)
        theta = inverse @ along
        left = self.residual - columns @ theta
        variance = float(left @ left) / max(self.degrees_of_freedom - len(theta), 1)
        error = np.sqrt(max(variance, self.sigma**2) * np.diag(inverse))
        return Explanation(theta, error, float(left @ left), squared)

    def _by_pose(self, test: Array) -> Array:
        """(N,), squared 3-D distance of each pose from the folds' test residuals (F, Q)."""
        held_out = np.zeros(len(self.residual) + 1)
        held_out[self._test_rows] = test**2
        return np.asarray(held_out[:-1].reshape(-1, self.rows).sum(axis=1))


def linearise(A: Array, residual: Array, test_poses: Sequence[NDArray[np.int64]], sigma: float) -> LinearisedFit:
    """Linearises a fit with the parameters' columns A (3 N, P), residual (3 N,) (m) and the test poses of each fold."""
    basis = _svd(A)[0]
    projected = residual - basis @ (basis.T @ residual)
    rows = len(residual) // sum(len(poses) for poses in test_poses)
    folds = tuple(_fold(A, projected, poses, rows) for poses in test_poses)
    return LinearisedFit(projected, basis, folds, sigma, rows)


def _fold(A: Array, residual: Array, poses: NDArray[np.int64], rows: int) -> Fold:
    test = (rows * poses[:, None] + np.arange(rows)).reshape(-1)
    train = np.setdiff1d(np.arange(len(residual)), test)
    basis, inverse_factor = _svd(A[train])
    test_residual = residual[test] - A[test] @ (inverse_factor @ (basis.T @ residual[train]))
    train_residual = residual[train] - basis @ (basis.T @ residual[train])
    return Fold(train, test, basis, inverse_factor, A[test], train_residual, test_residual)


def _svd(A: Array) -> tuple[Array, Array]:
    """U and V S⁻¹ of A = U S Vᵀ, numerically zero singular values left out."""
    basis, singular, rows = np.linalg.svd(A, full_matrices=False)
    keep = singular > NUMERICAL_RANK * singular.max(initial=0.0)
    return basis[:, keep], rows[keep].T / singular[keep]


def projected_rank(columns: Array, original: Array) -> int:
    """Number of directions of projected columns (3 N, m) that are more than a thousandth of the original ones."""
    scale = np.maximum(np.linalg.norm(original, axis=0), 1e-300)
    return int(np.count_nonzero(np.linalg.svd(columns / scale, compute_uv=False) > 1e-3))


def principal_cosine(a: Array, b: Array) -> float:
    """Smallest principal cosine (Björck & Golub 1973) of two column spaces: 1 if the smaller lies in the larger."""
    return cosine_of_bases(_svd(a)[0], _svd(b)[0])


def cosine_of_bases(a: Array, b: Array) -> float:
    """As `principal_cosine`, of orthonormal columns."""
    small, large = sorted((a, b), key=lambda basis: basis.shape[1])
    if not small.shape[1]:
        return 0.0
    return float(np.linalg.svd(large.T @ small, compute_uv=False).min())


def paired_z(better: Array, worse: Array) -> float:
    """z score of a paired difference of squared errors (N,): mean over its standard error (Vuong 1989).

    Errors are winsorised at `OUTLIER_DISTANCE` robust standard deviations of the better prediction: a few poses where a
    joint is about to fall over to the other side of its play would decide else.
    """
    most = (OUTLIER_DISTANCE * robust_scale(np.sqrt(better))) ** 2
    difference = np.minimum(worse, most) - np.minimum(better, most)
    spread = float(difference.std(ddof=1)) / np.sqrt(len(difference))
    return float(difference.mean() / spread) if spread > 0 else 0.0
