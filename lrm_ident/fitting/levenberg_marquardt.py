"""Least squares of a model's free parameters: Levenberg–Marquardt (Marquardt 1963) on scaled parameters, with bounds.

With a prior: maximum a posteriori (Conenna 2024, Eq 2.66; Tenhumberg & Bäuml 2021). The noise that weighs data against
prior is estimated from the residual, with MacKay's (1992) effective number of parameters. Where least squares alone
does not converge, it is damped by weak priors (ridge regression, Hoerl & Kennard 1970), and the result says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.data.registration.degenerate_fit import check_arm
from lrm_ident.fitting.loss import SQUARED, Loss, robust_scale
from lrm_ident.fitting.objective import Iterate, NoiseScale, NoiseUpdate, Objective
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of
from lrm_ident.fitting.priors import WEAK, WEAK_SD, Prior, weak_prior
from lrm_ident.fitting.smoothness import Smoothness
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.model.deployed_model import field_of
from lrm_math.model.equilibrium import Equilibrium, equilibrium, measured_range
from lrm_math.model.model import Model

MAX_STEPS = 60
MAX_STEPS_WITH_PRIOR = 300  # where a prior alone says anything, steps are short, but each one gains
FIRST_DAMPING = 1e-6
MUCH_SHORTER = 0.75  # part of a step
STEP_TOLERANCE = 1e-8  # of the typical sizes
GAIN_TOLERANCE = 1e-10  # predicted relative decrease of the objective
IDLE_STEPS, IDLE_GAIN, IDLE_LIKELIHOOD = 5, 1e-5, 0.3
"""So many steps in a row that each gain no more end a fit: part of the objective, and of it over the squared noise."""
POSTERIOR_TOLERANCE = 1e-6  # predicted increase of the log-posterior: parameters to a thousandth of their errors
PENALISED_TOLERANCE = 1e-3  # the same where penalties of forms, known to a third, decide it: to a part of their errors
OUTLIER_DISTANCE = 5.0  # robust standard deviations per axis; a clean pose is beyond it once in 60 000


class FitNotConverged(LrmError):
    """The fit did not converge; carries the number of `steps` and the last `step` in typical sizes."""

    def __init__(self, steps: int, step: float) -> None:
        self.steps, self.step = steps, step
        super().__init__(
            f"the fit did not converge in {steps} steps (last step {step:.2g} of the typical sizes); "
            "hold some parameters, start from a fitted model, or try a narrower prior (--prior)"
        )


@dataclass(frozen=True, eq=False)
class Fit(ShownInNotebook):
    """A fitted model.

    Attributes:
        rest: the model's equilibrium at the data's poses.
        residual: (N, 3), measured − predicted TCP (m), along the distance where only that was measured.
        covariance: (P, P) of the free parameters (SI); zero rows for those at a bound. With a prior: of the posterior.
        effective_parameters: those not at a bound, less the part that a prior determines.
        sigma: standard deviation of the residual per axis (m), corrected for the degrees of freedom.
        at_bound: keys of parameters with an active bound.
        weight: (N,), the weight of each pose, 1 for least squares.
        outliers: rows farther than `OUTLIER_DISTANCE` robust standard deviations.
        steps: Levenberg–Marquardt steps taken.
        prior: what weighed against the data: a stated or weak prior, and the penalties of forms.
        loss: what it minimises. damped: whether it converged only with weak priors (`weak_prior`).
    """

    model: Model
    rest: Equilibrium
    residual: Array
    covariance: Array
    effective_parameters: float
    sigma: float
    at_bound: tuple[str, ...]
    weight: Array
    outliers: tuple[int, ...]
    steps: int
    loss: Loss = SQUARED
    damped: bool = False
    prior: Prior | None = None

    def take(self, rows: NDArray[np.int64]) -> Fit:
        """This fit, seen at some of its poses."""
        outliers = tuple(np.flatnonzero(np.isin(rows, self.outliers)).tolist())
        rest, residual, weight = self.rest.take(rows), self.residual[rows], self.weight[rows]
        return replace(self, rest=rest, residual=residual, weight=weight, outliers=outliers)

    @property
    def weak_prior(self) -> Prior | None:
        """The prior that damped it, if one did: fits to a part of the data need it too."""
        return weak_prior(self.model) if self.damped else None

    @property
    def standard_error(self) -> Array:
        """(P,), of the free parameters (SI)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """(P, P), of the free parameters; zero where a bound is active."""
        error = self.standard_error
        scale = np.where(error > 0, error, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))


def fit(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss = SQUARED,
    prior: Prior | None = None,
    near: Equilibrium | None = None,
) -> Fit:
    """Fits the model's free parameters, starting from their current values.

    Args:
        bounds: of the free parameters; None: those that the effects state.
        prior: of every free parameter; with one, a third of the poses suffices. None: none, unless the fit does not
            converge without one; then weak ones (`Fit.damped`).
        near: a known equilibrium at the data's poses (to `EQUILIBRIUM_TOLERANCE`) of the same effects.

    Raises:
        LrmError: fewer poses than free parameters (with a prior: than a third), no convergence (`FitNotConverged`), or
            an arm that shrinks, stretches or loses a length (`DegenerateFit`).
        NoEquilibrium: the start has no elastic equilibrium.
    """
    check_enough(len(data), len(model.free), prior)
    if field_of(model) is not None:
        raise LrmError("a residual field is fitted last, on what the causes leave; take it out first (undo)")
    start = equilibrium(model, data.poses, near)
    model = replace(model, within=measured_range(start))
    limits = bounds or bounds_of(model, model.free)
    smooth = Smoothness.of(model, prior)
    objective = Objective(model, data, loss, smooth.prior)
    stated = prior is not None and prior.name != WEAK  # the top of such a posterior is wanted, however flat it is
    idle = MAX_STEPS_WITH_PRIOR if stated else IDLE_STEPS
    lower, upper = limits.lower / objective.typical, limits.upper / objective.typical
    plain = _LevenbergMarquardt(objective, smooth, lower, upper, idle, start)
    try:
        found = plain.solve(MAX_STEPS if smooth.prior is None else MAX_STEPS_WITH_PRIOR)
    except FitNotConverged:
        if prior is not None:
            raise
        found = replace(
            plain.with_smoothness(Smoothness.of(model, weak_prior(model))).solve(MAX_STEPS_WITH_PRIOR), damped=True
        )
    check_arm(found.rest, model.free)
    return found


def check_enough(poses: int, parameters: int, prior: Prior | None = None) -> None:
    """Raises `LrmError` for fewer poses than parameters; with a prior, for fewer coordinates than parameters.

    With fewer, the noise could not be estimated.
    """
    least = parameters if prior is None else parameters // 3 + 1
    if poses < least:
        raise LrmError(
            f"{poses} poses for {parameters} parameters; measure at least {least} poses, or fit fewer parameters "
            "(fit --parameters)"
        )


@dataclass(frozen=True, eq=False)
class _LevenbergMarquardt:
    objective: Objective
    smooth: Smoothness
    lower: Array
    upper: Array
    idle_steps: int
    near: Equilibrium | None

    def with_smoothness(self, smooth: Smoothness) -> _LevenbergMarquardt:
        """The same with these penalties."""
        return replace(self, smooth=smooth, objective=replace(self.objective, prior=smooth.prior))

    def solve(self, most_steps: int) -> Fit:
        """Iterates until no decrease is predicted and the noise and the penalties follow from what is left.

        Both are estimated whenever the parameters have converged for the present ones (MacKay 1992; Wood & Fasiolo
        2017). Raises `FitNotConverged`.
        """
        objective, model = self.objective, self.objective.model
        z = model.values[objective.columns] / objective.typical
        iterate = objective.at(np.clip(z, self.lower, self.upper), self.near)
        held = np.zeros(len(model.free), dtype=np.bool_)
        noise, solver = objective.noise_scale(iterate), self
        before: NoiseUpdate | None = None
        damping, step, idle, columns = FIRST_DAMPING, np.inf, 0, np.empty((0, len(z)))
        tolerance = PENALISED_TOLERANCE if self.smooth.known else POSTERIOR_TOLERANCE
        if not model.free:
            return self._result(iterate, columns, held, 0, noise)
        if self.smooth.begun:
            first, smooth = self._likelier(iterate, ~held, noise)
            noise, solver = first.estimated, self.with_smoothness(smooth)
        for steps in range(1, most_steps + 1):
            objective = solver.objective
            rows = objective.linearise(iterate, noise)
            columns, descent = rows.columns, objective.negative_gradient(iterate, rows, noise)
            held = ((iterate.z <= self.lower) & (descent < 0)) | ((iterate.z >= self.upper) & (descent > 0))
            trial, damping = solver._step(iterate, columns, descent, ~held, noise, damping)
            step = float(np.abs(trial.z - iterate.z).max())
            predicted = float(descent @ (trial.z - iterate.z)) / noise.scale**2
            least = max(GAIN_TOLERANCE * objective.value(iterate, noise), tolerance * noise.prior_weight)
            idle = idle + 1 if solver._gains_nothing(iterate, trial, noise) else 0
            if idle >= self.idle_steps and not solver._well_known(columns, ~held, iterate, noise):
                raise FitNotConverged(steps, step)
            done = step < STEP_TOLERANCE or predicted < least or idle >= self.idle_steps
            iterate = trial
            if not done:
                continue
            update, smooth = solver._likelier(iterate, ~held, noise)
            if update.estimated.close_to(noise, objective.sigma_tolerance) and smooth.close_to(solver.smooth):
                return solver._result(iterate, columns, held, steps, noise)
            solver, noise, before = solver.with_smoothness(smooth), update.accelerated(before), update
            damping = min(damping, FIRST_DAMPING)
        raise FitNotConverged(most_steps, step)

    def _likelier(self, iterate: Iterate, free: NDArray[np.bool_], noise: NoiseScale) -> tuple[NoiseUpdate, Smoothness]:
        """The noise and the penalties that follow from an iterate, which `noise` and the present ones led to."""
        objective, parameters = self.objective, 0.0
        covariance = np.zeros((len(free), len(free)))
        if objective.prior is not None and free.any():
            inverse = objective.inverse_hessian(objective.linearise(iterate, noise).columns, noise, free)
            parameters = objective.effective_parameters(inverse, noise, free)
            covariance[np.ix_(free, free)] = noise.sigma**2 * inverse
        update = NoiseUpdate(noise, objective.noise_scale(iterate, parameters))
        model = iterate.rest.model.with_free(objective.model.free)
        return update, self.smooth.likelier(model, covariance * np.outer(objective.typical, objective.typical))

    def _gains_nothing(self, iterate: Iterate, trial: Iterate, noise: NoiseScale) -> bool:
        """Whether a step lowered the objective by a negligible part, and the log-likelihood by next to nothing."""
        before, after = (self.objective.value(each, noise) for each in (iterate, trial))
        return before - after <= min(IDLE_GAIN, IDLE_LIKELIHOOD / iterate.residual.size) * before

    def _well_known(self, J: Array, free: NDArray[np.bool_], iterate: Iterate, noise: NoiseScale) -> bool:
        """Whether the data, or a prior, know every direction better than the weak priors do."""
        if self.objective.has_full_prior or not free.any():
            return True
        least = float(np.linalg.eigvalsh(self.objective.gauss_newton(J, noise)[np.ix_(free, free)])[0])
        return least * WEAK_SD**2 > self.objective.residual_sd(iterate) ** 2

    def _step(
        self, iterate: Iterate, J: Array, descent: Array, free: NDArray[np.bool_], noise: NoiseScale, damping: float
    ) -> tuple[Iterate, float]:
        """An iterate that does not increase the objective, and the next damping; the same iterate if there is none."""
        objective = self.objective
        A = objective.gauss_newton(J, noise)
        diagonal = np.diag(np.maximum(np.diag(A), 1e-300))
        before = objective.value(iterate, noise)
        while damping < 1e12:
            z = self._bounded_minimum(iterate.z, A + damping * diagonal, descent, free)
            try:
                trial = objective.at(z, iterate.rest)
            except NoEquilibrium:
                damping *= 10.0
                continue
            if objective.value(trial, noise) <= before:
                return self._shortened(iterate, trial, descent, noise), damping * 0.1
            if np.abs(z - iterate.z).max() < STEP_TOLERANCE:
                break
            damping *= 10.0
        return iterate, damping

    def _shortened(self, iterate: Iterate, trial: Iterate, descent: Array, noise: NoiseScale) -> Iterate:
        """The trial, or the iterate at the minimum of a parabola through both where that is well before it and lower
        (Nocedal & Wright 2006, section 3.5): Gauss and Newton leave a curvature out, and may step twice too far."""
        objective, change = self.objective, trial.z - iterate.z
        slope = float(descent @ change) / noise.scale**2
        gain = objective.value(iterate, noise) - objective.value(trial, noise)
        if not 0.0 < 0.5 * slope < MUCH_SHORTER * (slope - gain):
            return trial
        try:
            shorter = objective.at(iterate.z + 0.5 * slope / (slope - gain) * change, iterate.rest)
        except NoEquilibrium:
            return trial
        return min(trial, shorter, key=lambda one: objective.value(one, noise))

    def _bounded_minimum(self, z: Array, A: Array, descent: Array, free: NDArray[np.bool_]) -> Array:
        """Minimum of the quadratic model within the bounds: what would leave them is put on them, and the others are
        solved anew (active set; clipping alone zigzags where parameters are correlated, Bertsekas 1982)."""
        moving, change = free.copy(), np.zeros_like(z)
        while moving.any():
            change[moving] = _solve(
                A[np.ix_(moving, moving)], descent[moving] - A[np.ix_(moving, ~moving)] @ change[~moving]
            )
            inside = np.clip(z + change, self.lower, self.upper)
            beyond = moving & (inside != z + change)
            if not beyond.any():
                break
            change[beyond] = (inside - z)[beyond]
            moving &= ~beyond
        return np.clip(z + change, self.lower, self.upper)

    def _result(self, iterate: Iterate, columns: Array, held: NDArray[np.bool_], steps: int, noise: NoiseScale) -> Fit:
        """The fit at the last iterate; `columns`: compressed Jacobian before the last step, which changed nothing."""
        objective, data, free, distance = self.objective, self.objective.data, ~held, iterate.distance
        covariance, model = np.zeros((len(held), len(held))), iterate.rest.model.with_free(objective.model.free)
        parameters, sigma = 0.0, objective.residual_sd(iterate)
        if free.any():
            now = NoiseScale(objective.noise_scale(iterate).scale, noise.sigma)
            inverse = objective.inverse_hessian(columns, now, free)
            parameters = objective.effective_parameters(inverse, now, free)
            sigma = objective.residual_sd(iterate, parameters)
            covariance[np.ix_(free, free)] = (now.sigma or sigma) ** 2 * inverse
        return Fit(
            model=model,
            rest=replace(iterate.rest, model=model),
            residual=data.position_error(iterate.rest),
            covariance=covariance * np.outer(objective.typical, objective.typical),
            effective_parameters=parameters,
            sigma=sigma * data.whitening.unit,
            at_bound=tuple(key for key, bound in zip(objective.model.free, held, strict=True) if bound),
            weight=objective.weight(iterate),
            outliers=tuple(np.flatnonzero(distance > OUTLIER_DISTANCE * robust_scale(distance)).tolist()),
            steps=steps,
            loss=objective.loss,
            prior=objective.prior,
        )


def _solve(A: Array, gradient: Array) -> Array:
    """The Newton step; of a singular matrix that of its diagonal."""
    try:
        return np.asarray(np.linalg.solve(A, gradient))
    except np.linalg.LinAlgError:
        return gradient / np.maximum(np.diag(A), 1e-300)
