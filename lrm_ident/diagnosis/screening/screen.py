"""Screening: score test of every effect of the catalogue, in every form at every place, on the residual of a fit.

Of thousands of poses a random subsample is screened, with those that the fit misses most.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.effect_pairs import EffectPairs
from lrm_ident.diagnosis.screening.candidates import (
    Refusal,
    Unfitted,
    differentiate_candidates,
    split_testable,
    unfitted_effects,
    unfitted_rows,
)
from lrm_ident.diagnosis.screening.column_sets import ColumnSets
from lrm_ident.diagnosis.screening.likely_shapes import with_likely_shapes
from lrm_ident.diagnosis.screening.linearised_fit import LinearisedFit, linearise
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate, score_candidates
from lrm_ident.fitting.cross_validation import held_out_folds
from lrm_ident.fitting.identifiability import subsample_rows
from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE, Fit
from lrm_ident.fitting.loss import robust_scale
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.free_functions import FreeFunction, free_functions, lagged
from lrm_ident.residual.noise_floor import NoiseFloor, noise_floor
from lrm_ident.residual.residual_structure import ResidualStructure, residual_structure
from lrm_ident.residual.thresholds import FLOOR_RATIO, SIGNIFICANCE
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.model.derivatives import Response, parameter_jacobian
from lrm_math.model.equilibrium import with_borne_loads

MOST_FAR = 200  # outliers of a fit that are screened beside the subsample


@dataclass(frozen=True, eq=False)
class Screening:
    """Every candidate alone on the residual of a fit.

    Attributes:
        fit, data: of all N poses. screened: (n,), rows that were screened.
        weigh, linear: relative weights of the screened rows, and the fit linearised there.
        response: of the model with every candidate in it. scored: the testable candidates.
        sets: their projected columns, side by side. not_testable: the other effects, with the reason.
        rates: how often arms of this kind have each effect, where that is known.
    """

    fit: Fit
    data: Measurements
    screened: NDArray[np.int64]
    weigh: RowWeights
    linear: LinearisedFit
    response: Response
    scored: list[ScoredCandidate]
    sets: ColumnSets
    not_testable: tuple[Refusal, ...]
    rates: EffectRates | None = None

    @cached_property
    def ranked(self) -> list[ScoredCandidate]:
        """The testable candidates, best first."""
        return sorted(self.scored, key=lambda candidate: candidate.alone.rms)

    @cached_property
    def pairs(self) -> EffectPairs:
        """The candidates, and pairs of them, beside the fit."""
        return EffectPairs(
            self.scored, self.sets, self.linear, {candidate.name: candidate.alone for candidate in self.scored}
        )

    @cached_property
    def subset(self) -> tuple[Fit, Measurements]:
        """The fit and the measurements at the screened rows."""
        return self.fit.take(self.screened), self.data.take(self.screened)

    @cached_property
    def floor(self) -> NoiseFloor:
        """Noise of the measurements."""
        return noise_floor(self.data, self.fit.equilibrium)

    @property
    def lack_of_fit_p_value(self) -> float:
        """p value of the lack-of-fit F test of the residual against the noise floor; NaN where that is unknown."""
        return self._p_value(self.floor)

    def _p_value(self, floor: NoiseFloor) -> float:
        return floor.p_value(self.fit.sigma, self.data.measured_rows - self.fit.effective_parameters)

    def floor_beside(self, scored: ScoredCandidate) -> NoiseFloor:
        """Noise of the measurements if the model had a candidate.

        Repeats of a pose that came from elsewhere differ by what play, friction or creep did before: pure error only
        to a model that knows of it. Where a candidate takes less from the pure error than a noise may be misstated, the
        noise is that without it.
        """
        fitted, part = self.subset
        _, moved = scored.candidate.acting(scored.shape)
        sd = self.floor.sd
        floor = noise_floor(part, fitted.equilibrium, (moved @ scored.alone.theta).reshape(len(part), -1))
        if sd is None or floor.sd is None or floor.source != "replicates" or FLOOR_RATIO * floor.sd > sd:
            return self.floor
        return floor

    @cached_property
    def structure(self) -> ResidualStructure:
        """Structure of the residual."""
        linear = self.linear
        return residual_structure(self.subset[1].poses.q, linear.residual[: linear.measured], linear.measured_basis)

    @cached_property
    def joint_jacobian(self) -> Array:
        """(joints, R, n), motion of what is measured for a unit rotation of each joint."""
        return self.response.slots[list(self.response.equilibrium.model.chain.joint_slots)]

    @cached_property
    def functions(self) -> list[FreeFunction]:
        """Free functions of every covariate at every place."""
        fitted, part = self.subset
        before = lagged(self.fit.equilibrium.joint_torque)[self.screened]
        return free_functions(self.joint_jacobian, part, fitted.equilibrium, before)

    @property
    def outliers(self) -> tuple[int, ...]:
        """Numbers of the poses beyond twice the outlier distance of a fit, both without and with the best candidate.

        Twice, because a missing effect may put whole groups of poses far out. Distances are unweighted: the weights of
        a robust loss would hide the outliers.
        """
        squared = self.linear.baseline.held_out
        if self.ranked:
            squared = np.minimum(squared, self.ranked[0].alone.held_out)
        distance = np.sqrt(squared / self.fit.weight[self.screened])
        far = distance > 2 * OUTLIER_DISTANCE * robust_scale(distance, self.subset[1].whitening.measured)
        return tuple(self.data.pose[self.screened[far]].tolist())

    def like_noise(self, scored: ScoredCandidate) -> bool:
        """Whether the residual is no larger than a known noise and shows no structure: no cause is missing then, unless
        a candidate shows that the repeats, from which the noise is known, differ by what it does."""
        return not self.structure.significant and self._within(self.floor) and self._within(self.floor_beside(scored))

    def _within(self, floor: NoiseFloor) -> bool:
        """Whether the residual is no larger than a noise, by the lack-of-fit test and by `FLOOR_RATIO`: few repeats
        leave that test without power, so that it alone does not show that nothing is missing."""
        small = floor.sd is not None and self.fit.sigma <= FLOOR_RATIO * floor.sd
        return small and self._p_value(floor) > SIGNIFICANCE


def screen(whole: Fit, data: Measurements, kinds: Iterable[type[Effect]], progress: OnProgress) -> Screening:
    """Scores every effect of a catalogue on the residual of a fit to the data. Raises `LrmError`."""
    return _screened(whole, data, unfitted_effects(whole.model, kinds), progress)


def screen_one(whole: Fit, data: Measurements, effect: Effect) -> Screening:
    """Scores one effect alone on the residual of a fit to the data. Raises `LrmError`."""
    return _screened(whole, data, [(effect, unfitted_rows(effect, whole.model.free))], silent)


def _screened(whole: Fit, data: Measurements, effects: Iterable[Unfitted], progress: OnProgress) -> Screening:
    whole = _with_borne_loads(whole)
    screened = rows_to_screen(whole)
    fitted, part = whole.take(screened), data.take(screened)
    weigh = RowWeights(part.whitening, fitted.weight)
    linear = linearised(fitted, part, weigh)
    sensed = part.whitening.sensed
    testable, not_testable = split_testable(effects, fitted.equilibrium, sensed)
    response, every = differentiate_candidates(fitted.equilibrium, testable, sensed)
    candidates = [with_likely_shapes(candidate, fitted.residual) for candidate in every]
    scored, sets, undetectable = score_candidates(candidates, linear, weigh, progress)
    return Screening(whole, data, screened, weigh, linear, response, scored, sets, (*not_testable, *undetectable))


def _with_borne_loads(fitted: Fit) -> Fit:
    """The fit, its poses with the loads that its arm bore before them: what candidates with a memory follow."""
    settled = fitted.equilibrium
    return replace(fitted, equilibrium=replace(settled, poses=with_borne_loads(settled.model, settled.poses)))


def rows_to_screen(fitted: Fit) -> NDArray[np.int64]:
    """All rows of a fit; of thousands a subsample, and the farthest of its outliers."""
    distance = np.linalg.norm(fitted.residual, axis=1)
    far = sorted(fitted.outliers, key=lambda row: -distance[row])[:MOST_FAR]
    return np.union1d(subsample_rows(len(distance)), np.array(far, dtype=np.int64))


def linearised(fitted: Fit, data: Measurements, weigh: RowWeights) -> LinearisedFit:
    """A fit linearised at its minimum, with the joint-space folds. `weigh`: relative weights of its rows."""
    keys = [key for key in fitted.model.free if key not in fitted.at_bound]
    typical = np.array([fitted.model.parameter(key).typical for key in keys])
    residual = data.residual(fitted.equilibrium).reshape(-1, 1)
    jacobian = parameter_jacobian(fitted.equilibrium, keys, data.whitening.sensed)
    columns = (jacobian * typical).reshape(len(residual), len(keys))
    fold = held_out_folds(data)
    poses = [np.flatnonzero(fold == number) for number in range(fold.max() + 1)]
    return linearise(weigh(columns), weigh(residual)[:, 0], poses, fitted.sigma, prior_rows(fitted, keys))


def prior_rows(fitted: Fit, keys: Sequence[str]) -> tuple[Array, Array]:
    """(K, P) and (K,), the prior of a fit as measurements of its own parameters `keys`, of typical sizes: columns and
    residual (m), as noisy as the measurements."""
    prior_indices = [] if fitted.prior is None else [row for row, key in enumerate(keys) if key in fitted.prior.keys]
    rows = np.zeros((len(prior_indices), len(keys)))
    if fitted.prior is None or not prior_indices:
        return rows, np.zeros(0)
    keys_of_rows = [keys[row] for row in prior_indices]
    root = fitted.sigma * np.linalg.inv(np.linalg.cholesky(fitted.prior.covariance_of(keys_of_rows)))
    rows[:, prior_indices] = root * [fitted.model.parameter(key).typical for key in keys_of_rows]
    return rows, root @ (fitted.prior.mean_of(keys_of_rows) - [fitted.model.value(key) for key in keys_of_rows])
