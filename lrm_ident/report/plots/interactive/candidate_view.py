"""A candidate beside the data: added-variable plot, and component-plus-residual plot of its form.

Added-variable plot (Cook & Weisberg 1982): what the fit leaves against what the candidate would add beyond the fitted
parameters. Component plus residual (Ezekiel 1924; Larsen & McCleary 1972): what the candidate alone would do as a
turn of one joint, against its own driver, and the residual around it. A form of two drivers has a map instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import RankedCandidate
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.report.plots.interactive.group_means import explained_by_means, joints_of, of_law, shown_most
from lrm_ident.report.text.claims import DISPLAY_UNITS, with_unit
from lrm_ident.report.text.reasons import reason_words
from lrm_ident.report.text.variables import function_name, variable_name
from lrm_ident.residual.covariates import Covariate, scaled
from lrm_ident.residual.picture.error_field import joint_turns
from lrm_math.arm.place_names import joint_numbers
from lrm_math.arrays import Array
from lrm_math.effects import Effect

UM, ANGLE = 3, 4
"""Decimals of millimetres and degrees in the drawing only."""
SHARE = 0.2
"""Part of a joint's lever below which its turn cannot be observed at a pose, as a share of the RMS lever."""
NO_FUNCTION, MUCH_BETTER = 0.1, 0.5
"""Von Neumann's ratio above which a form is no function of its driver; what a second one must at least reduce it to."""


def rounded(values: Array, decimals: int) -> Any:
    """Nested lists without NaN, which become null."""
    plain = np.round(values, decimals).astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def candidate_view(
    ranked: RankedCandidate, found: Diagnosis, known: Sequence[Covariate], rows: NDArray[np.int64]
) -> dict[str, Any]:
    """Values that the page draws of a candidate, in mm and degrees, at the drawn poses; null where it was not screened.

    `added`: motion of the TCP that it would add beyond the fitted parameters; `turns`: the same as a turn of each
    joint; `shown`: the joint, from 0, and the covariate whose chart shows most of that. `joint`: the one whose turn
    its motion is most like; `driver`, `second`: what its form is a function of. `form`: the turn of that joint that
    the candidate says; `around`: with what would then be left; both null where the joint's lever is too short to
    observe a turn. `refused`: against physics, or the function that explains more, else "". `size`: of an effect
    with one parameter, that of `added`.

    Args:
        known: covariates of the poses that were screened. rows: (M,), number of every drawn pose among them, or −1.
    """
    scored = ranked.scored
    fitted, data = found.screening.subset
    weigh = RowWeights(data.whitening, fitted.weight)
    columns = scored.candidate.columns(scored.shape)
    alone = (columns @ best_estimate(ranked)).reshape(len(data), -1)[:, :3]
    added = weigh.positions(scored.added)
    turns = joint_turns(alone, found.joint_jacobian)
    lever = (found.joint_jacobian**2).sum(axis=1)
    joints = joints_of(scored.candidate.effect.place, len(lever))
    joint = max(joints, key=lambda one: float((turns[one] ** 2 * lever[one]).sum()))
    beyond = joint_turns(added, found.joint_jacobian)
    lawful = of_law(scored.candidate.effect, known)
    explained = [explained_by_means(beyond, lever, one.values) for one in lawful]
    around = turns[joint] + joint_turns(fitted.residual - added, found.joint_jacobian)[joint]
    observable = lever[joint] > SHARE**2 * lever[joint].mean()
    drawn = rows[rows >= 0]  # thousands of poses say no more of what a form follows
    followed = [one.take(drawn) for one in of_law(scored.candidate.effect, known)]
    drivers = _drivers(scored.candidate.effect, turns[joint][drawn], followed, joint, observable[drawn])
    seen = observable[rows] & (rows >= 0)
    joint_shown, driver_shown = shown_most(explained, lawful, joints)
    parameters = {one.name: one for one in scored.candidate.effect.parameters}
    about, function = scored.candidate.effect.about, found.unexplained.spurious.get(scored.name)
    resembles = "" if function is None else function_name(function)
    refused = reason_words(scored.implausible) if scored.implausible else resembles
    return {
        "name": scored.name,
        "added": rounded(_drawn(added, rows) * 1e3, UM),
        "turns": rounded(np.degrees(_drawn(beyond.T, rows).T), ANGLE),
        "shown": {"joint": joint_shown, "driver": driver_shown},
        "joint": joint,
        "driver": variable_name(drivers[0].variable),
        "second": variable_name(drivers[1].variable) if len(drivers) > 1 else "",
        "refused": refused,
        "form": rounded(np.where(seen, np.degrees(_drawn(turns[joint], rows)), np.nan), ANGLE),
        "around": rounded(np.where(seen, np.degrees(_drawn(around, rows)), np.nan), ANGLE),
        "about": {name: getattr(about, name) for name in ("cause", "formula", "needs", "source")},
        "size": _size(scored),
        "estimates": [
            f"{parameters[name].symbol} = {with_unit(value, error, parameters[name].unit)}"
            for name, value, error in ranked.estimates
        ],
    }


def refitted_keys(ranked: RankedCandidate) -> list[str]:
    """Keys of a candidate's parameters, where they were refitted together with everything else; else none."""
    candidate, fit = ranked.scored.candidate, ranked.fit
    keys = [candidate.effect.keys[row] for row in candidate.rows]
    return keys if fit is not None and set(keys) <= set(fit.model.free) else []


def best_estimate(ranked: RankedCandidate) -> Array:
    """(m,), a candidate's parameters in typical sizes: of the refit with it, where there is one, else of it alone."""
    keys = refitted_keys(ranked)
    if ranked.fit is None or not keys:
        return ranked.scored.alone.theta
    typical = [parameter.typical for parameter in ranked.scored.candidate.parameters]
    return np.array([ranked.fit.model.value(key) for key in keys]) / typical


def _drivers(
    effect: Effect, form: Array, known: Sequence[Covariate], joint: int, observable: NDArray[np.bool_]
) -> tuple[Covariate, ...]:
    """Drivers that a form is drawn over: of an effect of two angles the one that it follows, or both; else any."""
    joints = joint_numbers(effect.place) if "angle" in effect.depends_on else ()
    angles = {one.joint: one for one in known if one.kind == "angle"}
    own = tuple(angles[joint] for joint in joints if joint in angles)  # of an effect that couples two joints: both
    own = own if len(own) == 2 else ()
    single = [one for one in own if von_neumann_ratio(form[observable], scaled(one.values[observable])) <= NO_FUNCTION]
    return tuple(single[:1]) or own or drivers_of(form, known, joint, observable)


def _size(scored: ScoredCandidate) -> dict[str, object] | None:
    """Size of an effect that has one, in the unit that is shown."""
    if scored.size != 1:
        return None
    [parameter], [theta] = scored.candidate.parameters, scored.alone.theta
    scale, symbol = DISPLAY_UNITS.get(parameter.unit, (1.0, f" {parameter.unit}"))
    return {"value": float(theta * parameter.typical / parameter.si) * scale, "unit": symbol}


def _drawn(values: Array, rows: NDArray[np.int64]) -> Array:
    """Values of the drawn poses, NaN where there is none."""
    shape = (len(rows),) + (1,) * (values.ndim - 1)
    return np.where((rows >= 0).reshape(shape), values[rows], np.nan)


def drivers_of(
    form: Array, known: Sequence[Covariate], joint: int, observable: NDArray[np.bool_]
) -> tuple[Covariate, ...]:
    """The driver of which the form is a function most nearly; a second one where it is a function of two only.

    Neighbours in the order of a driver differ least (von Neumann 1941). Quantities of the joint itself come first where
    they do as well.

    Args:
        form: (N,), NaN nowhere that is observable. known: at the same poses; joint: from 0.
    """
    order = sorted(known, key=lambda one: one.joint != joint)
    shown, seen = form[observable], [scaled(one.values[observable]) for one in order]
    ratios = [von_neumann_ratio(shown, values) for values in seen]
    least = min(ratios)
    first = next(i for i, ratio in enumerate(ratios) if ratio <= 1.05 * least + 1e-9)
    if ratios[first] <= NO_FUNCTION or len(shown) < 2:
        return (order[first],)
    pairs = list(combinations(range(len(seen)), 2))
    over = [von_neumann_ratio(shown, seen[i], seen[j]) for i, j in pairs]
    if not pairs or min(over) > MUCH_BETTER * least:
        return (order[first],)
    i, j = pairs[int(np.argmin(over))]
    return order[i], order[j]


def von_neumann_ratio(form: Array, *drivers: Array) -> float:
    """Mean squared difference of nearest neighbours in the drivers, over twice the variance; 0 for a function of these.

    Poses that stand at the same place are neighbours of one another in no order: each of any other.
    """
    from scipy.spatial import cKDTree  # a tenth of a second to load, which most commands do without

    places, at, count = np.unique(drivers[0] + 1j * drivers[-1], return_inverse=True, return_counts=True)
    spread = float(form.var())
    if spread == 0.0 or len(places) < 2:
        return 1.0
    mean = np.bincount(at, form) / count
    within = np.bincount(at, (form - mean[at]) ** 2) / count
    lonely = count == 1
    plane = np.column_stack([places.real, places.imag])
    neighbour = np.asarray(cKDTree(plane).query(plane[lonely], k=2)[1])[:, 1]
    apart = 2.0 * count / np.maximum(count - 1, 1) * within
    apart[lonely] = (mean[lonely] - mean[neighbour]) ** 2 + within[neighbour]
    return float((count @ apart) / (2.0 * len(form) * spread))
