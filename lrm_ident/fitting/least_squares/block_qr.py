"""QR factor of a tall Jacobian by blocks of poses (Golub 1965; TSQR, Demmel et al. 2012).

R of a QR decomposition holds all that least squares needs of the columns: RᵀR = JᵀJ. Blocks are computed and taken in
one after the other, so that memory does not grow with the number of poses; unlike in sums of normal equations the
condition number is not squared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import Whitening
from lrm_math.arrays import Array
from lrm_math.model.derivatives import BLOCK
from lrm_math.model.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class CompressedRows:
    """Few rows with the normal equations of many.

    `columns` (M, P) and `residual` (M,), M ≤ P + 1, have the same inner products as all 3 N rows, so the same norms,
    projections and least-squares solutions.
    """

    columns: Array
    residual: Array


def compress(
    rest: Equilibrium, keys: Sequence[str], whitening: Whitening, weight: Array, residual: Array
) -> CompressedRows:
    """The Jacobian of an equilibrium's measured rows and a residual, whitened and weighted, as few rows.

    Args:
        keys: P parameters; their columns are scaled by their typical sizes.
        weight: (N, 1) or (1, 1), factor of the rows of each pose.
        residual: (N, R), whitened, not weighted yet.
    """
    factor: Array = np.empty((0, len(keys) + 1))
    for rows in np.split(np.arange(len(rest.poses)), range(BLOCK, len(rest.poses), BLOCK)):
        block = _weighted(rest, keys, whitening, weight, residual, rows)
        factor = np.asarray(np.linalg.qr(np.concatenate([factor, block.reshape(-1, len(keys) + 1)]), mode="r"))
    return CompressedRows(factor[:, :-1], factor[:, -1])


def compress_each(
    rest: Equilibrium,
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
        block = _weighted(rest, keys, whitening, weight, residual, np.concatenate(together))
        for rows in np.split(block, np.cumsum([len(part) for part in together])[:-1]):
            factor = np.asarray(np.linalg.qr(rows.reshape(-1, len(keys) + 1), mode="r"))
            yield CompressedRows(factor[:, :-1], factor[:, -1])


def _weighted(
    rest: Equilibrium,
    keys: Sequence[str],
    whitening: Whitening,
    weight: Array,
    residual: Array,
    rows: NDArray[np.int64],
) -> Array:
    """(n, R, P + 1), scaled Jacobian and residual of some poses, whitened and weighted."""
    typical = np.array([rest.model.parameter(key).typical for key in keys])
    scale = weight if len(weight) == 1 else weight[rows]
    if not np.array_equal(rows, np.arange(len(rest.poses))):
        rest, whitening = rest.take(rows), whitening.take(rows)
    J = whitening.jacobian(rest, keys) * typical
    return np.asarray(np.concatenate([J, residual[rows][:, :, None]], axis=2) * scale[:, :, None])
