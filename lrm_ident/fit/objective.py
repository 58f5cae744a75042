"""What a fit minimises: the loss of the residuals, and how far the parameters leave their prior, both scaled.

Parameters are counted in typical sizes, residuals in units of the stated noise of their pose (m where none is stated).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.loss import Loss, robust_scale
from lrm_ident.fit.priors import Prior
from lrm_math.arrays import Array
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model

SETTLED = 1e-3  # relative change of a yardstick at which its estimate is good enough
LEAST_SCALE = 1e-9  # m, or of the stated noise
LEAST_SIGMA = 1e-5  # m: finer than any tracker of a whole arm; far below it a prior would be lost in round-off


@dataclass(frozen=True, eq=False)
class State:
    """One point of the search: scaled parameters z (P,), equilibrium, residual (N, 3) in units of the noise."""

    z: Array
    rest: Equilibrium
    residual: Array

    @property
    def distance(self) -> Array:
        """(N,), of the residual."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


@dataclass(frozen=True)
class Yardstick:
    """In units of the noise: the robust `scale` of the loss, and `sigma`, against which the prior is weighed."""

    scale: float
    sigma: float

    @property
    def odds(self) -> float:
        """What the objective changes by when the logarithm of the posterior changes by one; zero without a prior."""
        return (self.sigma / self.scale) ** 2

    def close_to(self, other: Yardstick) -> bool:
        """Whether both are the same but for a thousandth."""
        return abs(self.scale - other.scale) < SETTLED * other.scale and (
            abs(self.sigma - other.sigma) <= SETTLED * other.sigma
        )


@dataclass(frozen=True, eq=False)
class Objective:
    """Σ ρ(distance / scale) + ½ (σ/scale)² Σ ((z − z_p) / s_p)² over the model's free parameters (thesis Eq 2.66)."""

    model: Model
    data: Measurements
    loss: Loss
    prior: Prior | None

    @cached_property
    def columns(self) -> list[int]:
        """Where the free parameters stand among the model's values."""
        return [self.model.position(key) for key in self.model.free]

    @cached_property
    def typical(self) -> Array:
        """(P,), SI: what a scaled parameter of one is."""
        return np.array([self.model.parameters[j].typical for j in self.columns])

    @cached_property
    def noise(self) -> Array:
        """(N, 1) or (1, 1), the stated noise (m), one where none is stated."""
        return np.ones((1, 1)) if self.data.sd is None else self.data.sd[:, None]

    @cached_property
    def _centre(self) -> Array:
        """(P,), the prior's mean, scaled."""
        free = self.model.free
        return np.zeros(len(free)) if self.prior is None else np.asarray(self.prior.mean_of(free) / self.typical)

    @cached_property
    def _pull(self) -> Array:
        """(P,), the prior's precision, scaled; zero without one."""
        free = self.model.free
        return np.zeros(len(free)) if self.prior is None else (self.typical / self.prior.sd_of(free)) ** 2

    def at(self, z: Array, near: Equilibrium | None) -> State:
        """The state at scaled parameters. Raises `NotSettled`."""
        values = self.model.values.copy()
        values[self.columns] = z * self.typical
        rest = equilibrium(self.model.with_values(values), self.data.poses, start=near)
        return State(z, rest, (self.data.tcp - rest.tcp) / self.noise)

    def value(self, state: State, measure: Yardstick) -> float:
        """What is minimised."""
        pulled = 0.5 * measure.odds * float(self._pull @ (state.z - self._centre) ** 2)
        return float(self.loss.rho(state.distance / measure.scale).sum()) + pulled

    def jacobian(self, state: State, measure: Yardstick) -> Array:
        """(3 N, P), scaled, rows weighted as the loss does."""
        weight = self.loss.weight(state.distance / measure.scale)
        J = parameter_jacobian(state.rest, self.model.free) * self.typical / self.noise[:, :, None]
        return np.asarray((J * np.sqrt(weight)[:, None, None]).reshape(-1, len(state.z)))

    def descent(self, state: State, J: Array, measure: Yardstick) -> Array:
        """(P,), minus the gradient, times scale²."""
        weight = self.loss.weight(state.distance / measure.scale)
        to_data = J.T @ (state.residual * np.sqrt(weight)[:, None]).reshape(-1)
        return np.asarray(to_data + measure.sigma**2 * self._pull * (self._centre - state.z))

    def curvature(self, J: Array, measure: Yardstick, free: NDArray[np.bool_]) -> Array:
        """(p, p), Gauss–Newton matrix of the p parameters that are free to move, times scale²."""
        return np.asarray(J[:, free].T @ J[:, free] + np.diag(measure.sigma**2 * self._pull[free]))

    def inverse(self, J: Array, measure: Yardstick, free: NDArray[np.bool_]) -> Array:
        """(p, p), inverse of the same, without squaring its condition."""
        known = np.diag(measure.sigma * np.sqrt(self._pull[free]))
        _, R = np.linalg.qr(J[:, free] if self.prior is None else np.concatenate([J[:, free], known]))
        root = np.linalg.solve(R, np.eye(len(R)))
        return np.asarray(root @ root.T)

    def decided(self, inverse: Array, measure: Yardstick, free: NDArray[np.bool_]) -> float:
        """How many parameters the data decide: all, less the part of each that the prior decides (MacKay 1992)."""
        return len(inverse) - measure.sigma**2 * float(np.diag(inverse) @ self._pull[free])

    def weight(self, state: State) -> Array:
        """(N,), of each pose."""
        return self.loss.weight(state.distance / self._scale(state))

    def spread(self, state: State, decided: float = 0.0) -> float:
        """Standard deviation per axis that the residual shows, in units of the noise."""
        weight = self.weight(state)
        freedom = 3 * weight.sum() - decided
        return float(np.sqrt((weight[:, None] * state.residual**2).sum() / freedom)) if freedom > 0 else np.nan

    def yardstick(self, state: State, before: Yardstick | None, free: NDArray[np.bool_]) -> Yardstick:
        """What the state's residual says of scale and noise; `before`: the one it was reached with."""
        scale = self._scale(state)
        if self.prior is None:
            return Yardstick(scale, 0.0)
        decided = 0.0
        if before is not None and free.any():
            decided = self.decided(self.inverse(self.jacobian(state, before), before, free), before, free)
        return Yardstick(scale, max(self.spread(state, decided), LEAST_SIGMA / float(self.noise.mean())))

    def _scale(self, state: State) -> float:
        return 1.0 if self.loss.name == "squared" else max(robust_scale(state.distance), LEAST_SCALE)
