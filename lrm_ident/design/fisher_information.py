"""Fisher information of a set of poses, with its determinant and low-rank updates instead of decompositions.

With M = Σ JᵀJ over the set and V_i = J_i M⁻¹ J_iᵀ, adding or removing pose i multiplies det M by det(I ± V_i)
(Sylvester) and changes M⁻¹ and every V by matrices of rank R (Woodbury), R being the numbers measured of a pose.
Columns are whitened first, so that the information of all candidates together is the identity; that only shifts
log det M, and keeps the updates accurate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

Rows = NDArray[np.int64]
RIDGE = 1e-9  # of the information of all candidates: keeps a poor random start invertible
SINGULAR = 1e-7  # of the largest singular value of columns of equal length: below it a parameter is not identifiable
MIN_DETERMINANT = 1e-12  # part of the determinant that removing a pose must leave


class RankDeficient(LrmError):
    """Candidates that do not determine all parameters."""

    def __init__(self, poses: int, rank: int, parameters: int) -> None:
        super().__init__(
            f"all {poses} candidate poses together determine only {rank} of {parameters} parameters; offer more varied "
            "poses or fit fewer parameters (lrm-ident identify-parameters names those that move the TCP alike)"
        )


@dataclass(frozen=True, eq=False)
class WhitenedColumns:
    """Columns for which all candidates and the prior information together make the identity.

    Attributes:
        columns: (R, N, m), the TCP's motion along x, y, z, or R weighted numbers that are measured of each pose.
        unwhiten: (m, m), turns a solution in whitened columns into one in the units given.
        prior_information: (m, m), ridge included. log_det_offset: log det M in the units given, less the whitened one.
    """

    columns: Array
    unwhiten: Array
    prior_information: Array
    log_det_offset: float


def whiten(columns: Array, prior_information: Array | None = None) -> WhitenedColumns:
    """Whitens columns (N, R, m), with prior information (m, m) in the same units. Raises `RankDeficient`."""
    m = columns.shape[2]
    stacked = columns.reshape(-1, m)
    if prior_information is not None:
        values, vectors = np.linalg.eigh(prior_information)
        stacked = np.concatenate([stacked, (vectors * np.sqrt(np.maximum(values, 0.0))).T])
    length = np.linalg.norm(stacked, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    # X = U Σ Vᵀ D, D the columns' lengths: with W = D⁻¹ V Σ⁻¹ is (XW)ᵀXW = I, and log det XᵀX = 2 Σ log σ + 2 Σ log D
    _, sigma, right = np.linalg.svd(stacked / length, full_matrices=False)
    rank = int(np.count_nonzero(sigma > SINGULAR * sigma[0]))
    if rank < m:
        raise RankDeficient(len(columns), rank, m)
    unwhiten = (right.T / sigma) / length[:, None]
    prior = RIDGE * np.eye(m)
    if prior_information is not None:
        prior = prior + unwhiten.T @ prior_information @ unwhiten
    offset = 2.0 * float(np.log(sigma).sum() + np.log(length).sum())
    return WhitenedColumns(np.ascontiguousarray((columns @ unwhiten).transpose(1, 0, 2)), unwhiten, prior, offset)


@dataclass(frozen=True, eq=False)
class FisherInformation:
    """The Fisher information of a set of poses, among N candidates.

    Attributes:
        candidates: all of them.
        inverse: (m, m), M⁻¹ of the set, whitened.
        tcp_covariance: (K, N), components of every candidate's V: the covariance of its predicted TCP (or of what else
            is measured) in units of the noise; for R = 3 these are xx, yy, zz, xy, xz, yz.
        log_det: of M, in the units given.
    """

    candidates: WhitenedColumns
    inverse: Array
    tcp_covariance: Array
    log_det: float

    def tcp_covariance_of(self, among: Rows) -> Array:
        """(len(among), R, R), V of some candidates."""
        component = _pairs(len(self.candidates.columns))[2]
        return np.asarray(self.tcp_covariance[:, among][component].transpose(2, 0, 1))

    def log_dets(self, sign: int, among: Rows) -> Array:
        """log det M with each of `among` added (+1) or removed (−1); −inf where it would be singular."""
        factor = _determinant(sign * self.tcp_covariance[:, among], len(self.candidates.columns))
        with np.errstate(divide="ignore", invalid="ignore"):
            log_det = self.log_det + np.log(np.maximum(factor, MIN_DETERMINANT))
            return np.where(factor > MIN_DETERMINANT, log_det, -np.inf)

    def updated(self, i: int, sign: int) -> FisherInformation:
        """Information with candidate i added (+1) or removed (−1)."""
        # (M ± JᵀJ)⁻¹ = M⁻¹ ∓ G Gᵀ, G = M⁻¹ Jᵀ root (Woodbury 1950), root rootᵀ = (I ± V)⁻¹, V = J M⁻¹ Jᵀ;
        # det (M ± JᵀJ) = det M det (I ± V)
        V = self.tcp_covariance_of(np.array([i]))[0]
        root = np.linalg.cholesky(np.linalg.inv(np.eye(len(V)) + sign * V))
        gain = self.inverse @ self.candidates.columns[:, i].T @ root
        across = self.candidates.columns @ gain
        return replace(
            self,
            inverse=self.inverse - sign * (gain @ gain.T),
            tcp_covariance=self.tcp_covariance - sign * _components(across, across),
            log_det=self.log_det - 2.0 * float(np.log(np.diag(root)).sum()),
        )


def fisher_information(candidates: WhitenedColumns, rows: Rows) -> FisherInformation:
    """The information of some rows of the candidates."""
    chosen = candidates.columns[:, rows].reshape(-1, candidates.columns.shape[2])
    M = chosen.T @ chosen + candidates.prior_information
    inverse: Array = np.asarray(np.linalg.inv(M))
    tcp_covariance = _components(candidates.columns @ inverse, candidates.columns)
    log_det = float(np.linalg.slogdet(M)[1]) + candidates.log_det_offset
    return FisherInformation(candidates, inverse, tcp_covariance, log_det)


@cache
def _pairs(rows: int) -> tuple[list[int], list[int], NDArray[np.int64]]:
    """Row and column of each component of a symmetric (rows, rows) matrix, the diagonal first, and the component of
    each of its elements.
    """
    upper = np.triu_indices(rows, 1)
    first, second = [*range(rows), *upper[0].tolist()], [*range(rows), *upper[1].tolist()]
    component = np.empty((rows, rows), dtype=np.int64)
    component[first, second] = component[second, first] = np.arange(len(first))
    return first, second, component


def _components(a: Array, b: Array) -> Array:
    """Components of Σ a bᵀ over the last axis of (R, N, k): (K, N)."""
    first, second, _ = _pairs(len(a))
    return np.asarray(np.einsum("pnk,pnk->pn", a[first], b[second]))


def _determinant(V: Array, rows: int) -> Array:
    """det(I + V) of symmetric (rows, rows) matrices by their components (K, N): (N,)."""
    if rows != 3:
        return np.asarray(np.linalg.det(np.eye(rows) + V[_pairs(rows)[2]].transpose(2, 0, 1)))
    a, b, c = 1.0 + V[:3]
    d, e, f = V[3:]
    return np.asarray(a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
