"""Moment of a session whose state stands for what follows: chosen by predicting the last poses from those before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import as_deployed, named_part
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.session_state import Moment
from lrm_math.model.state_after_session import passing_effects, state_after_session, usual_moment

LAST_SHARE = 0.1
"""Share of the poses, the last in order, that are predicted from those before them."""
DEPLOYED_SHARE = 0.2
"""Share of the poses, the last in order, at which a state that is the last one is taken to hold."""
FEWEST = 10
"""Poses of either part below which nothing is chosen."""


def with_chosen_moments(fitted: Fit, data: Measurements) -> Fit:
    """The fit, with the moment of each session effect's state chosen: of each law the end or the mean.

    The last tenth of the poses in order is predicted as deployed by a fit to those before: an effect whose mean
    predicts it better than its end is deployed with its mean. Free curves, poses without an order, and few poses keep
    their `usual_moment`, a curve and poses without an order the mean.
    """
    model = fitted.model
    laws = [effect.name for effect in passing_effects(model) if usual_moment(effect) == "last"]
    if not laws:
        return fitted
    moments: dict[str, Moment] = dict.fromkeys(laws, "mean" if data.poses.number is None else "last")
    first = np.arange(len(data)) < round((1.0 - LAST_SHARE) * len(data))
    if data.poses.number is not None and np.count_nonzero(~first) >= FEWEST:
        moments = _predicting_best(model, data.take(np.flatnonzero(first)), data.take(np.flatnonzero(~first)), moments)
    found = model.with_state(state_after_session(fitted.equilibrium, moments))
    return replace(fitted, model=found, equilibrium=replace(fitted.equilibrium, model=found))


def _predicting_best(
    model: Model, before: Measurements, after: Measurements, usual: dict[str, Moment]
) -> dict[str, Moment]:
    """The moments that predict later measurements best, chosen effect by effect; the usual ones where no fit is had."""
    try:
        earlier = fit(named_part(model), before).equilibrium
    except LrmError:
        return usual
    chosen, least = usual, _error(earlier, after, usual)
    for name in usual:
        other: dict[str, Moment] = chosen | {name: "mean"}
        error = _error(earlier, after, other)
        if error < least:
            chosen, least = other, error
    return chosen


def _error(earlier: Equilibrium, after: Measurements, moments: Mapping[str, Moment]) -> float:
    """RMS (m) at later poses of a fit as deployed with its state of some moments."""
    deployed = as_deployed(earlier.model.with_state(state_after_session(earlier, moments)))
    try:
        return error_stats(after.position_error(solve_equilibrium(deployed, after.poses))).rms
    except LrmError:
        return float("inf")


def rows_as_deployed(model: Model, count: int) -> NDArray[np.int64]:
    """Rows of `count` measured poses at which the state that is deployed held.

    All of them where it is a mean or there is none; of a last state the last fifth: the poses before were measured with
    another zero, or a colder arm.
    """
    ends = model.state is not None and "last" in model.state.moments.values()
    return np.arange(round((1.0 - DEPLOYED_SHARE) * count) if ends else 0, count)
