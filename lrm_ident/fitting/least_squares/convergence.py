"""Convergence of the fit: which step is the last one, and when idle steps mean that the fit does not converge."""

from __future__ import annotations

import numpy as np

from lrm_ident.fitting.least_squares.objective import Iterate
from lrm_ident.fitting.least_squares.quadratic_model import GAIN_TOLERANCE, STEP_TOLERANCE, QuadraticModel
from lrm_ident.fitting.priors import WEAK_SD
from lrm_math.errors import LrmError

IDLE_GAIN, IDLE_LIKELIHOOD = 1e-5, 0.3
"""Largest gain of an idle step: part of the objective, and rise of the log-likelihood."""
POSTERIOR_TOLERANCE = 1e-6  # predicted increase of the log-posterior, or -likelihood: to a thousandth of errors
PENALISED_TOLERANCE = 1e-3  # the same where penalties of forms, known to a third, decide it: to a part of their errors


class FitNotConverged(LrmError):
    """The fit did not converge; carries the number of `steps` and the last `step` in typical sizes."""

    def __init__(self, steps: int, step: float) -> None:
        self.steps, self.step = steps, step
        super().__init__(
            f"the fit did not converge in {steps} steps (last step {step:.2g} of the typical sizes); "
            "fit all parameters with their typical sizes (leave --parameters out), or start from a fitted model"
        )


def largest_change(start: Iterate, trial: Iterate) -> float:
    """Largest change of a parameter, in typical sizes."""
    return float(np.abs(trial.z - start.z).max())


def is_last(quadratic: QuadraticModel, trial: Iterate, tolerance: float) -> bool:
    """Whether a step was too short to matter, or predicted next to no decrease; `tolerance`: of the log-posterior."""
    value, noise = quadratic.value(quadratic.iterate), quadratic.noise
    sigma = noise.sigma or quadratic.objective.residual_sd(quadratic.iterate)
    least = max(GAIN_TOLERANCE * value, tolerance * (sigma / noise.scale) ** 2)
    return largest_change(quadratic.iterate, trial) < STEP_TOLERANCE or quadratic.predicted_decrease(trial) < least


def is_idle(quadratic: QuadraticModel, trial: Iterate) -> bool:
    """Whether a step lowered the objective by a negligible part, and the log-likelihood by next to nothing."""
    before, after = quadratic.value(quadratic.iterate), quadratic.value(trial)
    return before - after <= min(IDLE_GAIN, IDLE_LIKELIHOOD / trial.residual.size) * before


def is_well_determined(quadratic: QuadraticModel) -> bool:
    """Whether the data, or a prior, determine every direction of the parameters better than the weak priors do."""
    objective, free = quadratic.objective, quadratic.free
    if objective.has_full_prior or not free.any():
        return True
    hessian = objective.gauss_newton(quadratic.rows.normal, quadratic.noise)[np.ix_(free, free)]
    return float(np.linalg.eigvalsh(hessian)[0]) * WEAK_SD**2 > objective.residual_sd(quadratic.iterate) ** 2
