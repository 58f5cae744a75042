"""The fit linearised at its minimum: ridge estimates of further columns, in sample and cross-validated.

With A the fitted parameters' columns (projected out of everything; Frisch–Waugh–Lovell theorem), r the residual and C
further columns of typical size, θ minimises |r − Aβ − Cθ|² + (σ/s)² |θ|²: ridge regression, i.e. a Gaussian prior of s
typical sizes, which bounds directions that the data cannot determine. Each fold solves the same problem on its training
rows.

Forward selection by updates (the sweep operator, Goodnight 1979; orthogonal least squares, Chen, Billings and Luo
1989): selected columns are projected out of the residual and of all others once, in the sample and in every fold, the
ridge as further rows. A candidate then costs its own columns only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm

from lrm_ident.diagnosis.screening.column_sets import (
    NO_ROWS,
    ColumnSets,
    EqualSizedSets,
    FoldSplit,
    by_set,
    column_sets,
    columns_of,
    side_by_side,
    stacks_of,
    united,
)
from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis, truncated_svd
from lrm_ident.residual.better_prediction import squared_outlier_distance
from lrm_ident.residual.residual_structure import rows_present
from lrm_math.arrays import Array

PRIOR_SD = 3.0  # s, of a parameter in typical sizes
AT_ONCE = 256  # columns that are projected together


@dataclass(frozen=True, eq=False)
class LinearEstimate:
    """Linear estimate of columns, and the error that the fit with them would leave.

    Attributes:
        theta: (m,), estimate in typical sizes. error: (m,), its standard error, at most the prior's.
        in_sample: residual sum of squares (m²).
        held_out: (N,), squared 3-D distance of each pose, predicted by the other folds (m²), winsorised: where the
            linear model errs most, a pose counts at most as an outlier, or as it does without the columns.
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
    """K columns that were selected after the fit was linearised, set after set.

    Attributes:
        columns: (R N, K), fold by fold; the fitted parameters' columns are projected out over all rows.
        amounts: (parts, K, K), amounts of each column along the directions of the sets before it.
        inverse_root: (parts, K, K), W with WᵀW the inverse of their normal equations' matrix, block triangular.
        residual: (parts, K), amounts of the residual along their directions.
    """

    columns: Array
    amounts: Array
    inverse_root: Array
    residual: Array

    @staticmethod
    def empty(rows: int, parts: int) -> SelectedColumns:
        """No columns."""
        nothing = np.empty((parts, 0, 0))
        return SelectedColumns(np.empty((rows, 0)), nothing, nothing, np.empty((parts, 0)))

    def extended(self, sets_added: ColumnSets, inverse_root: Array) -> SelectedColumns:
        """These columns and one set that is up to date with them; `inverse_root`: (parts, m, m), of that set."""
        columns = np.concatenate([self.columns.T, sets_added.columns.T]).T
        selected_count, size = self.columns.shape[1], columns.shape[1]
        amounts, root = np.zeros((2, len(inverse_root), size, size))
        amounts[:, :selected_count, :selected_count], amounts[:, :selected_count, selected_count:] = (
            self.amounts,
            sets_added.explained,
        )
        root[:, :selected_count, :selected_count], root[:, selected_count:, selected_count:] = (
            self.inverse_root,
            inverse_root,
        )
        # inverse of a block triangular factor: [L₁ 0; B L₂]⁻¹ = [W₁ 0; −W₂ B W₁ W₂]
        root[:, selected_count:, :selected_count] = (
            -inverse_root @ np.swapaxes(sets_added.explained, 1, 2) @ self.inverse_root
        )
        residual = (inverse_root @ sets_added.along[:, :, None])[:, :, 0]
        return SelectedColumns(columns, amounts, root, np.concatenate([self.residual, residual], axis=1))


@dataclass(frozen=True, eq=False)
class LinearisedFit:
    """A fit linearised at its minimum, on which further columns are tried.

    Attributes:
        residual: (R N + K,), residual of the fit (m), R rows of each of N poses, then of the K rows of its prior, where
            further columns are zero.
        basis: (R N + K, P), orthonormal basis of the fitted parameters' columns.
        parts: the whole sample, then every fold.
        order: (R N + K,), numbers of the rows fold by fold, the order of rows in `ColumnSets`; the prior's last.
        measured: R N.
        sigma: noise against which the prior is weighed (m per axis).
        rows: R, rows of each pose.
        selected: columns that were selected since.
    """

    residual: Array
    basis: Array
    parts: tuple[FoldSplit, ...]
    order: NDArray[np.int64]
    sigma: float
    rows: int
    measured: int
    selected: SelectedColumns

    @property
    def folds(self) -> tuple[FoldSplit, ...]:
        """The folds, without the whole sample."""
        return self.parts[1:]

    @property
    def ridge(self) -> float:
        """Ridge parameter (σ/s)² of the normal equations (m²)."""
        return (self.sigma / PRIOR_SD) ** 2

    @property
    def measured_basis(self) -> Array:
        """(R N, P), `basis` at the measured rows."""
        return self.basis[: self.measured]

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """(R N,), which rows hold a number: of a pose without a position, say, three do not."""
        return rows_present(self.residual[: self.measured], self.measured_basis)

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Number of measured rows less the effective number of fitted parameters."""
        fitted = round(float((self.measured_basis**2).sum()))
        return int(np.count_nonzero(self.present) - fitted - self.selected.columns.shape[1])

    def pose_by_pose(self, rows: Array) -> Array:
        """The R N measured ones, pose by pose, of rows (R N + K,) that stand fold by fold."""
        out = np.empty_like(rows)
        out[self.order] = rows
        return out[: self.measured]

    def project(self, C: Array) -> ColumnSets:
        """One set of columns C (R N, m), the fit's projected out."""
        return self.project_each([C], [C.shape[1]])

    def project_each(self, sets: Iterable[Array], sizes: Sequence[int]) -> ColumnSets:
        """Sets of columns (R N, m) of these sizes, the fit's projected out."""
        stacks = stacks_of(sizes)
        return self.up_to_date(self.in_folds(self.residualised(sets, stacks), stacks))

    def in_folds(self, columns: Array, stacks: tuple[EqualSizedSets, ...]) -> ColumnSets:
        """Sets of `residualised` columns in the sample and in every fold, selected columns not yet projected out."""
        return column_sets(columns, self.residual[self.order], stacks, self.parts)

    def residualised(self, sets: Iterable[Array], stacks: tuple[EqualSizedSets, ...]) -> Array:
        """(R N + K, M), sets of columns (R N, m) side by side, fold by fold, the fitted parameters' projected out."""
        place, measured = columns_of(stacks), self.measured
        columns = np.zeros((len(self.residual), stacks[-1].columns.stop if stacks else 0), order="F")
        for number, C in enumerate(sets):
            np.take(C.T, self.order[:measured], axis=1, out=columns.T[place[number], :measured], mode="clip")
        basis = np.asfortranarray(self.basis[self.order])
        for start in range(0, columns.shape[1], AT_ONCE):
            some = columns[:, start : start + AT_ONCE]
            dgemm(-1.0, basis, basis.T @ some, 1.0, some, overwrite_c=1)  # some -= basis @ (basis.T @ some), in place
        return columns

    def residual_squares(self, sets: Sequence[Array]) -> Array:
        """(S,), residual sum of squares (m²) that each set of columns C (R N, m) alone would leave in the sample.

        Selected columns are projected out of the normal equations instead of the columns, which is faster.
        """
        columns, stacks = side_by_side(sets, self.measured)
        selected, root = self.pose_by_pose(self.selected.columns), self.selected.inverse_root[0]
        # amounts along the fitted parameters' directions and along the selected ones; both are taken off the Gram
        # matrix, which is as good as projecting the columns, since (I − Q Qᵀ) is idempotent: CᵀPC = CᵀC − (QᵀC)ᵀ(QᵀC)
        fitted, of_known, of_residual = (
            self.measured_basis.T @ columns,
            root @ (selected.T @ columns),
            self.selected.residual[0],
        )
        along = self.residual[: self.measured] @ columns - of_residual @ of_known
        shrunk = self.ridge * root @ root.T  # by how much the selected directions are short of unit length
        squares = np.full(len(sets), self.baseline.in_sample)
        for stack in stacks:
            columns_here, of_fitted, of_selected = (by_set(rows, stack) for rows in (columns, fitted, of_known))
            gram = sum(
                sign * np.swapaxes(a, 1, 2) @ a for sign, a in ((1, columns_here), (-1, of_fitted), (-1, of_selected))
            )
            right = along[stack.columns].reshape(len(stack.numbers), stack.size, 1)
            theta = np.linalg.solve(gram + self.ridge * np.eye(stack.size), right)
            # |r − Cθ|² falls by 2 θᵀCᵀr − θᵀCᵀCθ. Selected directions D are not of unit length, because the ridge
            # shortens them (DᵀD = I − ridge W Wᵀ): `short` takes that part out of Cᵀr and CᵀC again
            short = np.swapaxes(of_selected, 1, 2) @ shrunk
            change = (2.0 * (right - short @ of_residual[:, None]) - (gram - short @ of_selected) @ theta) * theta
            squares[stack.numbers] -= change.sum(axis=(1, 2))
        return squares

    def up_to_date(self, sets: ColumnSets) -> ColumnSets:
        """Sets with all columns projected out that were selected since they were projected last."""
        selected, selected_columns = self.selected, sets.explained.shape[1]
        if selected_columns == selected.columns.shape[1]:
            return sets
        # only what was selected since: along the earlier directions the sets are up to date
        along = sets.products(self.parts, selected.columns[:, selected_columns:])
        along -= np.swapaxes(selected.amounts[:, :selected_columns, selected_columns:], 1, 2) @ sets.explained
        return sets.with_explained(
            selected.inverse_root[:, selected_columns:, selected_columns:] @ along,
            selected.residual[:, selected_columns:],
        )

    def beside(self, *sets: ColumnSets) -> LinearisedFit:
        """The fit with these columns selected too."""
        if not sets:
            return self
        columns = self.up_to_date(united(sets, self.parts))
        root = _inverse_root(columns.grams[0][:, 0], self.ridge)
        selected, selected_count = self.selected.extended(columns, root), self.selected.columns.shape[1]
        parts = []
        for number, part in enumerate(self.parts):
            # rows of the fold's own residual columns, less what the fold's earlier directions predict of them
            residual = columns.residual_rows(part) - part.predictor @ columns.explained[number]
            directions = residual @ root[number].T
            predictor = np.concatenate([part.predictor, directions], axis=1)
            rest = part.residual - directions @ selected.residual[number, selected_count:]
            parts.append(replace(part, predictor=predictor, residual=rest))
        return replace(self, parts=tuple(parts), selected=selected)

    @cached_property
    def baseline(self) -> LinearEstimate:
        """Estimate of no further columns: the error of the fit as it is."""
        whole, *folds = (part.residual for part in self.parts)
        return LinearEstimate(np.zeros(0), np.zeros(0), float(whole @ whole), self._by_pose(folds)[0])

    def explain(self, columns: ColumnSets) -> LinearEstimate:
        """Linear estimate of one set of columns beside the fit."""
        return self.explain_each(columns)[0]

    def explain_each(self, sets: ColumnSets) -> list[LinearEstimate]:
        """Linear estimate of each set alone beside the fit."""
        if not len(sets):
            return []
        sets = self.up_to_date(sets)
        theta, inverse = self._estimates(sets)
        residuals = []
        for part, amounts, parameters in zip(self.parts, sets.explained, theta, strict=True):
            residuals.append(part.residual[:, None] - sets.predicted(part, amounts, parameters))
        in_sample, held_out = np.einsum("ts,ts->s", residuals[0], residuals[0]), self._by_pose(residuals[1:])
        held_out = at_most_outliers(held_out, self.baseline.held_out)
        estimates: list[LinearEstimate | None] = [None] * len(sets)
        ends = [*sets.starts[1:], sets.columns.shape[1]]
        for place, (number, start, end) in enumerate(zip(sets.numbers, sets.starts, ends, strict=True)):
            # the larger of what is left and the stated noise: a perfect fit by chance is not believed
            variance = float(in_sample[place]) / max(self.degrees_of_freedom - int(end - start), 1)
            error = np.sqrt(max(variance, self.sigma**2) * inverse[start:end])
            estimates[number] = LinearEstimate(theta[0, start:end], error, float(in_sample[place]), held_out[place])
        return [estimate for estimate in estimates if estimate is not None]

    def _estimates(self, sets: ColumnSets) -> tuple[Array, Array]:
        """(parts, M), ridge estimates of every set alone; (M,), diagonal of the inverse normal matrix of the sample."""
        along = sets.along
        theta, inverse = np.empty_like(along), np.empty(along.shape[1])
        for stack, gram in zip(sets.stacks, sets.grams, strict=True):
            normal = gram + self.ridge * np.eye(stack.size)
            right = along[:, stack.columns].reshape(len(along), -1, stack.size, 1)
            theta[:, stack.columns] = np.linalg.solve(normal, right).reshape(len(along), -1)
            inverse[stack.columns] = np.diagonal(np.linalg.inv(normal[0]), axis1=1, axis2=2).reshape(-1)
        return theta, inverse

    def _by_pose(self, residuals: Sequence[Array]) -> Array:
        """(S, N), squared 3-D distance of each pose, from the residuals (T, S) at the predicted rows of each fold."""
        count = 1 if residuals[0].ndim == 1 else residuals[0].shape[1]
        held_out = np.empty((count, self.measured // self.rows))
        for part, rows in zip(self.folds, residuals, strict=True):
            held_out[:, part.poses] = (rows.reshape(len(part.poses), self.rows, count) ** 2).sum(axis=1).T
        return held_out


def linearise(
    A: Array,
    residual: Array,
    test_poses: Sequence[NDArray[np.int64]],
    sigma: float,
    prior: tuple[Array, Array] | None = None,
) -> LinearisedFit:
    """Linearised fit from the parameters' columns A (R N, P), the residual (R N,) in m and the test poses of folds.

    `prior`: columns (K, P) and residual (K,) of its prior, which all folds share.
    """
    measured = len(residual)
    if prior is not None:
        A, residual = np.concatenate([A, prior[0]]), np.concatenate([residual, prior[1]])
    basis = orthonormal_basis(A)
    residual = residual - basis @ (basis.T @ residual)
    rows = measured // sum(len(poses) for poses in test_poses)
    folds = [(rows * poses[:, None] + np.arange(rows)).reshape(-1) for poses in test_poses]
    order = np.concatenate([*folds, np.arange(measured, len(residual))])
    by_fold, residual_by_fold, start, none = A[order], residual[order], 0, np.empty((len(order), 0))
    parts = [FoldSplit(order[:measured:rows] // rows, NO_ROWS, slice(None), none, none, residual_by_fold)]
    for poses in test_poses:
        test = slice(start, start + rows * len(poses))
        others = np.concatenate([by_fold[:start], by_fold[test.stop :]])
        # F Fᵀ = A_t (A_oᵀ A_o)⁻¹ A_tᵀ of the test rows t and all others o, by an SVD of the R factor of A_o, which
        # leaves out directions that the others do not determine
        fitted = by_fold[test] @ truncated_svd(np.asarray(np.linalg.qr(others, mode="r")))[1]
        # residual of a fit without these rows: (I − H_tt)⁻¹ r_t, with H the hat matrix of all rows, is (I + F Fᵀ) r_t
        # by Woodbury's identity (leave-out residuals: Cook 1977)
        test_residual = residual_by_fold[test] + fitted @ (fitted.T @ residual_by_fold[test])
        parts.append(FoldSplit(poses, test, test, fitted, none[test], test_residual))
        start = test.stop
    none_selected = SelectedColumns.empty(len(order), len(parts))
    return LinearisedFit(residual, basis, tuple(parts), order, sigma, rows, measured, none_selected)


def at_most_outliers(held_out: Array, before: Array) -> Array:
    """(S, N), held-out squares of S linear estimates, winsorised: each at most that of an outlier, or as `before` (N,).

    Where the linear model errs most (a joint about to fall through its play) it must not decide alone.
    """
    return np.minimum(held_out, np.maximum(squared_outlier_distance(held_out)[:, None], before))


def _inverse_root(gram: Array, ridge: float) -> Array:
    """(…, m, m), W with WᵀW = (G + ridge I)⁻¹; by eigenvalues where the ridge is lost in round-off."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(gram + ridge * np.eye(gram.shape[-1]))))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(gram)
        return np.asarray((vectors / np.sqrt(np.maximum(values, 0.0) + ridge)[:, None, :]).transpose(0, 2, 1))
