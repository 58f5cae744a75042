"""Fit of a model's free parameters: least squares by Levenberg–Marquardt (Marquardt 1963), scaled and with bounds.

With a prior: maximum a posteriori (Conenna 2024, Eq 2.66; Tenhumberg & Bäuml 2021). The noise that weighs data against
prior is estimated from the residual, with MacKay's (1992) effective number of parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.data.registration.degenerate_fit import check_arm
from lrm_ident.data.wording import in_mm
from lrm_ident.fitting.least_squares.iteration import LevenbergMarquardt, Optimum
from lrm_ident.fitting.least_squares.objective import NoiseScale, Objective, ObjectiveFromCommand
from lrm_ident.fitting.least_squares.smoothness import Smoothness
from lrm_ident.fitting.loss import SQUARED, Loss, robust_scale
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of, nuisance_shapes
from lrm_ident.fitting.priors import Prior, with_range_priors
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.model.covariance import Covariance, ImplausibleEstimate, implausible_estimates
from lrm_math.model.deployed_model import field_of
from lrm_math.model.equilibrium import Equilibrium, measured_range, solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.state_after_session import state_after_session

MAX_STEPS = 60
MAX_STEPS_WITH_PRIOR = 300  # steps are short along directions that only a prior determines
IDLE_STEPS = 5  # successive steps that gain next to nothing, after which a fit ends
MOST_CONTINUED = 3  # searches that go on at the equilibria from the commands
SAME_EQUILIBRIUM = 1e-6  # m: far above what the iterations leave (1e-9); several equilibria are farther apart
OUTLIER_DISTANCE = 5.0  # robust standard deviations per axis; a clean pose is beyond it once in 60 000


@dataclass(frozen=True, eq=False)
class Fit(ShownInNotebook):
    """A fitted model.

    Attributes:
        equilibrium: the model's equilibrium at the data's poses.
        residual: (N, 3), measured − predicted TCP (m), along the distance where only that was measured.
        covariance: (P, P) of the free parameters (SI); zero rows for those at a bound. With a prior: of the posterior.
        effective_parameters: number of those off their bounds, less the part that a prior determines (MacKay 1992).
        sigma: standard deviation of the residual per axis (m), corrected for the degrees of freedom.
        at_bound: keys of parameters with an active bound.
        weight: (N,), the weight of each pose, 1 for least squares.
        outliers: rows farther than `OUTLIER_DISTANCE` robust standard deviations.
        steps: Levenberg–Marquardt steps taken.
        prior: product of the `stated` prior, if there is one, and the penalties of forms, as it entered the objective.
        loss: what it minimises.
    """

    model: Model
    equilibrium: Equilibrium
    residual: Array
    covariance: Array
    effective_parameters: float
    sigma: float
    at_bound: tuple[str, ...]
    weight: Array
    outliers: tuple[int, ...]
    steps: int
    loss: Loss = SQUARED
    prior: Prior | None = None
    stated: Prior | None = None

    def __repr__(self) -> str:
        parameters, poses, rms = len(self.model.free), len(self.residual), in_mm(error_stats(self.residual).rms)
        return f"<Fit of {self.model.arm.name}: {parameters} parameters, {poses} poses, {rms} mm RMS>"

    def take(self, rows: NDArray[np.int64]) -> Fit:
        """The fit restricted to some rows of its poses; parameters and covariance stay."""
        outliers = tuple(np.flatnonzero(np.isin(rows, self.outliers)).tolist())
        equilibrium, residual, weight = self.equilibrium.take(rows), self.residual[rows], self.weight[rows]
        return replace(self, equilibrium=equilibrium, residual=residual, weight=weight, outliers=outliers)

    @property
    def standard_error(self) -> Array:
        """(P,), standard errors of the free parameters (SI)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> Array:
        """(P,), how much the data told of each free parameter: 1 − posterior variance / prior variance, 0 to 1; NaN
        where it has no prior."""
        out = np.full(len(self.model.free), np.nan)
        if self.stated is not None:
            stated_rows = [row for row, key in enumerate(self.model.free) if key in self.stated.keys]
            prior = self.stated.sd_of([self.model.free[row] for row in stated_rows])
            out[stated_rows] = 1.0 - (self.standard_error[stated_rows] / prior) ** 2
        return out

    @property
    def correlation(self) -> Array:
        """(P, P), correlation of the free parameters; zero where a bound is active."""
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
        prior: of the free parameters; with one, a third of the poses suffices. None: least squares.
        near: a known equilibrium at the data's poses (to `EQUILIBRIUM_TOLERANCE`) of the same effects.

    Raises:
        LrmError: fewer poses than free parameters (with a prior: than a third), no convergence (`FitNotConverged`), or
            an arm that shrinks, stretches or loses a length (`DegenerateFit`).
        NoEquilibrium: the start has no elastic equilibrium.
    """
    check_enough(len(data), len(model.free), prior)
    if field_of(model) is not None:
        raise LrmError("a residual field is fitted last, on what the causes leave; take it out first (undo)")
    data = data.borne_by(model)
    start = solve_equilibrium(model, data.poses, near)
    prior_within = None if prior is None else prior.within
    within = prior_within or replace(measured_range(start), candidates=model.candidates)
    model = replace(model, within=within, fitted_to=data.source.sha256)
    if model.binding.distorting:  # about the centre of these poses, not of those that the start was fitted to
        start = solve_equilibrium(model, data.poses, start)
    limits = bounds or bounds_of(model, model.free)
    smooth = Smoothness.of(model, prior)
    objective = Objective(model, data, loss, smooth.prior)
    scaled = Bounds(limits.lower / objective.typical, limits.upper / objective.typical)
    search = LevenbergMarquardt(objective, smooth, scaled, IDLE_STEPS, start)
    most_steps = MAX_STEPS if smooth.prior is None else MAX_STEPS_WITH_PRIOR
    optimum = search.solve(most_steps)
    if not _is_found_from_command(optimum.iterate.equilibrium):
        optimum = _from_command(search, optimum, most_steps)
    fitted = _fit_of(optimum)
    check_arm(fitted.equilibrium, model.free)
    return fitted


def _from_command(search: LevenbergMarquardt, followed: Optimum, most_steps: int) -> Optimum:
    """An optimum at equilibria that are found from the commands. Raises `LrmError` where no search for it converges.

    The search goes on from the optimum that `followed` others, now at those from the commands, and follows these. Where
    it leaves them again, two searches compute them anew in every step, one from the start and one from that optimum:
    their objective has steps, at which a search can end, so the better of both is taken.
    """
    before, free = search.objective, search.objective.model.free
    latest = followed.iterate.equilibrium.model
    for _ in range(MOST_CONTINUED):
        values = before.model.with_values_of(free, [latest.value(key) for key in free])
        try:
            near = solve_equilibrium(values, before.data.poses)
            optimum = replace(search, objective=replace(before, model=values), near=near).solve(most_steps)
        except LrmError:
            break
        if _is_found_from_command(optimum.iterate.equilibrium):
            return optimum
        latest = optimum.iterate.equilibrium.model
    optima, why = [], LrmError("")
    for model in (followed.iterate.equilibrium.model, before.model):
        values = before.model.with_values_of(free, [model.value(key) for key in free])
        objective = ObjectiveFromCommand(values, before.data, before.loss, before.prior)
        try:
            optima.append(replace(search, objective=objective).solve(most_steps))
        except LrmError as error:
            why = error
    if not optima:
        raise why
    return min(optima, key=lambda optimum: optimum.objective.value(optimum.iterate, optima[0].noise))


def _is_found_from_command(followed: Equilibrium) -> bool:
    """Whether who has the model alone finds these equilibria, or others, where an effect is so steep that a pose has
    several: the steps of a fit, each begun at the equilibrium before it, may follow one that nobody else finds."""
    try:
        from_command = solve_equilibrium(followed.model, followed.poses, tolerance=SAME_EQUILIBRIUM / 10.0)
    except NoEquilibrium:
        return False
    return bool(np.abs(from_command.true_tcp - followed.true_tcp).max(initial=0.0) <= SAME_EQUILIBRIUM)


def implausible_of(fitted: Fit) -> tuple[ImplausibleEstimate, ...]:
    """Estimates of a fit that are not physically plausible, surely beyond the largest size."""
    return implausible_estimates(fitted.model, Covariance(fitted.model.free, fitted.covariance))


def least_poses(parameters: int, prior: Prior | None = None) -> int:
    """Poses that a fit needs: as many as parameters; with a prior, as many coordinates as parameters.

    The noise could not be estimated from fewer; where the prior knows it, one pose is enough.
    """
    if prior is None:
        return parameters
    return 1 if prior.noise is not None else parameters // 3 + 1


def check_enough(poses: int, parameters: int, prior: Prior | None = None) -> None:
    """Raises `LrmError` for fewer than `least_poses`."""
    least = least_poses(parameters, prior)
    if poses < least:
        raise LrmError(
            f"{poses} poses for {parameters} parameters; measure at least {least} poses, or fit fewer parameters "
            "(fit --parameters)"
        )


def _fit_of(optimum: Optimum) -> Fit:
    """The fit at an optimum: parameters, covariance, residual and its statistics.

    What nuisance shapes add to the covariance is in a prior of an earlier fit already.
    """
    objective, iterate, free = optimum.objective, optimum.iterate, optimum.free
    data, distance = objective.data, iterate.distance
    model, prior = objective.model.with_values(iterate.equilibrium.model.values), objective.prior
    covariance, parameters, sigma = np.zeros((len(free), len(free))), 0.0, objective.residual_sd(iterate)
    if free.any():
        noise = NoiseScale(objective.noise_scale(iterate).scale, optimum.noise.sigma)
        inverse = objective.inverse_hessian(optimum.columns, noise, free)
        parameters = objective.effective_parameters(inverse, noise, free)
        sigma = objective.residual_sd(iterate, parameters)
        noise = replace(noise, sigma=noise.sigma or sigma)
        if (prior is None or prior.noise is None) and (shapes := nuisance_shapes(model)):
            inverse = _marginal_inverse(optimum, shapes, noise)
        covariance[np.ix_(free, free)] = noise.sigma**2 * inverse
    model = model.with_state(state_after_session(replace(iterate.equilibrium, model=model)))
    far = OUTLIER_DISTANCE * robust_scale(distance, data.whitening.measured)
    return Fit(
        model=model,
        equilibrium=replace(iterate.equilibrium, model=model),
        residual=data.position_error(iterate.equilibrium),
        covariance=covariance * np.outer(objective.typical, objective.typical),
        effective_parameters=parameters,
        sigma=sigma * data.whitening.unit,
        at_bound=tuple(key for key, off in zip(objective.model.free, free, strict=True) if not off),
        weight=objective.weight(iterate),
        outliers=tuple(np.flatnonzero(distance > far).tolist()),
        steps=optimum.steps,
        loss=objective.loss,
        prior=objective.prior,
        stated=optimum.stated,
    )


def _marginal_inverse(optimum: Optimum, shapes: tuple[str, ...], noise: NoiseScale) -> Array:
    """(p, p), inverse Hessian of the p parameters off their bounds (scaled), the nuisance `shapes` marginalised by
    Laplace's approximation with the ranges in which they are searched as prior."""
    objective, free = optimum.objective, optimum.free
    model, prior = objective.model, with_range_priors(objective.prior, objective.model, shapes)
    wide = replace(objective, model=model.with_free((*model.free, *shapes)), prior=prior)
    columns = wide.linearise(replace(optimum.iterate, linearised={}), noise).columns
    inverse = wide.inverse_hessian(columns, noise, np.append(free, np.ones(len(shapes), dtype=np.bool_)))
    return inverse[: free.sum(), : free.sum()]
