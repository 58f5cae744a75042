"""Quadratic model of the objective about an iterate (Gauss–Newton), and the damped step to its bounded minimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.least_squares.block_qr import CompressedRows
from lrm_ident.fitting.least_squares.objective import Iterate, NoiseScale, Objective
from lrm_ident.fitting.least_squares.variable_projection import with_anchor_fitted
from lrm_ident.fitting.parameter_sets import Bounds
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium

MUCH_SHORTER = 0.75  # part of a step
STEP_TOLERANCE = 1e-8  # of the typical sizes
GAIN_TOLERANCE = 1e-10  # predicted relative decrease of the objective
MAX_DAMPING = 1e12


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Gauss–Newton model of the objective about an iterate.

    Attributes:
        bounds: of the scaled parameters.
        rows: the compressed Jacobian (R, P) and residual. descent: (P,), negative gradient, times scale².
        free: (P,), whether a parameter is off its bounds, or the descent leads off them.
    """

    objective: Objective
    bounds: Bounds
    iterate: Iterate
    noise: NoiseScale
    rows: CompressedRows
    descent: Array
    free: NDArray[np.bool_]

    @staticmethod
    def about(iterate: Iterate, objective: Objective, noise: NoiseScale, bounds: Bounds) -> QuadraticModel:
        """The model about an iterate."""
        rows = objective.linearise(iterate, noise)
        descent = objective.negative_gradient(iterate, rows.normal, noise)
        held = ((iterate.z <= bounds.lower) & (descent < 0)) | ((iterate.z >= bounds.upper) & (descent > 0))
        return QuadraticModel(objective, bounds, iterate, noise, rows, descent, ~held)

    @property
    def minimum(self) -> Array:
        """(P,), scaled parameters at its minimum within the bounds."""
        return self._minimum(self.objective.gauss_newton(self.rows.normal, self.noise))

    def free_at(self, trial: Iterate) -> NDArray[np.bool_]:
        """(P,), whether a parameter is off its bounds at a trial, too."""
        return np.asarray(self.free & (trial.z > self.bounds.lower) & (trial.z < self.bounds.upper))

    def predicted_squares(self, z: Array) -> float:
        """Weighted sum of squared residuals at scaled parameters z (P,)."""
        residual = self.rows.residual - self.rows.columns @ (z - self.iterate.z)
        return float(residual @ residual)

    def predicted_decrease(self, trial: Iterate) -> float:
        """Decrease of the objective to first order from the iterate to a trial."""
        return float(self.descent @ (trial.z - self.iterate.z)) / self.noise.scale**2

    def value(self, trial: Iterate) -> float:
        """The objective itself."""
        return self.objective.value(trial, self.noise)

    def step(self, damping: float) -> tuple[Iterate, float]:
        """Levenberg–Marquardt step: an iterate with no larger objective (else the same one), and the next damping."""
        A = self.objective.gauss_newton(self.rows.normal, self.noise)
        diagonal = np.diag(np.maximum(np.diag(A), 1e-300))
        before = self.value(self.iterate)
        while damping < MAX_DAMPING:
            z = self._minimum(A + damping * diagonal)
            try:
                arm = self.objective.at(z, self.iterate.equilibrium)
                trial = with_anchor_fitted(self.objective, arm, self.noise)
            except NoEquilibrium:
                damping *= 10.0
                continue
            if self.value(trial) <= before:
                return self._shortened(trial), damping * 0.1
            if (
                np.abs(z - self.iterate.z).max() < STEP_TOLERANCE
                or self.predicted_decrease(trial) < GAIN_TOLERANCE * before
            ):
                break  # a shorter step would gain no more
            damping *= 10.0
        return self.iterate, damping

    def _minimum(self, A: Array) -> Array:
        """Minimum within the bounds for a Hessian `A`, by an active set: parameters that would leave their bounds are
        put on them and the others solved anew; clipping alone zigzags where parameters correlate (Bertsekas 1982)."""
        z, moving, change = self.iterate.z, self.free.copy(), np.zeros_like(self.iterate.z)
        while moving.any():
            change[moving] = _newton_step(
                A[np.ix_(moving, moving)], self.descent[moving] - A[np.ix_(moving, ~moving)] @ change[~moving]
            )
            inside = self._clipped(z + change)
            beyond = moving & (inside != z + change)
            if not beyond.any():
                break
            change[beyond] = (inside - z)[beyond]
            moving &= ~beyond
        return self._clipped(z + change)

    def _clipped(self, z: Array) -> Array:
        return np.clip(z, self.bounds.lower, self.bounds.upper)

    def _shortened(self, trial: Iterate) -> Iterate:
        """The trial, or, if lower, the minimum of a parabola along the step where that is much shorter (quadratic
        interpolation, Nocedal & Wright 2006, section 3.5): Gauss–Newton neglects curvature, and may step too far."""
        change, slope = trial.z - self.iterate.z, self.predicted_decrease(trial)
        gain = self.value(self.iterate) - self.value(trial)
        if not 0.0 < 0.5 * slope < MUCH_SHORTER * (slope - gain):
            return trial
        try:
            shorter = self.objective.at(
                self.iterate.z + 0.5 * slope / (slope - gain) * change, self.iterate.equilibrium
            )
        except NoEquilibrium:
            return trial
        return min(trial, shorter, key=self.value)


def _newton_step(A: Array, gradient: Array) -> Array:
    """Newton step A⁻¹ g; with the diagonal alone where A is singular."""
    try:
        return np.asarray(np.linalg.solve(A, gradient))
    except np.linalg.LinAlgError:
        return gradient / np.maximum(np.diag(A), 1e-300)
