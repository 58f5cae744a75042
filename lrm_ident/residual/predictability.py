"""Predictability of a residual: held-out error of a Gaussian process on the residual of a model, in the same blocks.

A benchmark that is never deployed. In every fold of the cross-validation one process per axis is fitted to the training
residual of the model. What it predicts is not noise: its held-out error is an upper bound of the noise floor, and a
model that predicts significantly worse misses something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual
from lrm_ident.residual.better_prediction import falls_by_share, vuong_z
from lrm_ident.residual.covariates import ExplanatoryVariable, covariates, distinct
from lrm_ident.residual.thresholds import MIN_NAMELESS_GAIN, Z_THRESHOLD
from lrm_math.arrays import Array

INPUTS = ("angle", "order", "load", "time", "temperature")
AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")
SEARCH_ROWS = 250  # training rows of a block from which its kernel is estimated
RELEVANT, MOST_FOLLOWED = 0.1, 5  # least relevance of an input that is named, in parts of the largest; most inputs


def pose_covariates(data: Measurements, position: Array) -> dict[ExplanatoryVariable, Array]:
    """Inputs of the process, (N,) each, standardised, without constant and redundant ones.

    Joint angles, order of measurement, load, time, temperature, direction of approach of every joint, and position.

    Args:
        position: (N, 3), predicted TCP (m); the measured one contains the noise.
    """
    by_variable = {covariate.variable: covariate.values for covariate in covariates(data, np.empty((len(data), 0)))}
    inputs = {variable: by_variable[variable] for kind in INPUTS for variable in by_variable if variable.kind == kind}
    if data.poses.direction is not None:
        sides = enumerate(data.poses.direction.T)
        inputs |= {ExplanatoryVariable("direction", joint): side for joint, side in sides}
    inputs |= {ExplanatoryVariable(axis): values for axis, values in zip(AXES, position.T, strict=True)}
    return distinct(inputs)


@dataclass(frozen=True, eq=False)
class PredictableError:
    """Held-out residuals of a model without and with a Gaussian process.

    Attributes:
        before, after: (N, 3), held-out residual of the model, and of model and Gaussian process together (m).
        follows: the most relevant inputs of the process, the first most.
        rows: number of training poses, at most.
    """

    before: Array
    after: Array
    follows: tuple[ExplanatoryVariable, ...]
    rows: int

    @property
    def error(self) -> ErrorStats:
        """Held-out error of model and Gaussian process together."""
        return error_stats(self.after)

    @property
    def z(self) -> float:
        """z score of the paired difference of squared errors (Vuong 1989); positive where the process is better."""
        return vuong_z((self.before**2).sum(axis=1) - (self.after**2).sum(axis=1))

    @property
    def more_to_find(self) -> bool:
        """Whether the process lowers the held-out error significantly, and by `MIN_NAMELESS_GAIN`."""
        after, before = ((residual**2).sum(axis=1) for residual in (self.after, self.before))
        return self.z > Z_THRESHOLD and falls_by_share(after, before, MIN_NAMELESS_GAIN)

    @property
    def noise_bound(self) -> float:
        """Upper bound of the noise, RMS of the 3-D distance (m): the smaller of both held-out errors."""
        return min(self.error.rms, error_stats(self.before).rms)

    def as_json(self) -> dict[str, object]:
        """The table `nameless`."""
        return {
            **self.error.as_json(),
            "follows": [variable.symbol for variable in self.follows],
            "z": self.z,
            "more_to_find": self.more_to_find,
            "learned_from_poses": self.rows,
        }


def predictable_error(data: Measurements, blocks: Sequence[HeldOutBlock]) -> PredictableError:
    """Gaussian process regression of the residuals of a cross-validation, in the same blocks.

    Each kernel is estimated from at most `SEARCH_ROWS` of the training poses, evenly spread over the order of
    measurement. Every search begins anew: the kernel of another block has seen the poses that this one leaves out, and
    would lower their error where nothing is hidden.
    """
    from lrm_ident.residual.gaussian_process import FactoredKernel, Kernel, condition, fit_kernel  # loads half of scipy

    before, after = held_out_residual(blocks), np.empty_like(data.tcp)
    by_variable = pose_covariates(data, data.tcp - before)
    variables, x = tuple(by_variable), np.stack(list(by_variable.values()), axis=1)
    relevance, most = np.zeros(len(variables)), 0
    for block in blocks:
        search = spaced_rows(len(block.train), SEARCH_ROWS)
        start = FactoredKernel.of(Kernel.start(len(variables)), x[block.train[search]])
        most = max(most, len(block.train))
        for axis in range(3):
            y, unit = block.train_residual[:, axis], float(block.train_residual[:, axis].std()) or 1.0
            kernel = fit_kernel(start, y[search] / unit)
            process = condition(kernel, x[block.train], y / unit)
            after[block.test, axis] = block.test_residual[:, axis] - unit * process.mean(x[block.test])
            relevance += (unit * kernel.signal / kernel.lengths) ** 2
    ranked = sorted(zip(relevance.tolist(), variables, strict=True), key=lambda pair: pair[0], reverse=True)
    follows = tuple(variable for value, variable in ranked if value > RELEVANT * ranked[0][0])
    return PredictableError(before, after, follows[:MOST_FOLLOWED], most)
