"""Optimality criteria for sets of poses: D-optimality (O1), Ds-optimality, and the eigenvalue indices O2 to O5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.design.feasibility import FeasibleCriterion, FeasibleScore
from lrm_ident.design.fisher_information import FisherInformation, Rows, WhitenedColumns, fisher_information, whiten
from lrm_ident.design.observability import Index, observability_index
from lrm_math.arrays import Array

EXACT_CANDIDATES = 12


@dataclass(frozen=True, eq=False)
class DeterminantCriterion:
    """Σ weight · log det of several information matrices of the same poses: log O1, or Ds-optimality."""

    parts: tuple[tuple[WhitenedColumns, float], ...]

    @property
    def count(self) -> int:
        """Number of candidates."""
        return int(self.parts[0][0].columns.shape[1])

    def evaluate(self, rows: Rows) -> DeterminantScore:
        """The score of a set."""
        return DeterminantScore(tuple((fisher_information(columns, rows), weight) for columns, weight in self.parts))


@dataclass(frozen=True, eq=False)
class DeterminantScore:
    """A set under `DeterminantCriterion`."""

    parts: tuple[tuple[FisherInformation, float], ...]

    @property
    def score(self) -> float:
        """Σ weight · log det."""
        return sum(weight * part.log_det for part, weight in self.parts)

    def scores(self, sign: int, among: Rows) -> Array:
        """Scores with each of the candidates `among` added (+1) or removed (−1); −inf where singular."""
        dets = [(part.log_dets(sign, among), weight) for part, weight in self.parts]
        singular = np.logical_or.reduce([np.isneginf(det) for det, _ in dets])
        total = sum(weight * np.where(singular, 0.0, det) for det, weight in dets)
        return np.where(singular, -np.inf, total)

    def updated(self, row: int, sign: int) -> DeterminantScore:
        """Score with one candidate added (+1) or removed (−1)."""
        return DeterminantScore(tuple((part.updated(row, sign), weight) for part, weight in self.parts))


@dataclass(frozen=True, eq=False)
class EigenvalueCriterion:
    """O2 to O5. Columns (N, 3, m) and prior information (m, m), in units that make parameters comparable."""

    columns: Array
    index: Index
    prior_information: Array

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self.columns)

    def evaluate(self, rows: Rows) -> EigenvalueScore:
        """The score of a set."""
        chosen = self.columns[rows].reshape(-1, self.columns.shape[2])
        return self.decomposed(chosen.T @ chosen + self.prior_information)

    def decomposed(self, M: Array) -> EigenvalueScore:
        """The score of a set with information M (m, m)."""
        return EigenvalueScore(self, M, *np.linalg.eigh(M))


@dataclass(frozen=True, eq=False)
class EigenvalueScore:
    """A set under `EigenvalueCriterion`: its information M (m, m), eigenvalues and eigenvectors."""

    criterion: EigenvalueCriterion
    M: Array
    values: Array
    vectors: Array

    @property
    def score(self) -> float:
        """The index."""
        return float(observability_index(self.values, self.criterion.index, 1))

    def scores(self, sign: int, among: Rows) -> Array:
        """Exact for the best few by first-order perturbation of the eigenvalues, −inf for the rest."""
        J, index = self.criterion.columns[among], self.criterion.index
        first_order = observability_index(self.values + sign * ((J @ self.vectors) ** 2).sum(axis=1), index, 1)
        best = np.argsort(-first_order)[:EXACT_CANDIDATES]
        exact = np.linalg.eigvalsh(self.M + sign * J[best].transpose(0, 2, 1) @ J[best])
        out = np.full(len(among), -np.inf)
        out[best] = observability_index(exact, index, 1)
        return out

    def updated(self, row: int, sign: int) -> EigenvalueScore:
        """Score with one candidate added (+1) or removed (−1)."""
        J = self.criterion.columns[row]
        return self.criterion.decomposed(self.M + sign * J.T @ J)


Criterion = DeterminantCriterion | EigenvalueCriterion | FeasibleCriterion
PoseSetScore = DeterminantScore | EigenvalueScore | FeasibleScore
"""A set of poses with its `score`; the larger the better."""


def criterion_of(columns: Array, index: Index, prior_information: Array | None = None) -> Criterion:
    """The criterion that maximises one of the five indices.

    O1 but for the number of poses, which is the same for all sets compared: log (σ1 … σm)^(1/m).

    Args:
        columns: (N, 3, m), identification Jacobian of the candidates. prior_information: (m, m), same units.

    Raises:
        RankDeficient: the candidates do not determine all parameters.
    """
    m, whitened = columns.shape[2], whiten(columns, prior_information)
    if index == "O1":
        return DeterminantCriterion(((whitened, 0.5 / m),))
    return EigenvalueCriterion(columns, index, np.zeros((m, m)) if prior_information is None else prior_information)
