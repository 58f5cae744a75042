"""Exhaustive search of laws on a linearised fit: held-out error of each, nested error of the search, null distribution.

Every law is tried on the residual in all joint-space blocks at once. The search itself is judged by nested
cross-validation (Stone 1974): in every block the law of least BIC (Schwarz 1978) on the other blocks predicts it. What
the best of so many laws gains on pure noise that went through the same fit is simulated (Monte Carlo test; Hope 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.linearised_fit import LinearisedFit
from lrm_ident.diagnosis.symbolic_regression.grammar import Law
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arrays import Array

NULL_DRAWS, SEED = 200, 0


@dataclass(frozen=True, eq=False)
class LawColumns:
    """Columns of the laws of one slot.

    Attributes:
        motions: (3 N, M), motion of the TCP for each term at its typical size (m); the last column is zero.
        first, second: (L,), columns of each law's terms; `second` is the last column for laws of one term.
    """

    laws: tuple[Law, ...]
    motions: Array
    first: NDArray[np.int64]
    second: NDArray[np.int64]

    @property
    def key(self) -> str:
        """Key of the slot."""
        return self.laws[0].key

    @property
    def pairs(self) -> NDArray[np.int64]:
        """Numbers of the laws of two terms."""
        return np.flatnonzero(self.second < self.motions.shape[1] - 1)


@dataclass(frozen=True, eq=False)
class LawSearch:
    """Result of a search.

    Attributes:
        squares: (N, L), held-out squared 3-D distance of each pose with each law (m²).
        nested: (N,), the same with the law that the other blocks choose (m²).
        bic_gain: (L,), decrease of the BIC of the whole residual by each law.
        p_value: of the largest decrease, by a Monte Carlo test on noise.
    """

    laws: tuple[Law, ...]
    squares: Array
    nested: Array
    bic_gain: Array
    p_value: float


def search_laws(linear: LinearisedFit, groups: Sequence[LawColumns], progress: OnProgress = silent) -> LawSearch:
    """Tries every law on the residual of a linearised fit."""
    rows, folds = linear.measured, len(linear.folds)
    noise = np.zeros((len(linear.residual), NULL_DRAWS))
    noise[:rows] = np.random.default_rng(SEED).normal(size=(rows, NULL_DRAWS)) * linear.sigma
    noise[:rows] *= linear.present[:, None]
    present, count = linear.present[linear.order[:rows]], int(np.count_nonzero(linear.present))
    noise -= linear.basis @ (linear.basis.T @ noise)
    squares, fold_gain, gain, largest = [], [], [], np.full(NULL_DRAWS, -np.inf)
    both = np.concatenate([linear.residual[:, None], noise], axis=1)[linear.order]
    for number, group in enumerate(groups):
        held_out, by_fold = np.empty((rows // linear.rows, len(group.laws))), np.empty((folds, len(group.laws)))
        projected = linear.project_each(group.motions.T[:, :, None], [1] * group.motions.shape[1])
        whole, residual = _products(projected.columns, projected.columns, both, group), both[:, 0]
        for k, fold in enumerate(linear.folds):
            columns, test = projected.columns[fold.absent], projected.residual_rows(fold)
            theta, explained = _solve(
                whole.less(_products(columns, test, fold.residual[:, None], group)), group, linear
            )
            predicted = test[:, group.first] * theta[0, :, 0]
            predicted[:, group.pairs] += test[:, group.second[group.pairs]] * theta[1, group.pairs, 0]
            remaining = fold.residual[:, None] - predicted
            held_out[fold.poses] = (remaining**2).reshape(-1, linear.rows, remaining.shape[1]).sum(axis=1)
            squares_left = residual @ residual - residual[fold.absent] @ fold.residual
            others = count - int(np.count_nonzero(present[fold.absent]))
            by_fold[k] = _bic_gain(explained, others, squares_left, group)[:, 0]
        gains = _bic_gain(_solve(whole, group, linear)[1], count, (both**2).sum(axis=0), group)
        squares.append(held_out)
        fold_gain.append(by_fold)
        gain.append(gains[:, 0])
        largest = np.maximum(largest, gains[:, 1:].max(axis=0))
        progress(number + 1, len(groups))
    every, chosen = np.concatenate(squares, axis=1), np.concatenate(fold_gain, axis=1).argmax(axis=1)
    nested = np.empty(rows // linear.rows)
    for fold, law in zip(linear.folds, chosen.tolist(), strict=True):
        nested[fold.poses] = every[fold.poses, law]
    total = np.concatenate(gain)
    return LawSearch(
        laws=tuple(law for group in groups for law in group.laws),
        squares=every,
        nested=nested,
        bic_gain=total,
        p_value=float(1 + np.count_nonzero(largest >= total.max())) / (1 + NULL_DRAWS),
    )


@dataclass(frozen=True, eq=False)
class _Products:
    """Products of columns: `along` (M, D) with D residuals, `square` (M,) and `cross` (pairs,) of the laws' terms."""

    along: Array
    square: Array
    cross: Array

    def less(self, absent: _Products) -> _Products:
        """Products over the rows that remain without the absent ones; of the first residuals."""
        along = self.along[:, : absent.along.shape[1]] - absent.along
        return _Products(along, self.square - absent.square, self.cross - absent.cross)


def _products(motions: Array, others: Array, residuals: Array, group: LawColumns) -> _Products:
    """Products of motions (r, M) with residuals (r, D), and with `others` (r, M): the same motions, or projected."""
    a, b = group.first[group.pairs], group.second[group.pairs]
    cross = np.einsum("rp,rp->p", motions[:, a], others[:, b])
    return _Products(motions.T @ residuals, np.einsum("rm,rm->m", motions, others), cross)


def _solve(products: _Products, group: LawColumns, linear: LinearisedFit) -> tuple[Array, Array]:
    """Ridge estimates (2, L, D) of every law on D residuals (rows, D), and the squares (L, D) that they explain."""
    a, b, along = group.first, group.second, products.along
    cross = np.zeros(len(a))
    cross[group.pairs] = products.cross
    aa, bb = products.square[a] + linear.ridge, products.square[b] + linear.ridge
    determinant = (aa * bb - cross**2)[:, None]
    first = (bb[:, None] * along[a] - cross[:, None] * along[b]) / determinant
    second = (aa[:, None] * along[b] - cross[:, None] * along[a]) / determinant
    return np.stack([first, second]), first * along[a] + second * along[b]


def _bic_gain(explained: Array, count: int, total: Array | float, group: LawColumns) -> Array:
    """(L, D), decrease of the BIC by each law on D residuals of `count` rows with sums of squares `total` (D,)."""
    terms = np.array([len(law.terms) for law in group.laws])
    return np.asarray(-count * np.log1p(-np.minimum(explained / total, 1.0 - 1e-12)) - terms[:, None] * np.log(count))
