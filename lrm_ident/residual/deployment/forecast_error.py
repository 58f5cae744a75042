"""Whether an arm goes on changing: later poses predicted from those before them, and from poses all around them.

A cross-validation interpolates in time, and what a rover asks for comes later. So the second half of the poses is
predicted as deployed by a fit to the first half (predictive failure: Chow 1960; fixed origin: Tashman 2000), and once
more by fits to every other pose of the whole, which are as many. Each error counts over what its fit expects, since a
law is known less well from its beginning than from all of it. Where the forecast is surely worse, the arm changes in a
way that the model does not state, and the error to expect is that of the forecast. It holds for about as long after the
measurement as half of it lasted; nothing tests what comes after that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import Loss
from lrm_ident.fitting.priors import Prior
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.residual.deployment.carried_states import FEWEST
from lrm_ident.residual.deployment.rolling_origin import STEP, allows_rolling_origin, forecast_residuals
from lrm_ident.residual.thresholds import NOT_NOISE
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import field_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

MOST_POSES = 1000
"""Poses that are fitted, evenly spread: a bound on time."""
SAME_KG = 1e-3
"""kg by which loads differ that are one: as a scale reads."""
SURELY = NormalDist().inv_cdf(1.0 - NOT_NOISE)
"""Standard errors by which a forecast must be worse: the level of the verdict that it contradicts."""


@dataclass(frozen=True)
class ForecastError:
    """Errors of later poses as deployed, predicted from those before them, where these are surely worse than of poses
    predicted from all around; None: they are not.

    `followed`: where the time since power-on and what the arm did before are known. `unknown`: where neither is.
    `poses`: number of the later ones.
    """

    followed: ErrorStats | None = None
    unknown: ErrorStats | None = None
    poses: int = 0


@dataclass(frozen=True, eq=False)
class _Prediction:
    """`forecast_residuals` (M, 3), m, of poses that a fit did not see: where time and moves before are known, and where
    they are not. `spread`: (3 M, P), m, motions of the tip by independent standard errors of the fit."""

    followed: Array
    unknown: Array
    spread: Array
    sigma: float

    @cached_property
    def _principal(self) -> tuple[Array, Array]:
        """(3 M, P) and (P,), motions along the principal directions of the spread, and their squared lengths (m²); by
        eigenvalues, since LAPACK's singular values (gesdd) need not converge for columns that are but round-off."""
        size, axes = np.linalg.eigh(self.spread.T @ self.spread)
        return self.spread @ axes, np.maximum(size, 0.0)

    def squares(self, residual: Array, noise: float) -> Array:
        """(M,), squared errors over their expectation, whitened by the covariance noise² I + spread spreadᵀ.

        One wrong parameter moves many poses: without that, chance would look like a change. Its symmetric root is that
        of the identity with another size along the principal directions of the spread.
        """
        moved, size = self._principal
        error, root = residual.reshape(-1) / noise, np.sqrt(1.0 + size / noise**2)
        # (1 − 1/√(1 + s²)) / s² = 1 / (√(1 + s²) (√(1 + s²) + 1)), where s = 0, too
        white = error - moved @ (moved.T @ error / (noise**2 * root * (root + 1.0)))
        return np.asarray((white.reshape(-1, 3) ** 2).sum(axis=1))


def forecast_error(model: Model, data: Measurements, loss: Loss, prior: Prior | None) -> ForecastError:
    """The error of later poses of a model that was fitted to these data; empty where the arm does not go on changing,
    or the data cannot tell: few poses, an order that is not known or follows a joint, later loads beyond the earlier
    ones, or a residual field, which is learned apart."""
    data = data.take(spaced_rows(len(data), MOST_POSES)) if len(data) > MOST_POSES else data
    data = data.take(np.isfinite(data.tcp).all(axis=1)).borne_by(model)
    begin, rows = _origin(model, data), np.arange(len(data))
    if not model.free or field_of(model) or not allows_rolling_origin(data) or len(data) - begin < FEWEST:
        return ForecastError()
    before, after = np.split(data.poses.payload, [begin])
    if after.max() > before.max(initial=0.0) + SAME_KG or after.min() < before.min(initial=np.inf) - SAME_KG:
        return ForecastError()
    try:
        forecast = _predicted(model, data, rows < begin, loss, prior)
        around = [_predicted(model, data, rows % 2 == half, loss, prior) for half in (0, 1)]
    except LrmError:
        return ForecastError()
    noise = float(np.mean([each.sigma for each in around]))
    later = np.argsort(np.concatenate([rows[1::2], rows[::2]]))[begin:]

    def if_worse(forecasts: Array, others: Sequence[Array]) -> ErrorStats | None:
        among = np.concatenate([each.squares(other, noise) for each, other in zip(around, others, strict=True)])
        z = paired_z(among[later], forecast.squares(forecasts, noise))
        return error_stats(forecasts) if z > SURELY else None

    return ForecastError(
        if_worse(forecast.followed, [each.followed for each in around]),
        if_worse(forecast.unknown, [each.unknown for each in around]),
        len(later),
    )


def _origin(model: Model, data: Measurements) -> int:
    """Row at which the forecast begins: the middle of the poses since the arm last changed at a moment that the model
    has, so that half of them say what it changed to."""
    changed, cycle = 0, data.poses.power_cycle
    number = np.array(data.poses.names(np.arange(len(data))))
    for effect in model.effects:
        steps = [
            model.value(key)
            for key, parameter in zip(effect.keys, effect.parameters, strict=True)
            if parameter.name == STEP
        ]
        changed = max([changed, *(int(np.count_nonzero(number <= step)) for step in steps)])
        if "session" in effect.depends_on and cycle is not None:
            changed = max(changed, int(np.count_nonzero(cycle < cycle.max())))
    return (changed + len(data)) // 2


def _predicted(
    model: Model, data: Measurements, seen: NDArray[np.bool_], loss: Loss, prior: Prior | None
) -> _Prediction:
    """Poses predicted by a fit to those `seen` (N,), with the state that its session effects leave behind."""
    fitted, later = fit(model, data.take(seen), loss=loss, prior=prior), data.take(~seen)
    J = parameter_jacobian(solve_equilibrium(fitted.model, later.poses), fitted.model.free)
    variance, axes = np.linalg.eigh(fitted.covariance)
    spread = J.reshape(-1, J.shape[-1]) @ (axes * np.sqrt(np.maximum(variance, 0.0)))
    return _Prediction(*forecast_residuals(fitted, later), spread, fitted.sigma)
