"""Group means of an error over a covariate: how much a chart of a joint's turn shows; a fair sample of its poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.residual.covariates import Covariate, ExplanatoryVariable, levels
from lrm_ident.residual.gravity_loads import AXES, LOCAL, loaded_slots
from lrm_ident.residual.picture.error_field import MOST_DRAWN, SEED, WORST_DRAWN
from lrm_math.arm.place_names import BY, joint_numbers
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.targets import Kind as Target
from lrm_math.effects.targets import kind_of

GROUPS, DECIMALS = 12, 6
"""Groups of neighbours, as in `binned` of charts/chart.js; decimals (SI) to which values are one level."""
AS_MUCH = 0.95
"""Part of the most that is shown, from which on a quantity of the joint itself is taken instead."""


def explained_by_means(turns: Array, lever: Array, values: Array) -> Array:
    """(n,), squares (m²) of the error that the mean turns of each joint over groups of a covariate explain.

    Between-group sum of squares less what chance would make of it (Ezekiel's correction of R², 1930).

    Args:
        turns: (n, M), rad. lever: (n, M), squared motion of the TCP for a unit turn (m²/rad²). values: (M,).
    """
    unique, group = levels(values, DECIMALS)
    groups, poses = min(len(unique), GROUPS), len(values)
    if len(unique) > GROUPS:
        group = np.argsort(np.argsort(values, kind="stable"), kind="stable") * GROUPS // poses
    weight, moment = (np.stack([np.bincount(group, row) for row in of]) for of in (lever, lever * turns))
    mean = moment.sum(axis=1) ** 2 / np.maximum(weight.sum(axis=1), 1e-30)
    between = (moment**2 / np.maximum(weight, 1e-30)).sum(axis=1) - mean
    within = (lever * turns**2).sum(axis=1) - mean - between
    return np.asarray(between - (groups - 1) * within / max(poses - groups, 1))


def joints_of(place: str, dof: int) -> Sequence[int]:
    """Numbers, from 0, of the joints whose turn may show an effect: those of its place that it turns, or all."""
    return joint_numbers(place.partition(BY)[0]) or range(dof)


def shown_most(
    explained: Sequence[Array], covariates_known: Sequence[Covariate], joints: Sequence[int]
) -> tuple[int, ExplanatoryVariable | None]:
    """The joint and the variable whose chart shows most; None where none is known.

    Args:
        explained: (n,), of every covariate of `covariates_known`. joints: those to choose from.
    """
    most = max((float(squares[joint]) for squares in explained for joint in joints), default=0.0)
    near = [
        (covariates_known[k].joint != joint, -float(squares[joint]), joint, k)
        for k, squares in enumerate(explained)
        for joint in joints
        if squares[joint] >= AS_MUCH * most
    ]
    *_, joint, k = min(near, default=(True, 0.0, joints[0], 0))
    return joint, covariates_known[k].variable if covariates_known else None


FOLLOWED: Mapping[str, tuple[str, ...]] = {
    "angle": ("angle",),
    "direction": ("motion",),
    "counts": ("angle",),
    "time": ("order", "time", "temperature"),
    "session": ("order", "time"),
}
"""Kinds of covariates that stand for what an effect's law depends on."""


def of_law(effect: Effect, covariates_known: Sequence[Covariate]) -> Sequence[Covariate]:
    """The covariates that an effect's law follows, of its own joints where it has any; of a constant all but time.

    Hysteresis follows the last motion, a spring its torque, a base the moments on it, a warming the time, a tracker
    that stretches the tip's position.
    """
    if kind_of(effect) is Target.FRAME and "time" not in effect.depends_on:
        return [covariate for covariate in covariates_known if covariate.kind in AXES] or covariates_known
    kinds = {kind for what in effect.depends_on for kind in FOLLOWED.get(what, ())}
    turned_joints = joint_numbers(
        effect.place.partition(BY)[2] or effect.place
    )  # of a coupling the joint that turns another
    joints = {None, *(turned_joints or range(effect.arm.dof))}
    following = [covariate for covariate in covariates_known if covariate.kind in kinds and covariate.joint in joints]
    following += [covariate for covariate in covariates_known if covariate.slot in loaded_slots(effect)]
    return (
        following
        or [covariate for covariate in covariates_known if covariate.kind not in (*FOLLOWED["time"], *LOCAL)]
        or covariates_known
    )


def fair_rows(residual: Array, poses: int) -> NDArray[np.int64] | None:
    """Rows of the drawn poses that show errors as often as they occur; None where every pose is drawn.

    The drawn poses are the worst, all of them, and a random part of the others. Of the worst as large a part is kept,
    evenly from the largest error to the least of them, from a random start (Cochran 1977, Sampling Techniques, ch. 5
    and 8).

    Args:
        residual: (M, 3), of the drawn poses. poses: how many there are in all.
    """
    if len(residual) >= poses:
        return None
    order = np.argsort(-np.linalg.norm(residual, axis=1), kind="stable")
    rate = (MOST_DRAWN - WORST_DRAWN) / (poses - WORST_DRAWN)
    start = np.random.default_rng(SEED).random()
    kept = np.unique(np.floor(np.arange(start, WORST_DRAWN * rate) / rate).astype(np.int64))
    return np.sort(np.concatenate([order[kept], order[WORST_DRAWN:]]))
