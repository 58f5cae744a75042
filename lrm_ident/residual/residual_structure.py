"""Autocorrelation of the residual in joint space and in order of measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from lrm_ident.residual.thresholds import SIGNIFICANCE
from lrm_math.arrays import Array

NEIGHBOURS, DRAWS, SEED = 6, 400, 0
PAIRS_AT_ONCE = 200
ROUND_OFF = 1e-12


@dataclass(frozen=True)
class ResidualStructure:
    """Moran's I of the residual among neighbours in joint space (1 alike, 0 unrelated; Moran 1950), its p value, and
    that of the autocorrelation of successive poses; both by Monte Carlo tests on noise that went through the same fit.
    """

    moran_i: float
    p_value: float
    order_p_value: float

    @property
    def significant(self) -> bool:
        """Whether neighbours or successive poses are significantly alike; the smaller p value pays for both tests
        (Bonferroni)."""
        return 2.0 * min(self.p_value, self.order_p_value) < SIGNIFICANCE


def residual_structure(q: Array, residual: Array, basis: Array) -> ResidualStructure:
    """Tests the residual for structure.

    Args:
        q: (N, n), joint angles (rad). residual: (R N,), of the fit. basis: (R N, P), orthonormal basis of its columns.
            Rows that were not measured are zero in both.
    """
    near, successive = neighbours(q), np.stack([np.arange(len(q) - 1), np.arange(1, len(q))], axis=1)
    rows = len(residual) // len(q)
    measured = rows_present(residual, basis)
    noise = np.random.default_rng(SEED).normal(size=(len(residual), DRAWS)) * measured[:, None]
    noise -= basis @ (basis.T @ noise)
    observed = [_morans_i(residual[:, None], pairs, rows)[0] for pairs in (near, successive)]
    p_values = [
        _p_value(i, _morans_i(noise, pairs, rows)) for i, pairs in zip(observed, (near, successive), strict=True)
    ]
    return ResidualStructure(float(observed[0]), *p_values)


def rows_present(residual: Array, basis: Array) -> NDArray[np.bool_]:
    """(M,), which rows of a residual (M,) and a basis (M, P) hold a number that was measured, not round-off."""
    least = ROUND_OFF * np.abs(residual).max(initial=0.0)
    return np.asarray((np.abs(residual) > least) | (np.abs(basis) > ROUND_OFF).any(axis=1))


def neighbours(q: Array) -> NDArray[np.int64]:
    """(M, 2), pairs of each pose and one of its `NEIGHBOURS` nearest ones, by joint angles q (N, n) in rad."""
    count, every = min(NEIGHBOURS, len(q) - 1), np.arange(len(q))
    near = [_nearest(q, rows, count) for rows in np.array_split(every, -(-len(q) // PAIRS_AT_ONCE))]
    return np.stack([np.repeat(every, count), np.concatenate(near).ravel()], axis=1)


def _nearest(q: Array, rows: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(M, count), nearest poses to each of M rows, in any order."""
    apart = (q**2).sum(axis=1) - 2.0 * q[rows] @ q.T  # squared distances, less the square of the row's own angles
    apart[np.arange(len(rows)), rows] = np.inf
    return np.argpartition(apart, count - 1, axis=1)[:, :count]


def _morans_i(residuals: Array, pairs: NDArray[np.int64], rows: int) -> Array:
    """(D,), Moran's I: mean product of paired residual vectors over their mean square, of D residuals (R N, D)."""
    vectors = residuals.reshape(-1, rows, residuals.shape[1])
    some = np.array_split(pairs, -(-len(pairs) // PAIRS_AT_ONCE))
    products = sum(np.einsum("pcd,pcd->d", vectors[i], vectors[j]) for i, j in (part.T for part in some)) / len(pairs)
    return np.asarray(products / np.einsum("ncd,ncd->d", vectors, vectors) * len(vectors))


def _p_value(observed: float, simulated: Array) -> float:
    """One-sided Monte Carlo p value; where no simulated value is as large, from a normal fitted to them."""
    count = int(np.count_nonzero(simulated >= observed))
    if count:
        return (count + 1) / (len(simulated) + 1)
    return float(min(ndtr((simulated.mean() - observed) / simulated.std()), 1 / (len(simulated) + 1)))
