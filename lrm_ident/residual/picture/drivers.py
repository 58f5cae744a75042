"""Covariates that a form is drawn over: those that it is a function of, one or two."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lrm_ident.residual.covariates import Covariate, scaled
from lrm_math.arm.place_names import joint_numbers
from lrm_math.arrays import Array
from lrm_math.effects import Effect

NO_FUNCTION, MUCH_BETTER = 0.1, 0.5
"""Von Neumann's ratio above which a form is no function of its driver; what a second one must at least reduce it to."""


def drawn_over(
    effect: Effect, form: Array, covariates_known: Sequence[Covariate], joint: int, observable: NDArray[np.bool_]
) -> tuple[Covariate, ...]:
    """Drivers that a form is drawn over: of an effect of two angles the one that it follows, or both; else any."""
    joints = joint_numbers(effect.place) if "angle" in effect.depends_on else ()
    angles = {covariate.joint: covariate for covariate in covariates_known if covariate.kind == "angle"}
    angles_of_effect = tuple(
        angles[joint] for joint in joints if joint in angles
    )  # of an effect that couples two joints: both
    angles_of_effect = angles_of_effect if len(angles_of_effect) == 2 else ()
    single = [
        covariate
        for covariate in angles_of_effect
        if von_neumann_ratio(form[observable], scaled(covariate.values[observable])) <= NO_FUNCTION
    ]
    return tuple(single[:1]) or angles_of_effect or drivers_of(form, covariates_known, joint, observable)


def drivers_of(
    form: Array, covariates_known: Sequence[Covariate], joint: int, observable: NDArray[np.bool_]
) -> tuple[Covariate, ...]:
    """The driver of which the form is a function most nearly; a second one where it is a function of two only.

    Neighbours in the order of a driver differ least (von Neumann 1941). Quantities of the joint itself come first where
    they do as well.

    Args:
        form: (N,), NaN nowhere that is observable. covariates_known: at the same poses. joint: from 0.
    """
    order = sorted(covariates_known, key=lambda covariate: covariate.joint != joint)
    shown, seen = form[observable], [scaled(covariate.values[observable]) for covariate in order]
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
