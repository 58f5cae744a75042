"""Levenberg–Marquardt iteration (Marquardt 1963); noise and penalties are estimated from the residual on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.least_squares.convergence import (
    PENALISED_TOLERANCE,
    POSTERIOR_TOLERANCE,
    FitNotConverged,
    is_idle,
    is_last,
    is_well_determined,
    largest_change,
)
from lrm_ident.fitting.least_squares.objective import (
    PENALTY_TOLERANCE,
    SCALE_TOLERANCE,
    Iterate,
    NoiseScale,
    NoiseUpdate,
    Objective,
)
from lrm_ident.fitting.least_squares.quadratic_model import QuadraticModel
from lrm_ident.fitting.least_squares.smoothness import MOST_UPDATES, Smoothness
from lrm_ident.fitting.parameter_sets import Bounds
from lrm_ident.fitting.priors import Prior
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import Equilibrium

FIRST_DAMPING = 1e-6


@dataclass(frozen=True, eq=False)
class Optimum:
    """Optimum at which an iteration ended.

    Attributes:
        columns: compressed Jacobian before the last step, which changed nothing.
        free: (P,), whether no bound holds a parameter.
        stated: the stated prior, as it was reweighted.
    """

    objective: Objective
    iterate: Iterate
    columns: Array
    free: NDArray[np.bool_]
    noise: NoiseScale
    steps: int
    stated: Prior | None = None


@dataclass(frozen=True, eq=False)
class LevenbergMarquardt:
    """Least-squares problem, and when to stop.

    Attributes:
        bounds: of the scaled parameters.
        idle_steps: number of successive steps that gain next to nothing after which it ends.
        near: an equilibrium of the same effects to start from, or None.
    """

    objective: Objective
    smooth: Smoothness
    bounds: Bounds
    idle_steps: int
    near: Equilibrium | None

    @property
    def sigma_tolerance(self) -> float:
        """Relative tolerance of σ; larger with penalties, whose weights are known to a third only."""
        return PENALTY_TOLERANCE if self.smooth.penalties else SCALE_TOLERANCE

    def with_smoothness(self, smooth: Smoothness) -> LevenbergMarquardt:
        """The problem with other penalties, or a prior reweighted."""
        return replace(self, smooth=smooth, objective=replace(self.objective, prior=smooth.prior))

    def solve(self, most_steps: int) -> Optimum:
        """Iterates until no decrease is predicted, and noise and penalties agree with the residual.

        These are estimated anew whenever the parameters have converged for the present ones (MacKay 1992; Wood &
        Fasiolo 2017). Raises `FitNotConverged`.
        """
        iterate, problem = self._start(), self
        noise, free = self.objective.noise_scale(iterate), np.ones(len(iterate.z), dtype=np.bool_)
        if not len(free):
            return Optimum(self.objective, iterate, np.empty((0, 0)), free, noise, 0, self.smooth.stated)
        if self.smooth.warm_started:
            first, smooth = self._reestimated(iterate, self.objective.linearise(iterate, noise).columns, free, noise)
            noise, problem = first.estimated, self.with_smoothness(smooth)
        before: NoiseUpdate | None = None
        estimated_at: Iterate | None = None
        damping, change, idle = FIRST_DAMPING, np.inf, 0
        tolerance = PENALISED_TOLERANCE if self.smooth.penalties else POSTERIOR_TOLERANCE
        for steps in range(1, most_steps + 1):
            quadratic = QuadraticModel.about(iterate, problem.objective, noise, self.bounds)
            iterate, damping = quadratic.step(damping)
            change = largest_change(quadratic.iterate, iterate)
            idle = idle + 1 if is_idle(quadratic, iterate) else 0
            if idle >= self.idle_steps and not is_well_determined(quadratic):
                raise FitNotConverged(steps, change)
            if idle < self.idle_steps and not is_last(quadratic, iterate, tolerance):
                continue
            columns, off = quadratic.rows.columns, quadratic.free_at(iterate)
            update, smooth = problem._reestimated(iterate, columns, off, noise)
            if update.estimated.close_to(noise, problem.sigma_tolerance) and smooth.close_to(problem.smooth):
                return Optimum(problem.objective, iterate, columns, off, noise, steps, problem.smooth.stated)
            problem, noise, before = problem.with_smoothness(smooth), update.accelerated(before), update
            if smooth.adapts and iterate is not estimated_at:  # where no step gains, a predicted gain is none
                problem, noise = problem._performance_iteration(iterate, noise)
            damping, estimated_at = min(damping, FIRST_DAMPING), iterate
        raise FitNotConverged(most_steps, change)

    def _start(self) -> Iterate:
        """The iterate at the model's values, put within the bounds."""
        z = self.objective.model.values[self.objective.columns] / self.objective.typical
        return self.objective.at(np.clip(z, self.bounds.lower, self.bounds.upper), self.near)

    def _reestimated(
        self, iterate: Iterate, columns: Array, free: NDArray[np.bool_], noise: NoiseScale
    ) -> tuple[NoiseUpdate, Smoothness]:
        """Noise and penalties estimated anew at the optimum for `noise` and the present penalties.

        `columns`: the compressed Jacobian there, or before a step that changed nothing.
        """
        parameters, covariance = self._posterior(columns, free, noise)
        update = NoiseUpdate(noise, self.objective.noise_scale(iterate, parameters))
        return update, self.smooth.updated(iterate.equilibrium.model.with_free(self.objective.model.free), covariance)

    def _performance_iteration(self, iterate: Iterate, noise: NoiseScale) -> tuple[LevenbergMarquardt, NoiseScale]:
        """Performance iteration (Gu 1992): penalties and noise estimated in turn on the quadratic model about an
        iterate until they settle, without further evaluations of the arm."""
        problem, objective = self, self.objective
        for _ in range(MOST_UPDATES):
            quadratic = QuadraticModel.about(iterate, problem.objective, noise, self.bounds)
            z = quadratic.minimum
            parameters, covariance = problem._posterior(quadratic.rows.columns, quadratic.free, noise)
            before, noise = noise, objective.noise_scale(iterate, parameters, quadratic.predicted_squares(z))
            model = objective.model.with_values_of(objective.model.free, z * objective.typical)
            smooth = replace(problem.smooth.updated(model, covariance), updates=self.smooth.updates)
            settled = smooth.close_to(problem.smooth) and noise.close_to(before, self.sigma_tolerance)
            problem = self.with_smoothness(smooth)
            if settled:
                break
        return problem, noise

    def _posterior(self, columns: Array, free: NDArray[np.bool_], noise: NoiseScale) -> tuple[float, Array]:
        """Effective number of parameters that the data determine, and posterior covariance (P, P) of all (SI)."""
        objective, covariance = self.objective, np.zeros((len(free), len(free)))
        if objective.prior is None or not free.any():
            return 0.0, covariance
        inverse = objective.inverse_hessian(columns, noise, free)
        covariance[np.ix_(free, free)] = noise.sigma**2 * inverse
        scaled = covariance * np.outer(objective.typical, objective.typical)
        return objective.effective_parameters(inverse, noise, free), scaled
