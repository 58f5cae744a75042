"""A candidate beside the data: added-variable plot, and component-plus-residual plot of its form.

Added-variable plot (Cook & Weisberg 1982): what the fit leaves against what the candidate would add beyond the fitted
parameters. Component plus residual (Ezekiel 1924; Larsen & McCleary 1972): what the candidate alone would do as a
turn of one joint, against its own driver, and the residual around it. A form of two drivers has a map instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import RankedCandidate
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.report.text.claims import DISPLAY_UNITS, turned, with_unit
from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.covariates import Covariate
from lrm_ident.residual.gravity_loads import usual_turns
from lrm_ident.residual.picture.drivers import drawn_over
from lrm_ident.residual.picture.error_field import joint_turns
from lrm_ident.residual.picture.group_means import explained_by_means, joints_of, of_law, shown_most
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import Equilibrium

UM, ANGLE = 3, 4
"""Decimals of millimetres and degrees in the drawing only."""
SHARE = 0.2
"""Part of a joint's lever below which its turn cannot be observed at a pose, as a share of the RMS lever."""


def rounded(values: Array, decimals: int) -> Any:
    """Nested lists without NaN, which become null."""
    plain = np.round(values, decimals).astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def candidate_view(
    ranked: RankedCandidate, diagnosis: Diagnosis, covariates_known: Sequence[Covariate], rows: NDArray[np.int64]
) -> dict[str, Any]:
    """Values that the page draws of a candidate, in mm and degrees, at the drawn poses; null where it was not screened.

    `added`: motion of the TCP that it would add beyond the fitted parameters; `turns`: the same as a turn of each
    joint; `shown`: the joint, from 0, and the covariate whose chart shows most of that. `joint`: the one whose turn
    its motion is most like; `driver`, `second`: what its form is a function of. `form`: the turn of that joint that
    the candidate says; `around`: with what would then be left; both null where the joint's lever is too short to
    observe a turn. `size`: of an effect with one parameter, that of `added`.

    Args:
        known: covariates of the poses that were screened. rows: (M,), number of every drawn pose among them, or −1.
    """
    scored, effect = ranked.scored, ranked.effect
    fitted, data = diagnosis.screening.subset
    weigh = RowWeights(data.whitening, fitted.weight)
    columns = scored.candidate.columns(scored.shape)
    alone = (columns @ best_estimate(ranked)).reshape(len(data), -1)[:, :3]
    added = weigh.positions(scored.added)
    turns = joint_turns(alone, diagnosis.joint_jacobian)
    lever = (diagnosis.joint_jacobian**2).sum(axis=1)
    joints = joints_of(effect.place, len(lever))
    joint = max(joints, key=lambda number: float((turns[number] ** 2 * lever[number]).sum()))
    beyond = joint_turns(added, diagnosis.joint_jacobian)
    lawful = of_law(effect, covariates_known)
    explained = [explained_by_means(beyond, lever, covariate.values) for covariate in lawful]
    around = turns[joint] + joint_turns(fitted.residual - added, diagnosis.joint_jacobian)[joint]
    observable = lever[joint] > SHARE**2 * lever[joint].mean()
    drawn = rows[rows >= 0]  # thousands of poses say no more of what a form follows
    followed = [covariate.take(drawn) for covariate in lawful]
    drivers = drawn_over(effect, turns[joint][drawn], followed, joint, observable[drawn])
    seen = observable[rows] & (rows >= 0)
    joint_shown, driver_shown = shown_most(explained, lawful, joints)
    parameters = {parameter.name: parameter for parameter in effect.parameters}
    return {
        "name": scored.name,
        "added": rounded(_drawn(added, rows) * 1e3, UM),
        "turns": rounded(np.degrees(_drawn(beyond.T, rows).T), ANGLE),
        "shown": {"joint": joint_shown, "driver": variable_name(driver_shown) if driver_shown else ""},
        "joint": joint,
        "driver": variable_name(drivers[0].variable),
        "second": variable_name(drivers[1].variable) if len(drivers) > 1 else "",
        "form": rounded(np.where(seen, np.degrees(_drawn(turns[joint], rows)), np.nan), ANGLE),
        "around": rounded(np.where(seen, np.degrees(_drawn(around, rows)), np.nan), ANGLE),
        "about": {name: getattr(effect.about, name) for name in ("cause", "formula", "needs", "source")},
        "size": _size(scored, fitted.equilibrium),
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


def _size(scored: ScoredCandidate, rest: Equilibrium) -> dict[str, object] | None:
    """Size of an effect that has one, in the unit that is shown; of a compliance the turn under the usual load."""
    if scored.size != 1:
        return None
    [parameter], [theta] = scored.candidate.parameters, scored.alone.theta
    value, turn = float(theta * parameter.typical / parameter.si), usual_turns(scored.candidate.effect, rest)
    unit = "rad" if turn else parameter.unit
    scale, symbol = DISPLAY_UNITS.get(unit, (1.0, f" {unit}"))
    sign = scored.candidate.effect.about.sized(parameter.name, "-" if value < 0 else "")
    words = f"{symbol}{sign}{turned(bool(turn))}"
    return {"value": abs(value) * turn.get(parameter.name, 1.0) * scale, "unit": words}


def _drawn(values: Array, rows: NDArray[np.int64]) -> Array:
    """Values of the drawn poses, NaN where there is none."""
    shape = (len(rows),) + (1,) * (values.ndim - 1)
    return np.where((rows >= 0).reshape(shape), values[rows], np.nan)
