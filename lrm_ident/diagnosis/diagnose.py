"""Diagnosis: which physical effect is missing, that none is, or that structure is left which no effect explains.

measurements -> fit -> candidates -> forms -> confirm -> report: this is the linear screening, `confirm` refits it.
Every effect of the catalogue in every form at every place is tried on the residual (score test) and judged by the
held-out error that it would leave; effects are taken by forward selection. Then free functions are tried on what is
left: they separate an effect that is really there from one that only resembles a structure outside the catalogue.
Of thousands of poses a part is screened, drawn at random, with those that the fit misses most; `confirm` refits all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import free_base_parameters
from lrm_ident.diagnosis.forward_selection import equivalent_effects, forward_select
from lrm_ident.diagnosis.screening.candidates import REFINEMENT
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import Screening, screen
from lrm_ident.diagnosis.shifted_rows import ShiftedRows, shifted_rows
from lrm_ident.diagnosis.unexplained_structure import UnexplainedStructure, unexplained_structure
from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE, Fit, fit
from lrm_ident.fitting.loss import SQUARED, Loss, robust_scale
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.residual_structure import NoiseFloor, ResidualStructure
from lrm_ident.residual.significance import benjamini_yekutieli
from lrm_ident.residual.thresholds import FLOOR_RATIO, MORAN_THRESHOLD, NOT_NOISE
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect, variants
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model

MOST_ROUNDS = 3  # of leaving out outliers: a far one hides those that are nearer (masking)
RIVALS_KEPT = 4  # of a step that is taken
Verdict = Literal[
    "effect_missing", "effect_describes", "unexplained_structure", "unpredictable", "nothing_missing", "noise_unknown"
]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Diagnosis of a model on measurements: the effects that it misses.

    Attributes:
        fit, data: of all N poses. screened: (n,), rows of those that were screened, all of few; below for these only.
        squared_held_out: (n,), held-out squared distance of each pose without anything added (m²).
        scored: every testable candidate, best first. adjusted_p_values: theirs, Benjamini-Yekutieli.
        selected: by forward selection, in that order, spurious ones included.
        equivalent: for each selected one, names of candidates that these data cannot distinguish from it.
        screening: what it selected from.
        outliers: numbers of the poses left out. shifted: rows that carry another row's position.
    """

    fit: Fit
    data: Measurements
    squared_held_out: Array
    scored: tuple[ScoredCandidate, ...]
    adjusted_p_values: dict[str, float]
    selected: tuple[ScoredCandidate, ...]
    equivalent: dict[str, tuple[str, ...]]
    unexplained: UnexplainedStructure
    not_testable: tuple[tuple[Effect, str], ...]
    screened: NDArray[np.int64]
    screening: Screening
    outliers: tuple[int, ...] = ()
    shifted: tuple[ShiftedRows, ...] = ()

    @property
    def floor(self) -> NoiseFloor:
        """Noise of the measurements."""
        return self.screening.floor

    @property
    def structure(self) -> ResidualStructure:
        """Structure in what the fit leaves."""
        return self.screening.structure

    @property
    def joint_jacobian(self) -> Array:
        """(joints, 3, n), motion of the TCP for a unit rotation of each joint (m/rad)."""
        return self.screening.joint_jacobian[:, :3]

    @property
    def screened_subset(self) -> tuple[Fit, Measurements]:
        """The fit and the measurements at the poses that were screened."""
        return self.screening.subset

    @property
    def supported(self) -> tuple[ScoredCandidate, ...]:
        """Effects that are there as far as these data show, most helpful first."""
        return tuple(scored for scored in self.selected if scored.name not in self.unexplained.spurious)

    @cached_property
    def outlier_distances(self) -> dict[int, float]:
        """Distance (m) of each pose left out, now or in the model's fit, from where the model has it, by its number.

        None of rows that look shifted, nor where no position was measured or the model has no equilibrium.
        """
        shifted = {number for block in self.shifted for number in range(block.first, block.last + 1)}
        complete = self.data.complete
        left_out = complete.take(~np.isin(complete.pose, [*self.data.pose, *shifted]))
        if not len(left_out):
            return {}
        equilibrium, rows = batch_equilibrium(self.fit.model, left_out.poses)
        distance = np.linalg.norm(left_out.tcp[rows] - equilibrium.tcp, axis=1)
        found = zip(left_out.pose[rows].tolist(), distance.tolist(), strict=True)
        return {number: far for number, far in found if np.isfinite(far)}

    @property
    def verdict(self) -> Verdict:
        """Structure counts if it is significant and the error exceeds the noise floor (or neighbours are alike)."""
        if self.supported:
            return "effect_missing"
        if self.unexplained.functions:
            return "unexplained_structure"
        structure, floor = self.structure, self.floor.sd
        matters = structure.moran_i > MORAN_THRESHOLD if floor is None else self.fit.sigma > FLOOR_RATIO * floor
        if structure.significant and matters:
            return "unexplained_structure"
        if floor is None:
            return "noise_unknown"
        return "unpredictable" if self.above_floor else "nothing_missing"

    def rivals(self, taken: Collection[str]) -> dict[str, float]:
        """Held-out RMS (m) that plausible effects beside some that are taken would alone leave, the least first."""
        others = [one for one in self.scored if one.name not in taken and not one.implausible]
        nearest = sorted(others, key=lambda one: one.alone.rms)[:RIVALS_KEPT]
        return {one.name: float(one.alone.rms) for one in nearest}

    @property
    def above_floor(self) -> bool:
        """Whether the residual surely exceeds a known noise floor, by more than this may be misstated (F test)."""
        floor, freedom = self.floor, self.data.measured_rows - len(self.fit.model.free)
        if floor.sd is None or self.fit.sigma <= FLOOR_RATIO * floor.sd:
            return False
        return floor.p_value(self.fit.sigma, freedom) < NOT_NOISE


def diagnose(
    model: Model,
    data: Measurements,
    catalogue: Iterable[type[Effect]] = CATALOGUE,
    progress: OnProgress = silent,
    loss: Loss = SQUARED,
    rates: EffectRates | None = None,
    fitted: Fit | None = None,
) -> Diagnosis:
    """Finds what a model misses on measurements. The model's free parameters are refitted first, with this loss.

    Without outliers the data may tell more: what they tell then is freed before any effect is tried.

    Args:
        rates: how often arms of this kind have each effect, where that is known.
        fitted: the model's fit to these data with this loss, where that is known.

    Raises:
        LrmError: too few poses, or the fit does not converge.
    """
    kinds = tuple(catalogue)
    found = screen(fitted or fit(model, data, loss=loss), data, kinds, progress)
    left_out: tuple[int, ...] = ()
    for _ in range(MOST_ROUNDS):
        numbers = found.outliers
        if not numbers:
            break
        left_out += numbers
        before, rest = found.fit.model, found.data.without(numbers)
        del found  # it holds the columns of every candidate
        found = screen(free_base_parameters(fit(before, rest, loss=loss), rest, loss), rest, kinds, progress)
    selected = _select(replace(found, rates=rates), progress)
    if not left_out:
        return selected
    return replace(selected, outliers=tuple(sorted(left_out)), shifted=_shifted(selected, data))


def select_without(diagnosis: Diagnosis, refused: Collection[str]) -> Diagnosis:
    """The same diagnosis with other effects selected: none of the refused (`effect@place`), of which those that were
    selected beside them may not be needed, and others may."""
    found = _select(diagnosis.screening, silent, refused)
    return replace(found, outliers=diagnosis.outliers, shifted=diagnosis.shifted)


def _select(scores: Screening, progress: OnProgress, refused: Collection[str] = ()) -> Diagnosis:
    """Selects effects. Where all of them only resemble some structure, the forms of these are tried in their place: a
    plain effect is named before a form that helps more, and must not hide it."""
    possible = [one for one in scores.ranked if one.name not in refused]
    tried = [one for one in possible if not scores.like_noise or one.candidate.priority == REFINEMENT]
    found = _selected(scores, progress, possible, tried)
    if found.supported:
        return found
    names = {one.name for one in found.selected}
    forms = [one for one in tried if names & set(variants(one.candidate.effect))]
    instead = _selected(scores, progress, possible, forms) if forms else found
    return instead if instead.supported else found


def _selected(
    scores: Screening,
    progress: OnProgress,
    possible: Sequence[ScoredCandidate],
    tried: Sequence[ScoredCandidate],
) -> Diagnosis:
    whole, linear, ranked = scores.fit, scores.linear, scores.ranked
    weights = None if scores.rates is None else scores.rates.weights([one.name for one in tried])
    selection = forward_select(scores.scored, scores.sets, linear, progress, weights, tried)
    selected = selection.effects
    return Diagnosis(
        fit=whole,
        data=scores.data,
        squared_held_out=linear.now.held_out,
        scored=(*selected, *(one for one in ranked if one not in selected)),
        adjusted_p_values=benjamini_yekutieli({one.name: one.p_value for one in ranked}),
        selected=selected,
        equivalent={one.name: equivalent_effects(selection, i, possible) for i, one in enumerate(selected)},
        unexplained=unexplained_structure(selection, scores.functions, scores.weigh),
        not_testable=scores.not_testable,
        screened=scores.screened,
        screening=scores,
    )


def _shifted(found: Diagnosis, data: Measurements) -> tuple[ShiftedRows, ...]:
    """The blocks of all measured rows that carry the position of a neighbouring row."""
    predicted = np.full((len(data), 3), np.nan)
    equilibrium, rows = batch_equilibrium(found.fit.model, data.poses)
    predicted[rows] = equilibrium.tcp
    limit = 2 * OUTLIER_DISTANCE * robust_scale(np.linalg.norm(found.fit.residual, axis=1))
    return shifted_rows(data.pose, data.tcp, predicted, limit)
