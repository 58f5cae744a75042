"""Later poses predicted in order by the deployed model from those before them: forecasts with a growing window.

A cross-validation interpolates in time. What goes on after a session is predicted from what went before it only
(rolling origin: Tashman 2000).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.residual.data_audit import joints_of_order
from lrm_ident.residual.deployment.carried_states import FEWEST, with_carried_states
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.model.deployed_model import as_deployed_with, followed_effects, on_the_way
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.state_after_session import state_of_arm

FIRST_SHARE, WINDOWS = 0.75, 2
"""Share of the poses before the first forecast; number of forecasts, each of as many poses."""
STEP = "last_pose"
"""Name of the parameter that says after which pose an effect changes the arm."""
SAME = 1e-3
"""Part of the mean square by which forecasts of no pose differ where an effect began after the last of them."""


def allows_rolling_origin(data: Measurements) -> bool:
    """Whether the poses have an order that follows no joint, and enough of them to forecast some from others.

    Orders that follow the load are let through, since plans measure load by load, and both models that are compared
    extrapolate to it alike. A forecast that is compared with none (`forecast_error`) asks for loads that it has seen.
    The temperature goes on after the session as time does.
    """
    enough = len(data) * (1.0 - FIRST_SHARE) >= FEWEST
    return enough and data.poses.number is not None and not joints_of_order(data.poses.q)


def changes_too_late(effect: Effect, model: Model, data: Measurements) -> bool:
    """Whether an effect changes the arm with fewer than `FEWEST` poses behind it before the last forecast begins: what
    is after the change is then hardly known to the forecasts."""
    steps = [
        model.value(key)
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
        if parameter.name == STEP
    ]
    number = data.poses.names(np.arange(_edges(data)[-2]))
    return any(np.count_nonzero(np.array(number) > step) < FEWEST for step in steps)


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Squared errors (M,), m², of later poses predicted as deployed by fits to those before.

    `followed`: where the rover knows the time since power-on and what the arm did before. `unknown`: where it does not.
    """

    followed: Array
    unknown: Array

    @property
    def best(self) -> Array:
        """Those of the way that predicts better."""
        return min(self.followed, self.unknown, key=lambda squares: float(squares.mean()))


@lru_cache(maxsize=2)  # a diagnosis compares every candidate of a session with the same fit
def rolling_origin_forecasts(fitted: Fit, data: Measurements) -> Forecasts:
    """Forecasts of the last quarter of the poses. The tracker still errs as it did.

    Raises `LrmError`: a fit does not converge.
    """
    rows, forecasts = np.arange(len(data)), list[tuple[Array, Array]]()
    for begin, end in pairwise(_edges(data)):
        before, later = data.take(rows[:begin]), data.take(rows[begin:end])
        earlier = with_carried_states(fit(fitted.model, before, loss=fitted.loss, prior=fitted.stated), before)
        forecasts.append(forecast_residuals(earlier, later))
    return Forecasts(*((np.concatenate(each) ** 2).sum(axis=1) for each in zip(*forecasts, strict=True)))


def forecast_residuals(earlier: Fit, later: Measurements) -> tuple[Array, Array]:
    """(M, 3), m, residuals of poses that a fit did not see, as deployed: where the time since power-on and the moves
    before are known, and where they are not. The tracker still errs as it did."""
    model = earlier.model.with_state(state_of_arm(earlier.equilibrium))
    trackers = [*on_the_way(model), *(bound.effect.name for bound in model.binding.distorting)]

    def errors(names: Sequence[str]) -> Array:
        return later.position_error(solve_equilibrium(as_deployed_with(model, [*names, *trackers]), later.poses))

    unknown, names = errors(()), followed_effects(model, later.poses)
    return errors(names) if names else unknown, unknown


def _edges(data: Measurements) -> list[int]:
    """Rows at which forecasts begin, and the end of the last one."""
    return [round(row) for row in np.linspace(FIRST_SHARE * len(data), len(data), WINDOWS + 1).tolist()]


def same_forecasts(first: Array, other: Array) -> bool:
    """Whether two forecasts (M,) are the same: what tells the models apart came after all that they were fitted to."""
    return bool(np.abs(first - other).max() <= SAME * first.mean())
