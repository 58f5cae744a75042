"""Is there anything left to find? Noise floor, and structure of the residual among neighbours and in order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array

NEIGHBOURS, DRAWS, SEED = 6, 400, 0


@dataclass(frozen=True)
class Floor:
    """Standard deviation of the measurement per axis (m), or None, and where it is known from."""

    sd: float | None
    source: Literal["replicates", "metadata", "unknown"]

    @property
    def rms(self) -> float | None:
        """RMS of the 3-D distance that the noise alone makes (m)."""
        return None if self.sd is None else float(np.sqrt(3.0) * self.sd)


def noise_floor(data: Measurements) -> Floor:
    """From repeated poses where there are some, else from the file, else unknown."""
    groups = [np.flatnonzero(data.repeat_of == number) for number in np.unique(data.repeat_of)]
    repeats = [rows for rows in groups if len(rows) > 1]
    if repeats:
        squares = sum(float(((data.tcp[rows] - data.tcp[rows].mean(axis=0)) ** 2).sum()) for rows in repeats)
        freedom = 3 * sum(len(rows) - 1 for rows in repeats)
        return Floor(float(np.sqrt(squares / freedom)), "replicates")
    if data.sd is not None:
        return Floor(float(np.sqrt(np.mean(data.sd**2))), "metadata")
    return Floor(data.noise_sd, "unknown" if data.noise_sd is None else "metadata")


@dataclass(frozen=True)
class Structure:
    """Moran's I of the residual among neighbours in joint space (1 alike, 0 unrelated), its p value and that of the
    likeness of successive poses, both against noise that went through the same fit."""

    moran_i: float
    p_value: float
    order_p_value: float


def structure(q: Array, residual: Array, basis: Array) -> Structure:
    """Looks for structure.

    Args:
        q: (N, n) joint angles (rad). residual: (3 N,), what the fit leaves. basis: (3 N, P), what the fit explains.
    """
    near, chain = _neighbours(q), np.stack([np.arange(len(q) - 1), np.arange(1, len(q))], axis=1)
    rng = np.random.default_rng(SEED)
    noise = rng.normal(size=(len(residual), DRAWS))
    noise -= basis @ (basis.T @ noise)
    seen = _likeness(residual[:, None], near)[0], _likeness(residual[:, None], chain)[0]
    drawn = _likeness(noise, near), _likeness(noise, chain)
    return Structure(float(seen[0]), _p_value(seen[0], drawn[0]), _p_value(seen[1], drawn[1]))


def _neighbours(q: Array) -> NDArray[np.int64]:
    """(M, 2), pairs of poses that are near in joint space."""
    _, near = cKDTree(q).query(q, k=min(NEIGHBOURS + 1, len(q)))
    pairs = [(i, j) for i, row in enumerate(np.atleast_2d(near).tolist()) for j in row if i != j]
    return np.array(pairs, dtype=np.int64)


def _likeness(residuals: Array, pairs: NDArray[np.int64]) -> Array:
    """Mean product of paired residual vectors over their mean square, for each column of (3 N, D)."""
    vectors = residuals.reshape(-1, 3, residuals.shape[1])
    together = np.einsum("pcd,pcd->d", vectors[pairs[:, 0]], vectors[pairs[:, 1]]) / len(pairs)
    return np.asarray(together / np.einsum("ncd,ncd->d", vectors, vectors) * len(vectors))


def _p_value(seen: float, drawn: Array) -> float:
    """Of a value as large, by a normal fitted to the draws where they do not reach."""
    count = int(np.count_nonzero(drawn >= seen))
    if count:
        return (count + 1) / (len(drawn) + 1)
    from scipy.stats import norm

    return float(min(norm.sf((seen - drawn.mean()) / drawn.std()), 1 / (len(drawn) + 1)))
