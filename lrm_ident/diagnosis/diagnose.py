"""Diagnosis: which physical effect is missing, that none is, or that structure is left which no effect explains.

This is the linear screening; `confirm` refits what it supports. Every effect of the catalogue in every form at every
place is tried on the residual (score test) and judged by the held-out error that it would leave; effects are taken by
forward selection. Free functions of what is left then show which of them are spurious, since they only resemble a
structure outside the catalogue. Of thousands of poses a random subsample is screened, with those that the fit misses
most; `confirm` refits all.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from scipy.special import chdtri

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.forward_selection import equivalent_effects, forward_select, moves_alike
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.screening.candidates import REFINEMENT, Refusal
from lrm_ident.diagnosis.screening.column_spaces import cosine_of_bases
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import Screening, screen
from lrm_ident.diagnosis.shifted_rows import ShiftedRows, shifted_rows
from lrm_ident.diagnosis.unexplained_structure import UnexplainedStructure, unexplained_structure
from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE, Fit, fit
from lrm_ident.fitting.loss import SQUARED, Loss, robust_scale
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_ident.residual.noise_floor import NoiseFloor
from lrm_ident.residual.regime import outlier_regimes
from lrm_ident.residual.residual_structure import ResidualStructure
from lrm_ident.residual.significance import benjamini_yekutieli
from lrm_ident.residual.thresholds import FLOOR_RATIO, MISSED, MORAN_THRESHOLD, NOT_NOISE
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect, variants
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model

MOST_ROUNDS = 3  # of leaving out outliers: a far one masks nearer ones
RIVALS_KEPT = 4  # of a step that is taken
SAME_MOTIONS = 1.0 - 1e-9  # smallest cosine of columns that are the same but for round-off


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Diagnosis of a model on measurements: the effects that it misses.

    Attributes:
        screening: every candidate alone; what follows is of the poses that were screened.
        scored: every testable candidate, best first. adjusted_p_values: theirs, Benjamini-Yekutieli.
        selected: by forward selection, in that order, spurious ones included.
        equivalent: for each selected one, names of the other candidates of its equivalence class.
        outliers: numbers of the poses left out. shifted: rows that carry another row's position.
    """

    screening: Screening
    scored: tuple[ScoredCandidate, ...]
    adjusted_p_values: dict[str, float]
    selected: tuple[ScoredCandidate, ...]
    equivalent: dict[str, tuple[str, ...]]
    unexplained: UnexplainedStructure
    outliers: tuple[int, ...] = ()
    shifted: tuple[ShiftedRows, ...] = ()

    @property
    def fit(self) -> Fit:
        """Fit of the diagnosed model to all poses."""
        return self.screening.fit

    @property
    def data(self) -> Measurements:
        """All poses, outliers left out."""
        return self.screening.data

    @property
    def not_testable(self) -> tuple[Refusal, ...]:
        """Effects that these poses cannot test, with the reason."""
        return self.screening.not_testable

    @cached_property
    def floor(self) -> NoiseFloor:
        """Noise of the measurements, if the model had the first of the supported effects."""
        return self.screening.floor_beside(self.supported[0]) if self.supported else self.screening.floor

    @property
    def structure(self) -> ResidualStructure:
        """Structure of the residual."""
        return self.screening.structure

    @property
    def joint_jacobian(self) -> Array:
        """(joints, 3, n), motion of the TCP for a unit rotation of each joint (m/rad)."""
        return self.screening.joint_jacobian[:, :3]

    @property
    def supported(self) -> tuple[ScoredCandidate, ...]:
        """Selected effects that are not spurious, most helpful first."""
        return tuple(scored for scored in self.selected if scored.name not in self.unexplained.spurious)

    @cached_property
    def outlier_residuals(self) -> dict[int, Array]:
        """(3,), m, measured less predicted TCP of each pose left out, here or in the model's fit, by number.

        Without rows that look shifted, poses without a measured position, and poses without an equilibrium.
        """
        shifted = {number for block in self.shifted for number in range(block.first, block.last + 1)}
        complete = self.data.complete
        left_out = complete.take(~np.isin(complete.pose, [*self.data.pose, *shifted]))
        if not len(left_out):
            return {}
        equilibrium, rows = batch_equilibrium(self.fit.model, left_out.poses)
        residuals = zip(left_out.pose[rows].tolist(), left_out.tcp[rows] - equilibrium.tcp, strict=True)
        return {number: residual for number, residual in residuals if np.isfinite(residual).all()}

    @property
    def outlier_distances(self) -> dict[int, float]:
        """Norms of the `outlier_residuals` (m)."""
        return {number: float(np.linalg.norm(residual)) for number, residual in self.outlier_residuals.items()}

    @cached_property
    def outliers_together(self) -> Array:
        """(M, 3), m, residuals, by the model in its session, of the outliers that lie together in a range of an angle
        or of the load (`outlier_regimes`): there the arm errs, not the measurement."""
        residuals = self.outlier_residuals
        left_out = self.data.complete.take(np.isin(self.data.complete.pose, [*residuals, *self.data.pose]))
        outliers = np.isin(left_out.pose, [*residuals])
        clusters = outlier_regimes(left_out, np.ones(len(left_out)), outliers)
        places = [cluster.rows for cluster in clusters if cluster.quantity.kind != "order"]
        inside = outliers & np.any(places, axis=0) if places else np.zeros(len(left_out), dtype=np.bool_)
        return np.array([residuals[number] for number in left_out.pose[inside].tolist()]).reshape(-1, 3)

    @property
    def verdict(self) -> Verdict:
        """Verdict of the screening, which refits and patterns may change (`final_verdict`).

        Structure counts if it is significant and the error exceeds the noise floor, surely or by `FLOOR_RATIO`, or,
        where that is unknown, neighbours are alike by `MORAN_THRESHOLD`."""
        if self.supported:
            return Verdict.EFFECT_MISSING
        if self.unexplained.functions:
            return Verdict.UNEXPLAINED_STRUCTURE
        structure, floor = self.structure, self.floor.sd
        larger = structure.moran_i > MORAN_THRESHOLD if floor is None else self.fit.sigma > FLOOR_RATIO * floor
        if structure.significant and (larger or self.above_floor):
            return Verdict.UNEXPLAINED_STRUCTURE
        if floor is None:
            return Verdict.NOISE_UNKNOWN
        return Verdict.UNPREDICTABLE if self.above_floor else Verdict.NOTHING_MISSING

    def special_cases(self) -> list[ScoredCandidate]:
        """Special cases of the first supported effect in its class, the most helpful first.

        They have fewer parameters, which move the TCP in a part of what its own can do.
        """
        first = self.supported[0]
        smaller = (
            candidate
            for candidate in self.scored
            if candidate.name in self.equivalent[first.name] and candidate.size < first.size
        )
        special = [candidate for candidate in smaller if moves_alike(first, candidate)]
        return sorted(special, key=lambda candidate: candidate.alone.rms)

    def repetitions(self, scored: ScoredCandidate) -> list[str]:
        """Names of the forms of an effect that move the TCP exactly as it does: the second shift without a first."""
        forms = (other for other in self.scored if scored.name in variants(other.candidate.effect))
        same = (form for form in forms if form.size == scored.size)
        return [form.name for form in same if cosine_of_bases(scored.orthonormal, form.orthonormal) > SAME_MOTIONS]

    def led_by(self, other: ScoredCandidate, members: Sequence[str]) -> Diagnosis:
        """The same with another effect in place of the first supported one. `members`: names of its class."""
        first = self.supported[0]
        selected = tuple(
            other if candidate is first else candidate
            for candidate in self.selected
            if candidate is first or candidate is not other
        )
        rest = tuple(dict.fromkeys(name for name in members if name != other.name))
        return replace(
            self,
            scored=(*selected, *(candidate for candidate in self.scored if candidate not in selected)),
            selected=selected,
            equivalent={
                candidate.name: rest if candidate is other else self.equivalent[candidate.name]
                for candidate in selected
            },
        )

    def rivals(
        self, taken: Collection[str], before: float, refitted: Mapping[str, float] = MappingProxyType({})
    ) -> dict[str, float]:
        """Held-out RMS of the tip (m) that each of the best plausible effects not `taken` would leave alone, the least
        first: that of its refit where it was `refitted`, else by the screening (`error_of_tip`)."""
        others = [
            candidate
            for candidate in self.scored
            if candidate.name not in taken and (candidate.name in refitted or not candidate.implausible)
        ]
        errors = {
            candidate.name: refitted.get(candidate.name, self.error_of_tip(candidate.alone.rms, before))
            for candidate in others
        }
        return dict(sorted(errors.items(), key=lambda item: item[1])[:RIVALS_KEPT])

    def error_of_tip(self, rms: float, before: float) -> float:
        """Held-out RMS of the tip (m) for one that the screening estimates.

        The screening weighs all that was measured of its poses by the noise. It leaves a share of its own error without
        a candidate; the tip is estimated to keep the same share of its error `before` (m).
        """
        without = self.screening.linear.baseline.rms
        return float(before * rms / without) if without else float(rms)

    @cached_property
    def motion_bounds(self) -> dict[str, float]:
        """Upper 95 % confidence bound (Scheffé 1953) of the RMS motion of the TCP (m) by each plausible effect that is
        no form, beyond what the fitted parameters explain: the estimate's and its error's. Largest first."""
        bounds = {
            scored.name: float(
                np.linalg.norm(scored.added) + self.fit.sigma * np.sqrt(chdtri(scored.parameter_count, MISSED))
            )
            for scored in self.scored
            if not scored.implausible and not scored.candidate.effect.is_free_form
        }
        ordered = sorted(bounds.items(), key=lambda item: -item[1])
        return {name: bound / math.sqrt(len(self.screening.screened)) for name, bound in ordered}

    @property
    def above_floor(self) -> bool:
        """Whether the residual exceeds a known noise floor surely (`NOT_NOISE`), by however little."""
        return self.screening.lack_of_fit_p_value < NOT_NOISE


def diagnose(
    model: Model,
    data: Measurements,
    catalogue: Iterable[type[Effect]] = CATALOGUE,
    progress: OnProgress = silent,
    loss: Loss = SQUARED,
    rates: EffectRates | None = None,
    fitted: Fit | None = None,
) -> Diagnosis:
    """Finds what a model misses on measurements; its free parameters are refitted first, with this loss.

    Args:
        rates: how often arms of this kind have each effect, where that is known.
        fitted: the model's fit to these data with this loss, where that is known.

    Raises:
        LrmError: too few poses, or the fit does not converge.
    """
    kinds = tuple(catalogue)
    screening = screen(fitted or _fitted(model, data, loss), data, kinds, progress)
    left_out: tuple[int, ...] = ()
    for _ in range(MOST_ROUNDS):
        numbers = screening.outliers
        if not numbers:
            break
        left_out += numbers
        before, rest = screening.fit.model, screening.data.without(numbers)
        del screening  # it holds the columns of every candidate
        screening = screen(_fitted(before, rest, loss), rest, kinds, progress)
    selected = _select(replace(screening, rates=rates), progress)
    if not left_out:
        return selected
    return replace(selected, outliers=tuple(sorted(left_out)), shifted=_shifted(selected, data))


def _fitted(model: Model, data: Measurements, loss: Loss) -> Fit:
    """Fit of the model's free parameters, with the prior of typical sizes."""
    return fit(model, data, loss=loss, prior=typical_prior(model))


def select_without(diagnosis: Diagnosis, refused: Collection[str]) -> Diagnosis:
    """The diagnosis with effects selected anew without the refused ones (`effect@place`): others may be needed then."""
    selected = _select(diagnosis.screening, silent, refused)
    return replace(selected, outliers=diagnosis.outliers, shifted=diagnosis.shifted)


def _select(screening: Screening, progress: OnProgress, refused: Collection[str] = ()) -> Diagnosis:
    """Selects effects; where all of them are spurious, their other forms are tried instead: a plain effect is selected
    before its form, and must not hide that."""
    possible = [scored for scored in screening.ranked if scored.name not in refused]
    tried = [
        scored for scored in possible if scored.candidate.priority == REFINEMENT or not screening.like_noise(scored)
    ]
    first_choice = _diagnosis_of(screening, progress, possible, tried)
    if first_choice.supported:
        return first_choice
    names = {scored.name for scored in first_choice.selected}
    forms = [scored for scored in tried if names & set(variants(scored.candidate.effect))]
    instead = _diagnosis_of(screening, progress, possible, forms) if forms else first_choice
    return instead if instead.supported else first_choice


def _diagnosis_of(
    screening: Screening,
    progress: OnProgress,
    possible: Sequence[ScoredCandidate],
    tried: Sequence[ScoredCandidate],
) -> Diagnosis:
    """The diagnosis that selects from the candidates `tried`, the classes of the selected ones among the `possible`."""
    ranked = screening.ranked
    weights = None if screening.rates is None else screening.rates.weights([scored.name for scored in tried])
    selection = forward_select(screening.pairs, progress, weights, tried)
    selected = selection.effects
    return Diagnosis(
        screening=screening,
        scored=(*selected, *(scored for scored in ranked if scored not in selected)),
        adjusted_p_values=benjamini_yekutieli({scored.name: scored.p_value for scored in ranked}),
        selected=selected,
        equivalent={scored.name: equivalent_effects(selection, i, possible) for i, scored in enumerate(selected)},
        unexplained=unexplained_structure(selection, screening.functions, screening.weigh),
    )


def _shifted(diagnosis: Diagnosis, data: Measurements) -> tuple[ShiftedRows, ...]:
    """The blocks of all measured rows that carry the position of a neighbouring row."""
    predicted = np.full((len(data), 3), np.nan)
    equilibrium, rows = batch_equilibrium(diagnosis.fit.model, data.poses)
    predicted[rows] = equilibrium.tcp
    limit = 2 * OUTLIER_DISTANCE * robust_scale(np.linalg.norm(diagnosis.fit.residual, axis=1))
    return shifted_rows(data.pose, data.tcp, predicted, limit)
