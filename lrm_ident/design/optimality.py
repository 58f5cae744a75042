"""What makes one set of poses better than another: a score, and what it would be with a pose more or less."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lrm_ident.design.fisher_information import Information, Rows, Whitened, information, whiten
from lrm_ident.design.observability import Index, index_of
from lrm_math.arrays import Array

TRIED_EXACTLY = 12


class Scored(Protocol):
    """A set of poses with its score; the larger the better."""

    @property
    def score(self) -> float:
        """Of the set itself."""

    def scores(self, sign: int, among: Rows) -> Array:
        """Of the set with each of the candidates `among` taken in (+1) or out (−1); −inf if not worth a thought."""

    def changed(self, row: int, sign: int) -> Scored:
        """The set with one candidate taken in (+1) or out (−1)."""


class Criterion(Protocol):
    """Scores sets of poses among `count` candidates."""

    @property
    def count(self) -> int:
        """How many candidates there are."""

    def of(self, rows: Rows) -> Scored:
        """A set, scored."""


@dataclass(frozen=True, eq=False)
class Determinants:
    """Σ weight · log det of several information matrices of the same poses: log O1, or Ds-optimality.

    Attributes:
        parts: (columns, weight) of each.
    """

    parts: tuple[tuple[Whitened, float], ...]

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return int(self.parts[0][0].columns.shape[1])

    def of(self, rows: Rows) -> DeterminantScore:
        """A set, scored."""
        return DeterminantScore(tuple((information(columns, rows), weight) for columns, weight in self.parts))


@dataclass(frozen=True, eq=False)
class DeterminantScore:
    """A set under `Determinants`."""

    parts: tuple[tuple[Information, float], ...]

    @property
    def score(self) -> float:
        """Σ weight · log det."""
        return sum(weight * part.log_det for part, weight in self.parts)

    def scores(self, sign: int, among: Rows) -> Array:
        """With each of `among` taken in or out."""
        dets = [(part.log_dets(sign, among), weight) for part, weight in self.parts]
        impossible = np.logical_or.reduce([np.isneginf(det) for det, _ in dets])
        total = sum(weight * np.where(impossible, 0.0, det) for det, weight in dets)
        return np.where(impossible, -np.inf, total)

    def changed(self, row: int, sign: int) -> DeterminantScore:
        """With one more or less."""
        return DeterminantScore(tuple((part.changed(row, sign), weight) for part, weight in self.parts))


def log_o1(columns: Array, already: Array | None = None) -> Determinants:
    """log (σ1 … σm)^(1/m): O1 but for the number of poses, which is the same for all sets compared."""
    return Determinants(((whiten(columns, already), 0.5 / columns.shape[2]),))


@dataclass(frozen=True, eq=False)
class ByEigenvalues:
    """O2 to O5. Columns (N, 3, m) and what is known already (m, m), in units that make parameters comparable."""

    columns: Array
    index: Index
    known: Array

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return len(self.columns)

    def of(self, rows: Rows) -> EigenScore:
        """A set, scored."""
        chosen = self.columns[rows].reshape(-1, self.columns.shape[2])
        return _eigen(self, chosen.T @ chosen + self.known)


@dataclass(frozen=True, eq=False)
class EigenScore:
    """A set under `ByEigenvalues`: its information M (m, m), eigenvalues and eigenvectors."""

    of: ByEigenvalues
    M: Array
    values: Array
    vectors: Array

    @property
    def score(self) -> float:
        """The index."""
        return float(index_of(self.values, self.of.index, 1))

    def scores(self, sign: int, among: Rows) -> Array:
        """Exact for the few that first-order perturbation of the eigenvalues promises most from, −inf for the rest."""
        J = self.of.columns[among]
        promised = index_of(self.values + sign * ((J @ self.vectors) ** 2).sum(axis=1), self.of.index, 1)
        best = np.argsort(-promised)[:TRIED_EXACTLY]
        exact = np.linalg.eigvalsh(self.M + sign * J[best].transpose(0, 2, 1) @ J[best])
        out = np.full(len(among), -np.inf)
        out[best] = index_of(exact, self.of.index, 1)
        return out

    def changed(self, row: int, sign: int) -> EigenScore:
        """With one more or less."""
        return _eigen(self.of, self.M + sign * self.of.columns[row].T @ self.of.columns[row])


def _eigen(of: ByEigenvalues, M: Array) -> EigenScore:
    return EigenScore(of, M, *np.linalg.eigh(M))


def criterion_of(columns: Array, index: Index, already: Array | None = None) -> Criterion:
    """The criterion behind one of the five indices. Raises `TooPoor`."""
    if index == "O1":
        return log_o1(columns, already)
    whiten(columns, already)
    m = columns.shape[2]
    return ByEigenvalues(columns, index, np.zeros((m, m)) if already is None else already)
