"""Error of the model beside the noise of the tracker: a variance that all positions have on top of their stated one.

Where the model misses poses by more than they were measured to, the stated noise alone would give the most exact poses
all the weight. The additional variance is that of a random-effects model (Paule & Mandel 1982; DerSimonian & Laird
1986): with it, the weighted squares of the residual sum up to their degrees of freedom.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.error_stats import CHI3_MEDIAN
from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import Equilibrium

AXES = 3
ALIKE = 1.2  # largest over smallest standard deviation: nothing is weighed then
TRIMMED = 5.0  # robust standard deviations
HALVINGS = 60
WORTH_SAYING = 2.0  # model error over stated noise


def with_model_error(data: Measurements, settled: Equilibrium, parameters: float) -> Measurements:
    """The measurements, weighed as a model with this equilibrium can follow them; `parameters`: how many of its own the
    data decided.

    As they are where positions are alike by their noise, or weighed against orientations, feedback or distances.
    """
    sd = data.sd
    if sd is None or len(data.observations) > 1 or sd.max() <= ALIKE * sd.min():
        return data
    residual = data.position_error(settled)
    distance = np.linalg.norm(residual, axis=1)
    near = distance <= TRIMMED * float(np.median(distance)) / CHI3_MEDIAN
    freedom = AXES * int(near.sum()) - parameters
    if freedom <= 0:
        return data
    model_sd = additional_sd(residual[near], sd[near], freedom)
    return data.with_positions(replace(data.positions, model_sd=model_sd))


def additional_sd(residual: Array, sd: Array, freedom: float) -> float:
    """The standard deviation (m) beside `sd` (N,) with which residuals (N, 3) have `freedom` weighted squares."""
    squared = (residual**2).sum(axis=1)

    def excess(variance: float) -> float:
        """Weighted squares beyond the degrees of freedom, of an additional variance (m²)."""
        return float((squared / (sd**2 + variance)).sum()) - freedom

    low, high = 0.0, float(squared.sum()) / freedom
    if excess(low) <= 0.0:
        return 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return float(np.sqrt(high))


def model_error_words(data: Measurements) -> tuple[str, ...]:
    """Notice about an error of the model that is larger than the stated noise."""
    if data.sd is None or data.positions.model_sd <= WORTH_SAYING * float(np.median(data.sd)):
        return ()
    return (
        f"the poses were measured to {np.median(data.sd) * 1e3:.3g} mm per axis, the model misses them by "
        f"{data.positions.model_sd * 1e3:.3g} mm: this error of the model is added to the variance of every pose",
    )
