"""Optimality criteria for sets of poses: D-optimality (O1), Ds-optimality, and the eigenvalue indices O2 to O5.

And constrained D-optimality: O1 among sets of poses whose own identification is feasible (thesis Figure 6.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.design.fisher_information import FisherInformation, Rows, WhitenedColumns, fisher_information, whiten
from lrm_ident.design.observability import Index, observability_index
from lrm_math.arrays import Array

INFEASIBLE = -1e6  # penalty on the score of a set whose identification breaks a bound
EXACT_CANDIDATES = 12


@dataclass(frozen=True, eq=False)
class FeasibleCriterion:
    """O1 among sets whose own linear identification keeps its bounds.

    The identification follows the exchange by the same rank-3 update as the determinant. Sets that break a bound score
    below all that keep them, the less they break it the higher.

    Attributes:
        residual: (N, R), what was measured less what is predicted, weighted as the columns, at the parameters that
            these are taken at.
        lower, upper: (m,), bounds of the change of each parameter, in the columns' units.
    """

    columns: WhitenedColumns
    residual: Array
    lower: Array
    upper: Array

    @property
    def count(self) -> int:
        """Number of candidates."""
        return int(self.columns.columns.shape[1])

    def evaluate(self, rows: Rows) -> FeasibleScore:
        """The score of a set."""
        information = fisher_information(self.columns, rows)
        gradient = np.einsum("cnm,nc->m", self.columns.columns[:, rows], self.residual[rows])
        return FeasibleScore(self, information, information.inverse @ gradient)

    def violation(self, theta: Array) -> Array:
        """Amount by which identifications (…, m), whitened, break the bounds: 0 if they keep them."""
        change = theta @ self.columns.unwhiten.T
        return np.asarray((np.maximum(self.lower - change, 0.0) + np.maximum(change - self.upper, 0.0)).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class FeasibleScore:
    """A set under `FeasibleCriterion`, with its identification theta (m,), whitened."""

    criterion: FeasibleCriterion
    information: FisherInformation
    theta: Array

    @property
    def score(self) -> float:
        """log O1, penalised where the identification breaks a bound."""
        return float(self._penalised(np.array(self.information.log_det), self.theta))

    @property
    def feasible(self) -> bool:
        """Whether its identification keeps the bounds."""
        return float(self.criterion.violation(self.theta)) == 0.0

    def scores(self, sign: int, among: Rows) -> Array:
        """Scores with each of the candidates `among` added (+1) or removed (−1); −inf where singular."""
        log_det = self.information.log_dets(sign, among)
        regular = np.isfinite(log_det)
        out = np.full(len(among), -np.inf)
        out[regular] = self._penalised(log_det[regular], self._thetas(sign, among[regular]))
        return out

    def updated(self, row: int, sign: int) -> FeasibleScore:
        """Score with one candidate added (+1) or removed (−1)."""
        theta = self._thetas(sign, np.array([row]))[0]
        return replace(self, information=self.information.updated(row, sign), theta=theta)

    def _thetas(self, sign: int, among: Rows) -> Array:
        """(len(among), m), the identification with each candidate added or removed."""
        J, V = self.criterion.columns.columns[:, among].transpose(1, 0, 2), self.information.tcp_covariance_of(among)
        innovation = (self.criterion.residual[among] - J @ self.theta)[:, :, None]
        gain = np.linalg.solve(np.eye(V.shape[1]) + sign * V, innovation)
        return self.theta + sign * ((J.transpose(0, 2, 1) @ gain)[:, :, 0] @ self.information.inverse)

    def _penalised(self, log_det: Array, theta: Array) -> Array:
        violation = self.criterion.violation(theta)
        return np.where(violation > 0.0, INFEASIBLE * (1.0 + violation), 0.0) + 0.5 / len(self.theta) * log_det


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
