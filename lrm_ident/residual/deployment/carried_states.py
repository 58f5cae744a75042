"""State of a session that is carried forward: chosen by predicting the last poses from those before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.residual.data_audit import joints_of_order
from lrm_ident.residual.thresholds import Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import as_deployed_when_read, warming_at
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.session_state import CarriedState
from lrm_math.model.state_after_session import passing_effects, state_after_session

LAST_SHARE = 0.1
"""Share of the poses, the last in order, that are predicted from those before them; at least `FEWEST` poses."""
SETTLED_SHARE = 0.1
"""Share of an effect's range by which it may differ from its end for the last state to hold."""
FEWEST = 10
"""Poses of either part below which nothing is chosen."""


def with_carried_states(fitted: Fit, data: Measurements) -> Fit:
    """The fit, with the state that each session effect carries forward chosen: the mean, or of a law the end.

    The last tenth of the poses in order is predicted, as deployed, by a fit to those before. A law is deployed with its
    end where that predicts better than its mean; what remembers, whose state fades, only where it does so
    significantly. Free curves, poses without an order or whose order follows a joint,
    and few poses are deployed with the mean: an end of the order that is the end of a joint's range tells nothing of
    what follows. The drift of a joint follows the time since power-on, where that is known later: see `_following`.
    """
    model = fitted.model
    laws = [effect.name for effect in passing_effects(model) if not effect.is_free_form]
    if not laws:
        return fitted
    carried: dict[str, CarriedState] = dict.fromkeys(laws, "mean")
    cut = len(data) - max(round(LAST_SHARE * len(data)), FEWEST)
    ordered = data.poses.number is not None and not joints_of_order(data.poses.q)
    if ordered and cut >= FEWEST:
        rows = np.arange(len(data))
        carried |= _predicting_better(fitted, data.take(rows[:cut]), data.take(rows[cut:]), carried)
    warming = _following(model, data.poses) if ordered else ()
    with_states = model.with_state(state_after_session(fitted.equilibrium, carried, warming))
    return replace(fitted, model=with_states, equilibrium=replace(fitted.equilibrium, model=with_states))


def _following(model: Model, poses: Poses) -> list[str]:
    """The effects that follow the time since power-on later: drifts of joints with times measured since then.

    Each session begins with the power. A numbered order is no time.
    """
    return [effect.name for effect in warming_at(model, poses)]


def _predicting_better(
    fitted: Fit, before: Measurements, after: Measurements, means: Mapping[str, CarriedState]
) -> dict[str, CarriedState]:
    """The state of each effect, its end or its mean, that predicts later measurements better, chosen one by one; none
    where the earlier ones cannot be fitted alone."""
    try:
        earlier = fit(fitted.model, before, loss=fitted.loss, prior=fitted.stated).equilibrium
        chosen, least = dict(means), _squares(earlier, after, means)
        fading = {effect.name for effect in fitted.model.effects if effect.remembers}
        for name in means:
            other: dict[str, CarriedState] = chosen | {name: "last"}
            squares = _squares(earlier, after, other)
            falls = squares.mean() < least.mean()
            if falls and (name not in fading or paired_z(squares, least) > Z_THRESHOLD):
                chosen, least = other, squares
    except LrmError:
        return {}
    return chosen


def _squares(earlier: Equilibrium, after: Measurements, carried: Mapping[str, CarriedState]) -> Array:
    """(n,), squared errors (m²) at later poses of a fit as deployed with these states carried forward."""
    deployed = as_deployed_when_read(earlier.model.with_state(state_after_session(earlier, carried)))
    return np.asarray((after.position_error(solve_equilibrium(deployed, after.poses)) ** 2).sum(axis=1))


def rows_as_deployed(model: Model, poses: Poses) -> NDArray[np.int64]:
    """Rows of measured poses at which the state that is deployed held: all where it is a mean, or there is none.

    A last state held where each of its effects was within a tenth of its range from its end: after a change, in the
    last session, in a warm arm. The other poses were measured with another zero, or a colder arm. What follows the time
    since power-on, or what the arm did before, holds at all times.
    """
    held = np.ones(len(poses), dtype=np.bool_)
    state = model.state
    followed = set() if state is None else {*state.warming, *state.memory}
    carried = (
        {}
        if state is None
        else {name: carried_state for name, carried_state in state.carried.items() if name not in followed}
    )
    for bound in model.binding.bound:
        if carried.get(bound.effect.name) == "last":
            for amount in bound.at(poses, (0.0,) * len(bound.loads)):
                course = np.broadcast_to(np.asarray(amount, dtype=np.float64), len(poses))
                held &= np.abs(course - course[-1]) <= SETTLED_SHARE * np.ptp(course)
    return np.flatnonzero(held)
