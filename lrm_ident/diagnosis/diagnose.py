"""Which physical effect is missing: audit, floor, structure, score, classes, decision by prediction, verdict.

Every effect of the catalogue at every place is tried on the residual, as a total derivative with the fitted parameters
taken out (score test; Saris, Satorra & Sörbom 1987), and judged by the held-out error that it would leave. Effects are
taken one after the other as long as one helps. Then free functions (`flexible`) are tried on what is left: an effect
that stands in for a structure which it does not really have is told from one that is really there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.candidates import candidates, split_testable
from lrm_ident.diagnosis.forward_selection import SIGNIFICANT, path_of, rivals_of
from lrm_ident.diagnosis.free_functions import FreeFunction
from lrm_ident.diagnosis.linearised_fit import Bench, bench
from lrm_ident.diagnosis.residual_structure import Floor, Structure, noise_floor, structure
from lrm_ident.diagnosis.score_test import Scored, benjamini_yekutieli, score_all
from lrm_ident.diagnosis.unexplained import free_structure
from lrm_ident.fit.cross_validation import blocks
from lrm_ident.fit.levenberg_marquardt import OUTLIER_DISTANCE, Fit, fit
from lrm_ident.fit.loss import robust_scale
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.model import Model

ABOVE_FLOOR, ALIKE = 1.15, 0.1  # residual over floor, and Moran's I, above which structure matters


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is missing.

    Attributes:
        before: held-out squared distance of each pose without anything added (m²).
        scored: every testable candidate, best first.
        path: those that help, in the order they were taken, borrowed ones included.
        borrowed: name of those whose place has a structure that they only resemble -> the free function that has it.
        rivals: for each of the path, names of candidates that these data cannot tell from it.
        free: nameless functions that explain much of what the path leaves, at one joint.
        turns: (n, 3, N), TCP's motion for a unit turn of each joint (m/rad).
        anatomy: free functions on the residual, best first, with their held-out RMS (m).
    """

    fit: Fit
    data: Measurements
    floor: Floor
    structure: Structure
    verdict: Literal["effect_missing", "nothing_missing", "unexplained_structure"]
    before: Array
    scored: tuple[Scored, ...]
    adjusted: dict[str, float]
    path: tuple[Scored, ...]
    borrowed: dict[str, str]
    rivals: dict[str, tuple[str, ...]]
    free: tuple[FreeFunction, ...]
    anatomy: tuple[tuple[FreeFunction, float], ...]
    not_testable: tuple[tuple[Effect, str], ...]
    turns: Array
    outliers: tuple[int, ...] = field(default=())

    @property
    def supported(self) -> tuple[Scored, ...]:
        """Effects that are there as far as these data can tell, most helpful first."""
        return tuple(scored for scored in self.path if scored.name not in self.borrowed)


def diagnose(
    model: Model, data: Measurements, catalogue: Iterable[type[Effect]] = CATALOGUE, progress: Tick = silent
) -> Diagnosis:
    """Finds what a model misses on measurements. The model's free parameters are refitted first.

    Raises:
        LrmError: too few poses, or the fit does not converge.
    """
    kinds = tuple(catalogue)
    first = _diagnose(model, data, kinds, progress)
    outliers = _outliers(first)
    if not outliers:
        return first
    kept = np.setdiff1d(np.arange(len(data)), outliers)
    again = _diagnose(first.fit.model, data.take(kept), kinds, progress)
    return Diagnosis(**{**vars(again), "outliers": tuple(int(data.pose[row]) for row in outliers)})


def _diagnose(model: Model, data: Measurements, kinds: tuple[type[Effect], ...], progress: Tick) -> Diagnosis:
    fitted = fit(model, data)
    weight = _weights(data)
    on = _bench(fitted, data, weight)
    testable, refused = split_testable(fitted.model, fitted.rest, kinds)
    response, found = candidates(fitted.model, data.poses, testable)
    scored, invisible = score_all(found, on, weight, progress)
    ranked = sorted(scored, key=lambda s: s.alone.rms)
    path = path_of(ranked, on, progress)
    turns = response.slots[list(response.rest.model.chain.joint_slots)]
    free = free_structure(path, on, turns, data, fitted, weight)
    left = structure(data.poses.q, on.residual, on.basis)
    floor = noise_floor(data)
    named = [s for s in path if s.name not in free.borrowed]
    return Diagnosis(
        fit=fitted,
        data=data,
        floor=floor,
        structure=left,
        verdict=_verdict(named, free.functions, left, floor, fitted.sigma),
        before=on.explain().held_out,
        scored=tuple(_in_order(ranked, path)),
        adjusted=benjamini_yekutieli({s.name: s.p_value for s in ranked}),
        path=tuple(path),
        borrowed=free.borrowed,
        rivals={s.name: rivals_of(s, path, ranked, on) for s in path},
        free=free.functions,
        anatomy=free.anatomy,
        not_testable=(*((effect, why) for effect, why in refused), *invisible),
        turns=turns,
    )


def _weights(data: Measurements) -> Array:
    """(3 N, 1), relative weight of each row, of mean square near one."""
    if data.sd is None:
        return np.ones((3 * len(data), 1))
    return np.repeat(np.sqrt(np.mean(data.sd**2)) / data.sd, 3)[:, None]


def _bench(fitted: Fit, data: Measurements, weight: Array) -> Bench:
    keys = [key for key in fitted.model.free if key not in fitted.at_bound]
    typical = np.array([fitted.model.parameters[fitted.model.position(key)].typical for key in keys])
    columns = (parameter_jacobian(fitted.rest, keys) * typical).reshape(-1, len(keys))
    fold = blocks(data.poses.q, data.repeat_of)
    poses = [np.flatnonzero(fold == number) for number in range(fold.max() + 1)]
    return bench(columns * weight, fitted.residual.reshape(-1) * weight[:, 0], poses, fitted.sigma)


def _in_order(ranked: Sequence[Scored], path: Sequence[Scored]) -> list[Scored]:
    return [*path, *(one for one in ranked if one not in path)]


def _verdict(
    named: Sequence[Scored], free: Sequence[FreeFunction], left: Structure, floor: Floor, sigma: float
) -> Literal["effect_missing", "nothing_missing", "unexplained_structure"]:
    if named:
        return "effect_missing"
    if free:
        return "unexplained_structure"
    structured = left.p_value < SIGNIFICANT or left.order_p_value < SIGNIFICANT
    matters = left.moran_i > ALIKE if floor.sd is None else sigma > ABOVE_FLOOR * floor.sd
    return "unexplained_structure" if structured and matters else "nothing_missing"


def _outliers(diagnosis: Diagnosis) -> list[int]:
    """Rows that stick out twice as far as an outlier of a fit does, with the best single candidate and without it.

    Farther, because an effect that is still missing may make whole groups of poses stick out.
    """
    distance = np.sqrt(diagnosis.before)
    best = min(diagnosis.scored, key=lambda one: one.alone.rms, default=None)
    if best is not None:
        distance = np.minimum(distance, np.sqrt(best.alone.held_out))
    rows = np.flatnonzero(distance > 2 * OUTLIER_DISTANCE * robust_scale(distance))
    return [int(row) for row in rows]
