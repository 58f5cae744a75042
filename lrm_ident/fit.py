"""Least squares of a model's free parameters: Levenberg–Marquardt on scaled parameters, with bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.dataset import Measurements
from lrm_ident.loss import SQUARED, Loss, robust_scale
from lrm_math.derivatives import parameter_jacobian
from lrm_math.equilibrium import Equilibrium, equilibrium
from lrm_math.errors import LrmError, NotSettled
from lrm_math.model import Model

Array = NDArray[np.float64]
MOST_STEPS = 60
STEP_TOLERANCE = 1e-8  # of the typical sizes
GAIN_TOLERANCE = 1e-10  # of the loss, that a step promises
OUTLIER_DISTANCE = 5.0  # robust standard deviations per axis; a clean pose is beyond it once in 60 000


class NotConverged(LrmError):
    """The fit came to no minimum; carries the number of `steps` and the last `step` in typical sizes."""

    def __init__(self, steps: int, step: float) -> None:
        self.steps, self.step = steps, step
        super().__init__(
            f"the fit did not converge in {steps} steps (last step {step:.2g} of the typical sizes); "
            "hold some parameters or start from a fitted model"
        )


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bound of each fitted parameter (SI), (P,) each."""

    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model.

    Attributes:
        rest: the model's equilibrium at the data's poses.
        residual: (N, 3), measured − predicted TCP (m).
        covariance: (P, P) of the free parameters (SI); zero rows for those at a bound.
        sigma: standard deviation of the residual per axis (m), degrees of freedom counted.
        at_bound: keys of parameters that a bound holds.
        weight: (N,), the weight of each pose, 1 for least squares.
        outliers: rows that no fit of this model explains, by the robust scale.
        steps: Levenberg–Marquardt steps taken.
    """

    model: Model
    rest: Equilibrium
    residual: Array
    covariance: Array
    sigma: float
    at_bound: tuple[str, ...]
    weight: Array
    outliers: tuple[int, ...]
    steps: int

    @property
    def standard_error(self) -> Array:
        """(P,), of the free parameters (SI)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """(P, P), of the free parameters; zero where a bound holds one."""
        error = self.standard_error
        scale = np.where(error > 0, error, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))


def bounds_of(model: Model, keys: Sequence[str]) -> Bounds:
    """The physical bounds that the effects state, for instance compliances ≥ 0."""
    chosen = [model.parameters[model.position(key)] for key in keys]
    return Bounds(np.array([p.lower for p in chosen]), np.array([p.upper for p in chosen]))


def no_bounds(keys: Sequence[str]) -> Bounds:
    """No bounds at all, for instance to repeat the thesis's unconstrained options."""
    return Bounds(np.full(len(keys), -np.inf), np.full(len(keys), np.inf))


def fit(model: Model, data: Measurements, bounds: Bounds | None = None, loss: Loss | None = None) -> Fit:
    """Fits the model's free parameters, starting from their present values.

    Args:
        bounds: of the free parameters; those that the effects state if None.
        loss: least squares if None.

    Raises:
        LrmError: fewer poses than free parameters, or no convergence (`NotConverged`).
        NotSettled: the start has no elastic equilibrium.
    """
    check_enough(len(data), len(model.free))
    return _Problem(model, data, bounds or bounds_of(model, model.free), SQUARED if loss is None else loss).solve()


def check_enough(poses: int, parameters: int) -> None:
    """Raises `LrmError` if there are fewer poses than parameters."""
    if poses < parameters:
        raise LrmError(
            f"{poses} poses for {parameters} parameters; measure at least {parameters} poses, or fit fewer parameters "
            "(--parameters)"
        )


@dataclass(frozen=True, eq=False)
class _State:
    """One point of the search: scaled parameters z, equilibrium, residual (N, 3) in units of the noise."""

    z: Array
    rest: Equilibrium
    residual: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    model: Model
    data: Measurements
    bounds: Bounds
    loss: Loss

    @property
    def _columns(self) -> list[int]:
        return [self.model.position(key) for key in self.model.free]

    @property
    def _scale(self) -> Array:
        return np.array([self.model.parameters[j].typical for j in self._columns])

    def _at(self, z: Array, near: Equilibrium | None) -> _State:
        values = self.model.values.copy()
        values[self._columns] = z * self._scale
        rest = equilibrium(self.model.with_values(values), self.data.poses, start=near)
        return _State(z, rest, (self.data.tcp - rest.tcp) / self._noise)

    @property
    def _noise(self) -> Array:
        return np.ones((1, 1)) if self.data.sd is None else self.data.sd[:, None]

    def _jacobian(self, state: _State) -> Array:
        """(N, 3, P), scaled."""
        return parameter_jacobian(state.rest, self.model.free) * self._scale / self._noise[:, :, None]

    def solve(self) -> Fit:
        """Steps until none promises a gain. Raises `NotConverged`."""
        lower, upper = self.bounds.lower / self._scale, self.bounds.upper / self._scale
        state = self._at(np.clip(self.model.values[self._columns] / self._scale, lower, upper), None)
        scale = self._loss_scale(state)
        damping, step = 1e-4, np.inf
        for steps in range(1, MOST_STEPS + 1):
            if not self.model.free:
                return self._finished(state, np.zeros(0, dtype=bool), 0)
            weight = self.loss.weight(_distance(state) / scale)
            J = (self._jacobian(state) * np.sqrt(weight)[:, None, None]).reshape(-1, len(state.z))
            gradient = J.T @ (state.residual * np.sqrt(weight)[:, None]).reshape(-1)
            held = ((state.z <= lower) & (gradient < 0)) | ((state.z >= upper) & (gradient > 0))
            trial, damping = self._step(state, J, gradient, held, scale, damping, lower, upper)
            step = float(np.abs(trial.z - state.z).max())
            promised = float(gradient @ (trial.z - state.z)) / scale**2
            done = step < STEP_TOLERANCE or promised < GAIN_TOLERANCE * self._loss(state, scale)
            state = trial
            if done:
                if self.loss.name == "squared" or abs(self._loss_scale(state) / scale - 1) < 1e-3:
                    return self._finished(state, held, steps)
                scale = self._loss_scale(state)
        raise NotConverged(MOST_STEPS, step)

    def _step(
        self,
        state: _State,
        J: Array,
        gradient: Array,
        held: NDArray[np.bool_],
        scale: float,
        damping: float,
        lower: Array,
        upper: Array,
    ) -> tuple[_State, float]:
        """A step that does not raise the loss, and the damping to go on with; the state itself if there is none."""
        free = ~held
        A = J[:, free].T @ J[:, free]
        diagonal = np.diag(A).copy()
        before = self._loss(state, scale)
        while damping < 1e12:
            change = np.zeros_like(state.z)
            change[free] = _solve_damped(A, diagonal, damping, gradient[free])
            z = np.clip(state.z + change, lower, upper)
            try:
                trial = self._at(z, state.rest)
            except NotSettled:
                damping *= 10.0
                continue
            if self._loss(trial, scale) <= before:
                return trial, damping * 0.1
            if np.abs(z - state.z).max() < STEP_TOLERANCE:
                break
            damping *= 10.0
        return state, damping

    def _loss_scale(self, state: _State) -> float:
        return 1.0 if self.loss.name == "squared" else max(robust_scale(_distance(state)), 1e-9)

    def _loss(self, state: _State, scale: float) -> float:
        return float(self.loss.rho(_distance(state) / scale).sum())

    def _finished(self, state: _State, held: NDArray[np.bool_], steps: int) -> Fit:
        distance = _distance(state)
        weight = self.loss.weight(distance / self._loss_scale(state))
        residual = state.residual
        freedom = 3 * weight.sum() - np.count_nonzero(~held)
        sigma = float(np.sqrt((weight[:, None] * residual**2).sum() / freedom)) if freedom > 0 else np.nan
        covariance = np.zeros((len(held), len(held)))
        if np.any(~held):
            J = (self._jacobian(state) * np.sqrt(weight)[:, None, None]).reshape(-1, len(held))[:, ~held]
            _, R = np.linalg.qr(J)
            inverse = np.linalg.solve(R, np.eye(len(R)))
            covariance[np.ix_(~held, ~held)] = sigma**2 * inverse @ inverse.T
        covariance *= np.outer(self._scale, self._scale)
        robust = robust_scale(distance)
        return Fit(
            model=replace(state.rest.model, free=self.model.free),
            rest=state.rest,
            residual=residual * self._noise,
            covariance=covariance,
            sigma=sigma * (1.0 if self.data.sd is None else float(np.sqrt(np.mean(self.data.sd**2)))),
            at_bound=tuple(key for key, bound in zip(self.model.free, held, strict=True) if bound),
            weight=weight,
            outliers=tuple(np.flatnonzero(distance > OUTLIER_DISTANCE * robust).tolist()),
            steps=steps,
        )


def _distance(state: _State) -> Array:
    return np.asarray(np.linalg.norm(state.residual, axis=1))


def _solve_damped(A: Array, diagonal: Array, damping: float, gradient: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(A + np.diag(damping * np.maximum(diagonal, 1e-300)), gradient))
    except np.linalg.LinAlgError:
        return gradient / np.maximum(diagonal, 1e-300) / (1.0 + damping)
