"""What a set of poses tells: one information matrix and its determinant, pose by pose, without decompositions.

With M = Σ JᵀJ over the set and V_i = J_i M⁻¹ J_iᵀ, taking pose i in or out multiplies det M by det(I ± V_i) and changes
M⁻¹ and every V by matrices of rank 3 (Sylvester; Woodbury). Columns are whitened first, so that all candidates
together tell the identity; that only shifts the log-determinant, and keeps the updates accurate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

Rows = NDArray[np.int64]
RIDGE = 1e-9  # of what all candidates tell: keeps a poor random start invertible
SINGULAR = 1e-7  # of the largest singular value of columns of equal length: below it a parameter cannot be told
LEAST_LEFT = 1e-12  # of the determinant that a pose may leave behind when it goes
FIRST, SECOND = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]  # the axes of the six components
FULL = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # where the six components stand in the matrix


class TooPoor(LrmError):
    """Candidates that cannot tell all parameters; carries the `rank` and the number of `parameters`."""

    def __init__(self, poses: int, rank: int, parameters: int) -> None:
        self.rank, self.parameters = rank, parameters
        super().__init__(
            f"all {poses} candidate poses together tell only {rank} of {parameters} parameters; offer more varied "
            "poses or fit fewer parameters (lrm-ident identify-parameters names those that move the TCP alike)"
        )


@dataclass(frozen=True, eq=False)
class Whitened:
    """Columns such that all candidates and what is known already tell the identity together.

    Attributes:
        columns: (3, N, m), the TCP's motion along x, y, z.
        back: (m, m), a solution in whitened columns times this is one in the units given.
        known: (m, m), what is known already, ridge included. offset: of the log-determinant.
    """

    columns: Array
    back: Array
    known: Array
    offset: float


def whiten(columns: Array, already: Array | None = None) -> Whitened:
    """Whitens columns (N, 3, m), with what is known already (m, m) in the same units. Raises `TooPoor`."""
    m = columns.shape[2]
    stacked = columns.reshape(-1, m)
    if already is not None:
        values, vectors = np.linalg.eigh(already)
        stacked = np.concatenate([stacked, (vectors * np.sqrt(np.maximum(values, 0.0))).T])
    length = np.linalg.norm(stacked, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, sigma, right = np.linalg.svd(stacked / length, full_matrices=False)
    rank = int(np.count_nonzero(sigma > SINGULAR * sigma[0]))
    if rank < m:
        raise TooPoor(len(columns), rank, m)
    back = (right.T / sigma) / length[:, None]
    known = RIDGE * np.eye(m)
    if already is not None:
        known = known + back.T @ already @ back
    offset = 2.0 * float(np.log(sigma).sum() + np.log(length).sum())
    return Whitened(np.ascontiguousarray((columns @ back).transpose(1, 0, 2)), back, known, offset)


@dataclass(frozen=True, eq=False)
class Information:
    """The information of a set of poses, among N candidates.

    Attributes:
        of: the candidates.
        inverse: (m, m), M⁻¹ of the set, whitened.
        spread: (6, N), xx, yy, zz, xy, xz, yz of every candidate's V: the covariance of its predicted TCP in units of
            the noise.
        log_det: of M, in the units given.
    """

    of: Whitened
    inverse: Array
    spread: Array
    log_det: float

    def spread_of(self, among: Rows) -> Array:
        """(len(among), 3, 3), V of some candidates."""
        return np.asarray(self.spread[:, among][FULL].transpose(2, 0, 1))

    def log_dets(self, sign: int, among: Rows) -> Array:
        """Log-determinant with each of `among` taken in (+1) or out (−1); −inf where nothing would be left."""
        left = _determinant(sign * self.spread[:, among])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(left > LEAST_LEFT, self.log_det + np.log(np.maximum(left, LEAST_LEFT)), -np.inf)

    def changed(self, i: int, sign: int) -> Information:
        """With candidate i taken in (+1) or out (−1)."""
        root = np.linalg.cholesky(np.linalg.inv(np.eye(3) + sign * self.spread[FULL, i]))
        gain = self.inverse @ self.of.columns[:, i].T @ root
        across = self.of.columns @ gain
        return replace(
            self,
            inverse=self.inverse - sign * (gain @ gain.T),
            spread=self.spread - sign * _squares(across, across),
            log_det=self.log_det - 2.0 * float(np.log(np.diag(root)).sum()),
        )


def information(of: Whitened, rows: Rows) -> Information:
    """The information of some rows of the candidates."""
    chosen = of.columns[:, rows].reshape(-1, of.columns.shape[2])
    M = chosen.T @ chosen + of.known
    inverse: Array = np.asarray(np.linalg.inv(M))
    spread = _squares(of.columns @ inverse, of.columns)
    return Information(of, inverse, spread, float(np.linalg.slogdet(M)[1]) + of.offset)


def _squares(a: Array, b: Array) -> Array:
    """xx, yy, zz, xy, xz, yz of Σ a bᵀ over the last axis of (3, N, k): (6, N)."""
    return np.asarray(np.einsum("pnk,pnk->pn", a[FIRST], b[SECOND]))


def _determinant(V: Array) -> Array:
    """det(I + V) of symmetric 3 × 3 matrices by their six components (6, N), written out: (N,)."""
    a, b, c = 1.0 + V[:3]
    d, e, f = V[3:]
    return np.asarray(a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
