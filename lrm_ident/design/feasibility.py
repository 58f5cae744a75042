"""Constrained D-optimality: O1 among sets of poses whose own identification is feasible (thesis Figure 6.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.design.fisher_information import FisherInformation, Rows, WhitenedColumns, fisher_information
from lrm_math.arrays import Array

INFEASIBLE = -1e6  # penalty on the score of a set whose identification breaks a bound


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
        J = self.criterion.columns.columns[:, among].transpose(1, 0, 2)
        innovation = (self.criterion.residual[among] - J @ self.theta)[regular]
        V, J = self.information.tcp_covariance_of(among)[regular], J[regular]
        gain = np.linalg.solve(np.eye(V.shape[1]) + sign * V, innovation[:, :, None])
        theta = self.theta + sign * ((J.transpose(0, 2, 1) @ gain)[:, :, 0] @ self.information.inverse)
        out = np.full(len(among), -np.inf)
        out[regular] = self._penalised(log_det[regular], theta)
        return out

    def updated(self, row: int, sign: int) -> FeasibleScore:
        """Score with one candidate added (+1) or removed (−1)."""
        J, [V] = self.criterion.columns.columns[:, row], self.information.tcp_covariance_of(np.array([row]))
        gain = np.linalg.solve(np.eye(len(V)) + sign * V, self.criterion.residual[row] - J @ self.theta)
        theta = self.theta + sign * (self.information.inverse @ (J.T @ gain))
        return replace(self, information=self.information.updated(row, sign), theta=theta)

    def _penalised(self, log_det: Array, theta: Array) -> Array:
        violation = self.criterion.violation(theta)
        return np.where(violation > 0.0, INFEASIBLE * (1.0 + violation), 0.0) + 0.5 / len(self.theta) * log_det
