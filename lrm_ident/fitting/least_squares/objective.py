"""Objective of the fit: robust loss of the residuals (M-estimator) plus the negative logarithm of a Gaussian prior.

Parameters are scaled by their typical sizes, residuals by the stated noise of their pose (m where none is stated).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import enumerate_words
from lrm_ident.fitting.least_squares.block_qr import CompressedRows, NormalEquations, compress, compress_each
from lrm_ident.fitting.loss import Loss, robust_scale
from lrm_ident.fitting.priors import Prior, of_the_set_up
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.derivatives import BLOCK, respond
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.fixed_point import NewtonPreconditioner
from lrm_math.model.model import Model

SLOW, LARGEST_CHANGE = 0.5, 2.0  # rate of convergence from which it is accelerated; largest change of log σ at once
SCALE_TOLERANCE = 1e-3  # relative change at which the noise scale has converged
PENALTY_TOLERANCE = 0.05  # relative change of σ at which it has converged where penalties of forms depend on it
MIN_SCALE = 1e-9  # m, or of the stated noise
EQUILIBRIUM_TOLERANCE = 1e-11  # m: with a larger one the objective is too rough for its last steps
ROUND_OFF = 1e-15
MIN_SIGMA = 1e-5  # m: below any tracker's noise; at much smaller values the prior is lost in round-off


class UnidentifiableParameters(LrmError):
    """Parameters to fit that nothing at these poses depends on; carries their `keys`."""

    def __init__(self, keys: Sequence[str]) -> None:
        self.keys = tuple(keys)
        which = f"{enumerate_words(keys, 3)}: {'it' if len(keys) == 1 else 'they'} cannot be fitted to these data"
        super().__init__(f"nothing at these poses depends on {which}")


@dataclass(frozen=True, eq=False)
class Iterate:
    """One iterate: scaled parameters z (P,), equilibrium, whitened residual (N, R).

    `linearised`: cached results of `Objective.linearise`, by the scale of the loss.
    """

    z: Array
    equilibrium: Equilibrium
    residual: Array
    linearised: dict[float, CompressedRows] = field(default_factory=dict, repr=False)

    @property
    def distance(self) -> Array:
        """(N,), norms of the residual."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


@dataclass(frozen=True)
class NoiseScale:
    """Scales of the noise: the robust `scale` of the loss, and the `sigma` that weighs data against the prior."""

    scale: float
    sigma: float

    @property
    def prior_weight(self) -> float:
        """Change of the objective per unit of the log-posterior; zero without a prior."""
        return (self.sigma / self.scale) ** 2

    def close_to(self, other: NoiseScale, sigma_tolerance: float) -> bool:
        """Whether both agree: the scale to `SCALE_TOLERANCE`, σ to a part of itself."""
        scale_change, sigma_change = abs(self.scale - other.scale), abs(self.sigma - other.sigma)
        return scale_change < SCALE_TOLERANCE * other.scale and sigma_change <= sigma_tolerance * other.sigma


@dataclass(frozen=True)
class NoiseUpdate:
    """One fixed-point step of the noise: `given` weighed the data, `estimated` followed from the fit."""

    given: NoiseScale
    estimated: NoiseScale

    def accelerated(self, before: NoiseUpdate | None) -> NoiseScale:
        """Noise to try next, by Aitken's method on log σ: with a narrow prior the plain iteration is too slow."""
        if before is None or self.estimated.sigma == 0.0:
            return self.estimated
        start, change = math.log(self.given.sigma), math.log(self.estimated.sigma / self.given.sigma)
        apart = start - math.log(before.given.sigma)
        slope = math.log(self.estimated.sigma / before.estimated.sigma) / apart if apart else 0.0
        if not SLOW < slope < 1.0:
            return self.estimated
        change = min(max(change / (1.0 - slope), -LARGEST_CHANGE), LARGEST_CHANGE)
        return NoiseScale(self.estimated.scale, math.exp(start + change))


@dataclass(frozen=True, eq=False)
class Objective:
    """Σ ρ(distance / scale) + ½ (σ/scale)² (z − z_p)ᵀ P (z − z_p) over the model's free parameters (thesis Eq 2.66).

    z_p, P: the prior's mean and precision.
    """

    model: Model
    data: Measurements
    loss: Loss
    prior: Prior | None

    @cached_property
    def columns(self) -> list[int]:
        """Indices of the free parameters in the model's values."""
        return [self.model.position(key) for key in self.model.free]

    @cached_property
    def typical(self) -> Array:
        """(P,), typical sizes (SI)."""
        return np.array([self.model.parameters[j].typical for j in self.columns])

    @cached_property
    def _with_prior(self) -> list[int]:
        """The K free parameters that have a prior."""
        return [] if self.prior is None else [j for j, key in enumerate(self.model.free) if key in self.prior.keys]

    @property
    def has_full_prior(self) -> bool:
        """Whether every free parameter has a prior, but for those of the set-up of the measurement."""
        with_prior = set(self._with_prior)
        return all(j in with_prior or of_the_set_up(key) for j, key in enumerate(self.model.free))

    @cached_property
    def _prior_mean(self) -> Array:
        """(P,), scaled; zero where there is no prior."""
        mean, keys = np.zeros(len(self.model.free)), [self.model.free[j] for j in self._with_prior]
        if self.prior is not None:
            mean[self._with_prior] = self.prior.mean_of(keys) / self.typical[self._with_prior]
        return mean

    @cached_property
    def _prior_root(self) -> Array:
        """(K, P), root R of the prior's precision RᵀR, scaled."""
        root, places = np.zeros((len(self._with_prior), len(self.model.free))), self._with_prior
        if self.prior is not None:
            typical = self.typical[places]
            covariance = self.prior.covariance_of([self.model.free[j] for j in places]) / np.outer(typical, typical)
            root[:, places] = np.linalg.inv(np.linalg.cholesky(covariance))
        return root

    @cached_property
    def _prior_precision(self) -> Array:
        """(P, P), scaled; zero without a prior."""
        return self._prior_root.T @ self._prior_root

    def at(self, z: Array, near: Equilibrium | None) -> Iterate:
        """The iterate at scaled parameters; `near`: an equilibrium to start from. Raises `NoEquilibrium`."""
        values = self.model.values.copy()
        values[self.columns] = z * self.typical
        if near is None or near.poses is not self.data.poses or not _equal(values, near.model.values):
            preconditioner = None if near is None else self.preconditioner(near)
            model, poses = self.model.with_values(values), self.data.poses
            near = solve_equilibrium(model, poses, near, EQUILIBRIUM_TOLERANCE, preconditioner)
        return Iterate(z, near, self.data.whitening(self.data.residual(near)))

    def preconditioner(self, near: Equilibrium) -> NewtonPreconditioner | None:
        """Preconditioner of an equilibrium at which the fit is linearised; None for more than `BLOCK` poses."""
        return respond(near, self.data.whitening.sensed).preconditioner if len(near.poses) <= BLOCK else None

    def value(self, iterate: Iterate, noise: NoiseScale) -> float:
        """The objective."""
        deviation = self._prior_root @ (iterate.z - self._prior_mean)
        prior = 0.5 * noise.prior_weight * float(deviation @ deviation)
        return float(self.loss.rho(iterate.distance / noise.scale).sum()) + prior

    def linearise(self, iterate: Iterate, noise: NoiseScale) -> CompressedRows:
        """Scaled Jacobian and residual, weighted by the loss (iteratively reweighted)."""
        if noise.scale not in iterate.linearised:
            weight = self.root_weight(iterate, noise)
            rows = compress(iterate.equilibrium, self.model.free, self.data.whitening, weight, iterate.residual)
            iterate.linearised[noise.scale] = rows
        return iterate.linearised[noise.scale]

    def linearise_each(
        self, iterate: Iterate, noise: NoiseScale, parts: Sequence[NDArray[np.int64]]
    ) -> list[CompressedRows]:
        """`linearise` of each of some parts of the poses (rows)."""
        weight = self.root_weight(iterate, noise)
        return list(
            compress_each(iterate.equilibrium, self.model.free, self.data.whitening, weight, iterate.residual, parts)
        )

    def root_weight(self, iterate: Iterate, noise: NoiseScale) -> Array:
        """(N, 1), square root of the weight of each pose in the loss."""
        return np.sqrt(self.loss.weight(iterate.distance / noise.scale))[:, None]

    def negative_gradient(self, iterate: Iterate, data: NormalEquations, noise: NoiseScale) -> Array:
        """(P,), negative gradient of the objective, times scale²."""
        return np.asarray(data.right + noise.sigma**2 * self._prior_precision @ (self._prior_mean - iterate.z))

    def gauss_newton(self, data: NormalEquations, noise: NoiseScale) -> Array:
        """(P, P), Gauss–Newton Hessian, times scale²."""
        return np.asarray(data.gram + noise.sigma**2 * self._prior_precision)

    def inverse_hessian(self, J: Array, noise: NoiseScale, free: NDArray[np.bool_]) -> Array:
        """(p, p), inverse of `gauss_newton` of the p parameters off their bounds, by QR, which does not square the
        condition number. Raises `UnidentifiableParameters`: neither the data nor a prior say anything of them."""
        from scipy.linalg.lapack import dtrtri  # takes a quarter of a second to load

        rows = np.concatenate([J[:, free], noise.sigma * self._prior_root[:, free]])
        unknown = np.flatnonzero(free)[~rows.any(axis=0)]
        if len(unknown):
            raise UnidentifiableParameters([self.model.free[j] for j in unknown])
        root, singular = dtrtri(np.linalg.qr(rows, mode="r"))
        if singular:
            raise LrmError("these poses cannot tell some of the parameters from each other: fit the identifiable ones")
        return np.asarray(root @ root.T)

    def effective_parameters(self, inverse: Array, noise: NoiseScale, free: NDArray[np.bool_]) -> float:
        """Effective number of parameters, those that the data determine: γ = p − σ² tr(H⁻¹ P) (MacKay 1992)."""
        prior = self._prior_precision[np.ix_(free, free)]
        return len(inverse) - noise.sigma**2 * float((inverse * prior).sum())

    def weight(self, iterate: Iterate) -> Array:
        """(N,), weight of each pose in the loss."""
        return self.loss.weight(iterate.distance / self._scale(iterate))

    def residual_sd(self, iterate: Iterate, parameters: float = 0.0, squares: float | None = None) -> float:
        """Weighted residual standard deviation per axis, in units of the noise.

        Args:
            parameters: effective number of those fitted.
            squares: weighted sum of squares, where it is not the residual's.
        """
        weight = self.weight(iterate)
        freedom = float((self.data.whitening.measured * weight).sum()) - parameters
        if squares is None:
            squares = float((weight[:, None] * iterate.residual**2).sum())
        return float(np.sqrt(squares / freedom)) if freedom > 0 else np.nan

    def noise_scale(self, iterate: Iterate, parameters: float = 0.0, squares: float | None = None) -> NoiseScale:
        """Noise scale estimated from the residual, or as the prior knows it; arguments as of `residual_sd`."""
        scale = self._scale(iterate)
        if self.prior is None:
            return NoiseScale(scale, 0.0)
        sd = self.data.whitening.sd
        if self.prior.noise is not None:
            return NoiseScale(scale, max(self.prior.noise / self.data.whitening.unit, 0.0 if sd is None else 1.0))
        least = MIN_SIGMA / (1.0 if sd is None else float(sd.mean()))
        return NoiseScale(scale, max(self.residual_sd(iterate, parameters, squares), least))

    def _scale(self, iterate: Iterate) -> float:
        """Robust scale of the loss; 1 for least squares, which needs none."""
        if self.loss.name == "squared":
            return 1.0
        return max(robust_scale(iterate.distance, self.data.whitening.measured), MIN_SCALE)


class ObjectiveFromCommand(Objective):
    """The objective at the equilibria that are found from the commanded angles, as whoever has the model finds them."""

    def at(self, z: Array, near: Equilibrium | None) -> Iterate:
        """The iterate at scaled parameters, whatever is near. Raises `NoEquilibrium`."""
        model = self.model.with_values_of(self.model.free, z * self.typical)
        return super().at(z, solve_equilibrium(model, self.data.poses))


def _equal(values: Array, others: Array) -> bool:
    """Whether parameters are equal but for the round-off of scaling and back."""
    return bool(np.allclose(values, others, rtol=ROUND_OFF, atol=0.0))
