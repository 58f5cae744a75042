"""Fixed end of measured distances, fitted to the arm of each trial step (variable projection: Golub & Pereyra 1973).

A turn of the arm about that end, or a shift of both, changes no distance. Straight steps of all parameters together
leave that curved valley after a few millimetres, so a fit of distances alone would creep along it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.fitting.least_squares.objective import Iterate, NoiseScale, Objective
from lrm_ident.fitting.priors import of_the_set_up
from lrm_math.model.derivatives import direct_jacobian

STEPS = 3


def with_anchor_fitted(objective: Objective, iterate: Iterate, noise: NoiseScale) -> Iterate:
    """The iterate with the free coordinates of the fixed end at their optimum for its arm, by Gauss–Newton.

    The same iterate where there are none, or where that is no better. No equilibrium depends on them.
    """
    places = [row for row, key in enumerate(objective.model.free) if of_the_set_up(key)]
    keys, whitening, best = [objective.model.free[row] for row in places], objective.data.whitening, iterate
    for _ in range(STEPS if places else 0):
        weight = objective.root_weight(best, noise)
        target = (weight * best.residual).reshape(-1)
        moved = direct_jacobian(best.equilibrium, keys, whitening.sensed) * objective.typical[places]
        columns = (weight[:, :, None] * whitening(moved)).reshape(len(target), len(places))
        z = best.z.copy()
        # the distance is nearly linear in the end as long as it is far: two or three steps settle it
        z[places] += np.linalg.lstsq(columns, target, rcond=None)[0]
        values = best.equilibrium.model.values.copy()
        values[objective.columns] = z * objective.typical
        # no slot and no load depends on the end, so that the equilibrium stays as it is
        settled = replace(best.equilibrium, model=best.equilibrium.model.with_values(values))
        trial = Iterate(z, settled, objective.data.whitening(objective.data.residual(settled)))
        if objective.value(trial, noise) >= objective.value(best, noise):
            break
        best = trial
    return best
