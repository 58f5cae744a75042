"""Sets of poses whose own identification keeps the bounds of physics (thesis Figure 6.3), chosen by O1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.design.fisher_information import Information, Rows, Whitened, information
from lrm_math.arrays import Array

FORBIDDEN = -1e6  # added to the score of a set whose identification is against physics


@dataclass(frozen=True, eq=False)
class Physical:
    """O1 among sets whose own linear identification keeps its bounds (thesis Figure 6.3).

    The identification of a set follows the exchange by the same update of rank 3 as its determinant, so that it costs
    nothing; sets that break a bound rank below all that keep them, the less they break it the higher.

    Attributes:
        residual: (N, 3), measured − predicted TCP at the parameters that the columns are taken at.
        lower, upper: (m,), what a change of each parameter may be, in the columns' units.
    """

    columns: Whitened
    residual: Array
    lower: Array
    upper: Array

    @property
    def count(self) -> int:
        """How many candidates there are."""
        return int(self.columns.columns.shape[1])

    def of(self, rows: Rows) -> PhysicalScore:
        """A set, scored."""
        told = information(self.columns, rows)
        pull = np.einsum("cnm,nc->m", self.columns.columns[:, rows], self.residual[rows])
        return PhysicalScore(self, told, told.inverse @ pull)

    def broken(self, theta: Array) -> Array:
        """By how much identifications (…, m), whitened, break the bounds: 0 if they keep them."""
        change = theta @ self.columns.back.T
        return np.asarray((np.maximum(self.lower - change, 0.0) + np.maximum(change - self.upper, 0.0)).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class PhysicalScore:
    """A set under `Physical`, with its identification theta (m,), whitened."""

    of: Physical
    told: Information
    theta: Array

    @property
    def score(self) -> float:
        """log O1, far below zero where the identification is against physics."""
        return float(self._judged(np.array(self.told.log_det), self.of.broken(self.theta)))

    @property
    def feasible(self) -> bool:
        """Whether its identification keeps the bounds."""
        return float(self.of.broken(self.theta)) == 0.0

    def scores(self, sign: int, among: Rows) -> Array:
        """With each of `among` taken in or out."""
        J, V = self.of.columns.columns[:, among].transpose(1, 0, 2), self.told.spread_of(among)
        unseen = self.of.residual[among] - J @ self.theta
        log_det = self.told.log_dets(sign, among)
        possible = np.isfinite(log_det)
        out = np.full(len(among), -np.inf)
        pull = np.linalg.solve(np.eye(3) + sign * V[possible], unseen[possible][:, :, None])
        theta = self.theta + sign * ((J[possible].transpose(0, 2, 1) @ pull)[:, :, 0] @ self.told.inverse)
        out[possible] = self._judged(log_det[possible], self.of.broken(theta))
        return out

    def changed(self, row: int, sign: int) -> PhysicalScore:
        """With one more or less."""
        J, [V] = self.of.columns.columns[:, row], self.told.spread_of(np.array([row]))
        pull = np.linalg.solve(np.eye(3) + sign * V, self.of.residual[row] - J @ self.theta)
        theta = self.theta + sign * (self.told.inverse @ (J.T @ pull))
        return replace(self, told=self.told.changed(row, sign), theta=theta)

    def _judged(self, log_det: Array, broken: Array) -> Array:
        return np.where(broken > 0.0, FORBIDDEN * (1.0 + broken), 0.0) + 0.5 / len(self.theta) * log_det
