"""The fit linearised at its minimum: what any further columns would explain, in sample and held out.

With A the fitted parameters' columns (projected out of everything; Frisch–Waugh–Lovell theorem), r the residual and C
further columns of typical size, θ minimises |r − Aβ − Cθ|² + (σ/s)² |θ|²: a ridge, i.e. a Gaussian prior of s typical
sizes, which bounds directions that the data cannot determine. Each fold solves the same problem on its training rows.

Forward selection by updates (the sweep operator, Goodnight 1979; orthogonal least squares, Chen, Billings and Luo
1989): columns that are taken are projected out of the residual and of all others once, in the sample and in every
fold, the ridge as further rows. A candidate then costs its own columns only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.column_sets import ColumnSets, FoldSplit, column_sets, columns_of, joined, stacks_of
from lrm_ident.residual.better_prediction import outlier_bound
from lrm_math.arrays import Array

PRIOR_SD = 3.0  # of a parameter, in typical sizes
NUMERICAL_RANK = 1e-9
AT_ONCE = 256  # columns that the fitted parameters are projected out of together


@dataclass(frozen=True, eq=False)
class LinearEstimate:
    """Linear estimate of columns.

    Attributes:
        theta: (m,), estimate in typical sizes. error: (m,), its standard error, at most the prior's.
        in_sample: residual sum of squares that the fit would still leave (m²).
        held_out: (N,), squared 3-D distance of each pose, predicted by the other folds (m²); of columns, winsorised: a
            pose to which the line leads far astray counts as an outlier does, or as it is without them.
    """

    theta: Array
    error: Array
    in_sample: float
    held_out: Array

    @cached_property
    def rms(self) -> float:
        """Held-out RMS of the 3-D distance (m)."""
        return float(np.sqrt(self.held_out.mean()))


@dataclass(frozen=True, eq=False)
class SelectedColumns:
    """Columns that are in the fit too, with what was known of them before.

    Attributes:
        columns: one set. inverse_root: for each part (m, m), W with WᵀW the inverse of its normal equations' matrix.
    """

    columns: ColumnSets
    inverse_root: Array


@dataclass(frozen=True, eq=False)
class LinearisedFit:
    """A fit linearised at its minimum, on which further columns are tried.

    Attributes:
        residual: (R N,), what the fitted parameters leave (m), R rows of each of N poses.
        basis: (R N, P), orthonormal basis of their columns.
        parts: the whole sample, then every fold.
        order: (R N,), the rows fold by fold, as those of all `ColumnSets` stand.
        sigma: m per axis, the noise against which the prior is weighed.
        rows: of each pose, R.
        taken: columns that were taken into the fit after it was linearised, one after the other.
    """

    residual: Array
    basis: Array
    parts: tuple[FoldSplit, ...]
    order: NDArray[np.int64]
    sigma: float
    rows: int = 3
    taken: tuple[SelectedColumns, ...] = ()

    @property
    def folds(self) -> tuple[FoldSplit, ...]:
        """The parts that are predicted by the others."""
        return self.parts[1:]

    @property
    def ridge(self) -> float:
        """Weight of the prior in the normal equations."""
        return (self.sigma / PRIOR_SD) ** 2

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Measured rows less fitted parameters."""
        measured = (self.residual != 0.0) | self.basis.any(axis=1)
        columns: int = sum(one.inverse_root.shape[1] for one in self.taken)
        return int(np.count_nonzero(measured)) - int(self.basis.shape[1] + columns)

    @cached_property
    def own(self) -> ColumnSets:
        """The residual as a column."""
        return self.up_to_date(self._known(self.residual[self.order, None], [1]))

    def pose_by_pose(self, rows: Array) -> Array:
        """Rows (R N,) that stand fold by fold, pose by pose."""
        out = np.empty_like(rows)
        out[self.order] = rows
        return out

    def project(self, C: Array) -> ColumnSets:
        """One set of columns C (R N, m) without what the fit explains of them."""
        return self.project_each([C], [C.shape[1]])

    def project_each(self, sets: Iterable[Array], sizes: Sequence[int]) -> ColumnSets:
        """Sets of columns (R N, m), of these sizes, without what the fit explains of them."""
        columns, place = np.empty((len(self.residual), sum(sizes))), columns_of(stacks_of(sizes))
        for number, C in enumerate(sets):
            columns[:, place[number]] = C[self.order]
        basis = self.basis[self.order]
        for start in range(0, columns.shape[1], AT_ONCE):
            some = columns[:, start : start + AT_ONCE]
            some -= basis @ (basis.T @ some)
        return self.up_to_date(self._known(columns, sizes))

    def _known(self, columns: Array, sizes: Sequence[int]) -> ColumnSets:
        """Columns orthogonal to the fitted parameters': what a fold's training rows have in common with these is what
        its test rows lack."""
        later = sum(one.inverse_root.shape[1] for one in self.taken)
        explained = []
        for part in self.parts:
            fitted = part.predictor[:, : part.predictor.shape[1] - later]
            explained.append(-fitted.T @ columns[part.predicted_rows])
        return column_sets(columns, tuple(explained), stacks_of(sizes), self.parts)

    def up_to_date(self, sets: ColumnSets) -> ColumnSets:
        """Columns that were projected before some others were taken: without what these explain too."""
        whole = sets.explained[0].shape[0]
        for one in self.taken:
            size = one.inverse_root.shape[1]
            whole -= size
            if whole < 0:
                products = sets.products(self.parts, one.columns)
                sets = sets.with_explained([W @ rows for W, rows in zip(one.inverse_root, products, strict=True)])
        return sets

    def beside(self, *sets: ColumnSets) -> LinearisedFit:
        """The fit with these columns too."""
        if not sets:
            return self
        columns = self.up_to_date(joined(sets, self.parts, together=True))
        root = _inverse_root(columns.grams[0][:, 0], self.ridge)
        parts = []
        for part, W, amounts in zip(self.parts, root, columns.explained, strict=True):
            left = columns.columns[part.predicted_rows] - part.predictor @ amounts
            parts.append(replace(part, predictor=np.concatenate([part.predictor, left @ W.T], axis=1)))
        return replace(self, parts=tuple(parts), taken=(*self.taken, SelectedColumns(columns, root)))

    @cached_property
    def now(self) -> LinearEstimate:
        """The fit as it is."""
        left = [self._left(number) for number in range(len(self.parts))]
        return LinearEstimate(np.zeros(0), np.zeros(0), float(left[0] @ left[0]), self._by_pose(left[1:])[0])

    def explain(self, sets: ColumnSets | None = None) -> LinearEstimate:
        """Linear estimate of a set of columns (none: the fit as it is)."""
        return self.now if sets is None else self.explain_each(sets)[0]

    def explain_each(self, sets: ColumnSets) -> list[LinearEstimate]:
        """Linear estimate of each set alone beside the fit."""
        sets = self.up_to_date(sets)
        theta, inverse = self._estimates(sets)
        left = []
        for number, part in enumerate(self.parts):
            left.append(self._left(number)[:, None] - sets.predicted(part, sets.explained[number], theta[number]))
        in_sample, held_out = np.einsum("ts,ts->s", left[0], left[0]), self._by_pose(left[1:])
        held_out = np.minimum(held_out, np.maximum(outlier_bound(held_out)[:, None], self.now.held_out))
        found: list[LinearEstimate | None] = [None] * len(sets)
        ends = [*sets.starts[1:], sets.columns.shape[1]]
        for place, (number, start, end) in enumerate(zip(sets.numbers, sets.starts, ends, strict=True)):
            variance = float(in_sample[place]) / max(self.degrees_of_freedom - int(end - start), 1)
            error = np.sqrt(max(variance, self.sigma**2) * inverse[start:end])
            found[number] = LinearEstimate(theta[0, start:end], error, float(in_sample[place]), held_out[place])
        return [one for one in found if one is not None]

    def _estimates(self, sets: ColumnSets) -> tuple[Array, Array]:
        """(parts, M), ridge estimates of every set alone; (M,), diagonal of the inverse normal matrix of the sample."""
        along = np.stack([rows[0] for rows in sets.products(self.parts, self.own)])
        theta, inverse = np.empty_like(along), np.empty(along.shape[1])
        for stack, gram in zip(sets.stacks, sets.grams, strict=True):
            normal = gram + self.ridge * np.eye(stack.size)
            right = along[:, stack.columns].reshape(len(along), -1, stack.size, 1)
            theta[:, stack.columns] = np.linalg.solve(normal, right).reshape(len(along), -1)
            inverse[stack.columns] = np.diagonal(np.linalg.inv(normal[0]), axis1=1, axis2=2).reshape(-1)
        return theta, inverse

    def _left(self, number: int) -> Array:
        """(T,), what the fit leaves of the residual in the rows that a part predicts."""
        part = self.parts[number]
        return np.asarray(self.own.columns[part.predicted_rows, 0] - part.predictor @ self.own.explained[number][:, 0])

    def _by_pose(self, left: Sequence[Array]) -> Array:
        """(S, N), squared 3-D distance of each pose from what is left (T, S) of the rows that the folds predict."""
        count = 1 if left[0].ndim == 1 else left[0].shape[1]
        held_out = np.empty((count, len(self.residual) // self.rows))
        for part, rows in zip(self.folds, left, strict=True):
            held_out[:, part.poses] = (rows.reshape(-1, self.rows, count) ** 2).sum(axis=1).T
        return held_out


def linearise(A: Array, residual: Array, test_poses: Sequence[NDArray[np.int64]], sigma: float) -> LinearisedFit:
    """Linearises a fit with the parameters' columns A (R N, P), residual (R N,) (m) and the test poses of each fold."""
    basis = _svd(A)[0]
    rows = len(residual) // sum(len(poses) for poses in test_poses)
    order = np.concatenate([(rows * poses[:, None] + np.arange(rows)).reshape(-1) for poses in test_poses])
    by_fold, start = A[order], 0
    parts = [FoldSplit(order[::rows] // rows, slice(0), slice(None), np.empty((len(order), 0)))]
    for poses in test_poses:
        own = slice(start, start + rows * len(poses))
        others = np.concatenate([by_fold[:start], by_fold[own.stop :]])
        inverse_factor = _svd(np.asarray(np.linalg.qr(others, mode="r")))[1]
        parts.append(FoldSplit(poses, own, own, by_fold[own] @ inverse_factor))
        start = own.stop
    return LinearisedFit(residual - basis @ (basis.T @ residual), basis, tuple(parts), order, sigma, rows)


def _svd(A: Array) -> tuple[Array, Array]:
    """U and V S⁻¹ of A = U S Vᵀ, numerically zero singular values left out."""
    basis, singular, rows = np.linalg.svd(A, full_matrices=False)
    keep = singular > NUMERICAL_RANK * singular.max(initial=0.0)
    return basis[:, keep], rows[keep].T / singular[keep]


def _inverse_root(gram: Array, ridge: float) -> Array:
    """(…, m, m), W with WᵀW = (G + ridge I)⁻¹; by eigenvalues where the ridge is lost in round-off."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(gram + ridge * np.eye(gram.shape[-1]))))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(gram)
        return np.asarray((vectors / np.sqrt(np.maximum(values, 0.0) + ridge)[:, None, :]).transpose(0, 2, 1))


def orthonormal_basis(columns: Array) -> Array:
    """(R N, rank), of the space of columns (R N, m)."""
    return _svd(columns)[0]


def projected_rank(columns: Array, original: Array) -> int:
    """Number of directions of projected columns (3 N, m) that are more than a thousandth of the original ones."""
    scaled = columns / np.maximum(np.linalg.norm(original, axis=0), 1e-300)
    return int(np.count_nonzero(np.linalg.eigvalsh(scaled.T @ scaled) > 1e-6))


def principal_cosine(a: Array, b: Array) -> float:
    """Smallest principal cosine (Björck & Golub 1973) of two column spaces: 1 if the smaller lies in the larger."""
    return cosine_of_bases(_svd(a)[0], _svd(b)[0])


def cosine_of_bases(a: Array, b: Array) -> float:
    """`principal_cosine` of orthonormal columns."""
    small, large = sorted((a, b), key=lambda basis: basis.shape[1])
    if not small.shape[1]:
        return 0.0
    return float(np.linalg.svd(large.T @ small, compute_uv=False).min())
