"""Least squares of a model's free parameters: Levenberg–Marquardt on scaled parameters, with bounds.

With a prior it is maximum a posteriori (Conenna 2024, Eq 2.66; Tenhumberg & Bäuml 2021): the noise against which the
prior is weighed is what the fit leaves, with as many degrees of freedom as the data decide (MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.loss import SQUARED, Loss, robust_scale
from lrm_ident.fit.objective import Objective, State, Yardstick
from lrm_ident.fit.priors import Prior
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NotSettled
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

MOST_STEPS = 60
STEP_TOLERANCE = 1e-8  # of the typical sizes
GAIN_TOLERANCE = 1e-10  # of the loss, that a step promises
LIKELIHOOD_TOLERANCE = 1e-6  # of a unit of the posterior's logarithm: parameters to a thousandth of their errors
OUTLIER_DISTANCE = 5.0  # robust standard deviations per axis; a clean pose is beyond it once in 60 000


class NotConverged(LrmError):
    """The fit came to no minimum; carries the number of `steps` and the last `step` in typical sizes."""

    def __init__(self, steps: int, step: float) -> None:
        self.steps, self.step = steps, step
        super().__init__(
            f"the fit did not converge in {steps} steps (last step {step:.2g} of the typical sizes); "
            "hold some parameters, start from a fitted model, or try a prior (--prior)"
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
        covariance: (P, P) of the free parameters (SI); zero rows for those at a bound. With a prior: of the posterior.
        decided: how many parameters the data decide: all that are not at a bound, fewer where a prior helps.
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
    decided: float
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


def fit(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss | None = None,
    prior: Prior | None = None,
) -> Fit:
    """Fits the model's free parameters, starting from their present values.

    Args:
        bounds: of the free parameters; those that the effects state if None.
        loss: least squares if None.
        prior: what is known of every free parameter beforehand; with one, a third as many poses will do.

    Raises:
        LrmError: fewer poses than free parameters (with a prior: than a third), or no convergence (`NotConverged`).
        NotSettled: the start has no elastic equilibrium.
    """
    check_enough(len(data), len(model.free), prior)
    limits = bounds or bounds_of(model, model.free)
    goal = Objective(model, data, SQUARED if loss is None else loss, prior)
    return _Search(goal, limits.lower / goal.typical, limits.upper / goal.typical).solve()


def check_enough(poses: int, parameters: int, prior: Prior | None = None) -> None:
    """Raises `LrmError` for fewer poses than parameters; with a prior, for fewer coordinates than parameters.

    With fewer still, nothing would tell the noise from what the parameters do.
    """
    least = parameters if prior is None else parameters // 3 + 1
    if poses < least:
        raise LrmError(
            f"{poses} poses for {parameters} parameters; measure at least {least} poses, or fit fewer parameters "
            "(--parameters)"
        )


@dataclass(frozen=True, eq=False)
class _Search:
    goal: Objective
    lower: Array
    upper: Array

    def solve(self) -> Fit:
        """Steps until none promises a gain. Raises `NotConverged`."""
        goal, model = self.goal, self.goal.model
        state = goal.at(np.clip(model.values[goal.columns] / goal.typical, self.lower, self.upper), None)
        held = np.zeros(len(model.free), dtype=np.bool_)
        measure = goal.yardstick(state, None, ~held)
        damping, step = 1e-4, np.inf
        for steps in range(1, MOST_STEPS + 1):
            if not model.free:
                return self._finished(state, held, 0, measure)
            J = goal.jacobian(state, measure)
            descent = goal.descent(state, J, measure)
            held = ((state.z <= self.lower) & (descent < 0)) | ((state.z >= self.upper) & (descent > 0))
            trial, damping = self._step(state, J, descent, ~held, measure, damping)
            step = float(np.abs(trial.z - state.z).max())
            promised = float(descent @ (trial.z - state.z)) / measure.scale**2
            least = max(GAIN_TOLERANCE * goal.value(state, measure), LIKELIHOOD_TOLERANCE * measure.odds)
            done = step < STEP_TOLERANCE or promised < least
            state = trial
            if done:
                now = goal.yardstick(state, measure, ~held)
                if now.close_to(measure):
                    return self._finished(state, held, steps, measure)
                measure = now
        raise NotConverged(MOST_STEPS, step)

    def _step(
        self, state: State, J: Array, descent: Array, free: NDArray[np.bool_], measure: Yardstick, damping: float
    ) -> tuple[State, float]:
        """A step that does not raise the goal, and the damping to go on with; the state itself if there is none."""
        goal = self.goal
        A = goal.curvature(J, measure, free)
        diagonal = np.diag(A).copy()
        before = goal.value(state, measure)
        while damping < 1e12:
            change = np.zeros_like(state.z)
            change[free] = _solve_damped(A, diagonal, damping, descent[free])
            z = np.clip(state.z + change, self.lower, self.upper)
            try:
                trial = goal.at(z, state.rest)
            except NotSettled:
                damping *= 10.0
                continue
            if goal.value(trial, measure) <= before:
                return trial, damping * 0.1
            if np.abs(z - state.z).max() < STEP_TOLERANCE:
                break
            damping *= 10.0
        return state, damping

    def _finished(self, state: State, held: NDArray[np.bool_], steps: int, measure: Yardstick) -> Fit:
        goal, data, free = self.goal, self.goal.data, ~held
        covariance = np.zeros((len(held), len(held)))
        decided, sigma = 0.0, goal.spread(state)
        if free.any():
            now = Yardstick(goal.yardstick(state, None, free).scale, measure.sigma)
            inverse = goal.inverse(goal.jacobian(state, now), now, free)
            decided = goal.decided(inverse, now, free)
            sigma = goal.spread(state, decided)
            covariance[np.ix_(free, free)] = (now.sigma or sigma) ** 2 * inverse
        return Fit(
            model=replace(state.rest.model, free=goal.model.free),
            rest=state.rest,
            residual=state.residual * goal.noise,
            covariance=covariance * np.outer(goal.typical, goal.typical),
            decided=decided,
            sigma=sigma * (1.0 if data.sd is None else float(np.sqrt(np.mean(data.sd**2)))),
            at_bound=tuple(key for key, bound in zip(goal.model.free, held, strict=True) if bound),
            weight=goal.weight(state),
            outliers=tuple(np.flatnonzero(state.distance > OUTLIER_DISTANCE * robust_scale(state.distance)).tolist()),
            steps=steps,
        )


def _solve_damped(A: Array, diagonal: Array, damping: float, gradient: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(A + np.diag(damping * np.maximum(diagonal, 1e-300)), gradient))
    except np.linalg.LinAlgError:
        return gradient / np.maximum(diagonal, 1e-300) / (1.0 + damping)
