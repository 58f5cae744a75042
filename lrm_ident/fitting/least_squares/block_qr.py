"""QR factor of a tall Jacobian by blocks of poses (Golub 1965; TSQR, Demmel et al. 2012).

R of a QR decomposition holds all that least squares needs of the columns: RᵀR = JᵀJ. Blocks are computed and taken in
one after the other, so that memory does not grow with the number of poses; unlike in sums of normal equations the
condition number is not squared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import Whitening
from lrm_math.arrays import Array
from lrm_math.model.derivatives import BLOCK
from lrm_math.model.equilibrium import Equilibrium

PANEL = 8  # columns that are eliminated together


@dataclass(frozen=True, eq=False)
class CompressedRows:
    """Few rows with the normal equations of many.

    `columns` (M, P) and `residual` (M,), M = P + 1, have the same inner products as all R N rows, so the same norms,
    projections and least-squares solutions.
    """

    columns: Array
    residual: Array

    @cached_property
    def normal(self) -> NormalEquations:
        """Their normal equations."""
        return NormalEquations(self.columns.T @ self.columns, self.columns.T @ self.residual)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations JᵀJ x = Jᵀr of least squares: `gram` (P, P) and `right` (P,)."""

    gram: Array
    right: Array

    @staticmethod
    def summed(parts: Sequence[NormalEquations]) -> NormalEquations:
        """Those of several parts of the rows together."""
        return NormalEquations(np.sum([part.gram for part in parts], axis=0), np.sum([p.right for p in parts], axis=0))


def compress(
    equilibrium: Equilibrium, keys: Sequence[str], whitening: Whitening, weight: Array, residual: Array
) -> CompressedRows:
    """The Jacobian of an equilibrium's measured rows and a residual, whitened and weighted, as few rows.

    Args:
        keys: P parameters; their columns are scaled by their typical sizes.
        weight: (N, 1) or (1, 1), factor of the rows of each pose.
        residual: (N, R), whitened, not weighted yet.
    """
    # the residual is one more column: its own R entries hold Qᵀr, and below them what no column explains
    factor = np.zeros((len(keys) + 1, len(keys) + 1), order="F")
    for rows in np.split(np.arange(len(equilibrium.poses)), range(BLOCK, len(equilibrium.poses), BLOCK)):
        factor = _with_rows(factor, _weighted(equilibrium, keys, whitening, weight, residual, rows))
    return CompressedRows(factor[:, :-1], factor[:, -1])


def compress_each(
    equilibrium: Equilibrium,
    keys: Sequence[str],
    whitening: Whitening,
    weight: Array,
    residual: Array,
    parts: Sequence[NDArray[np.int64]],
) -> Iterator[CompressedRows]:
    """`compress` of each of some parts (rows), their Jacobians computed together, `BLOCK` poses at once or one part."""
    ends = np.cumsum([len(part) for part in parts])
    for number in np.unique(ends // BLOCK):
        together = [part for part, end in zip(parts, ends, strict=True) if end // BLOCK == number]
        block = _weighted(equilibrium, keys, whitening, weight, residual, np.concatenate(together))
        for rows in np.split(block, np.cumsum([len(part) for part in together])[:-1], axis=2):
            factor = _with_rows(np.zeros((len(block), len(block)), order="F"), rows)
            yield CompressedRows(factor[:, :-1], factor[:, -1])


def _with_rows(factor: Array, rows: Array) -> Array:
    """(P + 1, P + 1), the triangular factor with further rows (P + 1, R, n) taken in."""
    from scipy.linalg.lapack import dtpqrt  # takes a quarter of a second to load

    columns = rows.reshape(len(rows), -1).T
    # QR of a triangle on top of a rectangle: the triangle of [R; rows], without ever holding all rows
    updated, *_ = dtpqrt(0, min(PANEL, len(rows)), factor, columns, overwrite_a=True, overwrite_b=True)
    return np.asarray(updated)


def _weighted(
    equilibrium: Equilibrium,
    keys: Sequence[str],
    whitening: Whitening,
    weight: Array,
    residual: Array,
    rows: NDArray[np.int64],
) -> Array:
    """(P + 1, R, n), scaled Jacobian and residual of some poses, whitened and weighted."""
    typical = np.array([equilibrium.model.parameter(key).typical for key in keys])
    scale = weight if len(weight) == 1 else weight[rows]
    if not np.array_equal(rows, np.arange(len(equilibrium.poses))):
        equilibrium, whitening = equilibrium.take(rows), whitening.take(rows)
    J = whitening.jacobian(equilibrium, keys).transpose(2, 1, 0)
    out = np.empty((len(keys) + 1, *J.shape[1:]))
    np.multiply(J, typical[:, None, None], out=out[:-1])
    out[-1] = residual[rows].T
    out *= scale.T
    return out
