"""Predictability of a residual: held-out error of a Gaussian process on the residual of a model, in the same blocks.

A benchmark that is never deployed. In every fold of the cross-validation one process per axis is fitted to the training
residual of the model. What it predicts is not noise: its held-out error is an upper bound of the noise floor, and a
model that predicts significantly worse misses something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.data.wording import BLACK_BOX, enumerate_words, in_mm
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual
from lrm_ident.residual.better_prediction import falls_by_share, vuong_z
from lrm_ident.residual.covariates import covariates, distinct, symbol_words
from lrm_ident.residual.thresholds import MIN_NAMELESS_GAIN, Z_THRESHOLD
from lrm_math.arrays import Array

NAMED = 3  # inputs in a sentence
IN_WORDS = {"order": "the order of measurement", **{f"position {axis}": f"{axis} of the tip" for axis in "xyz"}}
SEARCH_ROWS = 250  # training rows of a block from which its kernel is estimated
RELEVANT, MOST_FOLLOWED = 0.1, 5  # least relevance of an input that is named, in parts of the largest; most inputs


def pose_covariates(data: Measurements, position: Array) -> dict[str, Array]:
    """Inputs of the process by symbol, (N,) each, standardised, without constant and redundant ones.

    Joint angles, order of measurement, load, time, temperature, direction of approach of every joint, and position.

    Args:
        position: (N, 3), predicted TCP (m); the measured one contains the noise.
    """
    known = {one.symbol: one.values for one in covariates(data, np.empty((len(data), 0)))}
    angles = [symbol for symbol in known if symbol.startswith("q")]
    inputs = {symbol: known[symbol] for symbol in (*angles, "order", "load", "time", "temperature") if symbol in known}
    if data.poses.direction is not None:
        sides = enumerate(data.poses.direction.T, start=1)
        inputs |= {f"direction of approach of joint {joint}": side for joint, side in sides}
    inputs |= {f"position {axis}": values for axis, values in zip("xyz", position.T, strict=True)}
    return distinct(inputs)


@dataclass(frozen=True, eq=False)
class PredictableError:
    """Held-out residuals of a model without and with a Gaussian process.

    Attributes:
        before, after: (N, 3), held-out residual of the model, and of model and Gaussian process together (m).
        follows: names of the most relevant inputs of the process, the first most.
        rows: number of training poses, at most.
    """

    before: Array
    after: Array
    follows: tuple[str, ...]
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

    @property
    def brief(self) -> str:
        """What the process reaches, and what that means."""
        reached = f"{in_mm(self.error.rms)} mm RMS"
        return f"{reached}: the error is systematic" if self.more_to_find else f"finds nothing systematic ({reached})"

    @property
    def sentence(self) -> str:
        """Prediction of the residual in words, and the inputs that it follows."""
        before, after = in_mm(error_stats(self.before).rms), in_mm(self.error.rms)
        if not self.more_to_find:
            return f"{BLACK_BOX} predicts no better ({after} mm RMS with it)"
        inputs = enumerate_words([IN_WORDS.get(name) or symbol_words(name) for name in self.follows], NAMED)
        return (
            f"{BLACK_BOX} lowers the error from {before} to {after} mm RMS. So that part is systematic: it has a "
            f"cause. It depends on {inputs}."
        )

    def as_json(self) -> dict[str, object]:
        """The table `nameless`."""
        return {
            **self.error.as_json(),
            "follows": self.follows,
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
    known = pose_covariates(data, data.tcp - before)
    names, x = tuple(known), np.stack(list(known.values()), axis=1)
    relevance, most = np.zeros(len(names)), 0
    for block in blocks:
        search = spaced_rows(len(block.train), SEARCH_ROWS)
        start = FactoredKernel.of(Kernel.start(len(names)), x[block.train[search]])
        most = max(most, len(block.train))
        for axis in range(3):
            y, unit = block.train_residual[:, axis], float(block.train_residual[:, axis].std()) or 1.0
            kernel = fit_kernel(start, y[search] / unit)
            process = condition(kernel, x[block.train], y / unit)
            after[block.test, axis] = block.test_residual[:, axis] - unit * process.mean(x[block.test])
            relevance += (unit * kernel.signal / kernel.lengths) ** 2
    ranked = sorted(zip(relevance.tolist(), names, strict=True), reverse=True)
    follows = tuple(name for value, name in ranked if value > RELEVANT * ranked[0][0])
    return PredictableError(before, after, follows[:MOST_FOLLOWED], most)
