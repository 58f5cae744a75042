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
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from lrm_ident.candidates import Candidate, candidates, split_testable
from lrm_ident.dataset import Measurements
from lrm_ident.fit import Fit, fit
from lrm_ident.flexible import FreeFunction, product_functions, quantities, single_functions
from lrm_ident.folds import blocks
from lrm_ident.linear import Bench, Explained, Prepared, bench, coincidence, paired, rank_of
from lrm_ident.progress import Tick, silent
from lrm_ident.structure import Floor, Structure, noise_floor, structure
from lrm_math.derivatives import parameter_jacobian
from lrm_math.effects import CATALOGUE, Effect
from lrm_math.model import Model

Array = NDArray[np.float64]

SIGNIFICANT = 0.01  # p value after Benjamini and Yekutieli, of all candidates together
SURE = 2.0  # standard errors by which one prediction must beat another to be told from it
WORTHWHILE = 0.02  # part of the held-out RMS that an effect must save to be worth naming
MATERIAL = 0.10  # part of the held-out RMS that a free function must save to be structure without a name
COINCIDE = 0.95  # principal cosine above which two effects are one and the same to the data
VISIBLE = 3.0  # times the noise that a typical size must move all TCPs together to be testable
ABOVE_FLOOR, ALIKE = 1.15, 0.1  # residual over floor, and Moran's I, above which structure matters
MOST_EFFECTS, MOST_FREE = 8, 3


@dataclass(frozen=True, eq=False)
class Scored:
    """A candidate at its best shape, alone on the residual.

    Attributes:
        columns: (3 N, m) of typical sizes, in m. p_value: after the scan over shapes, before Benjamini and Yekutieli.
        implausible: why its estimate cannot be, or empty.
    """

    candidate: Candidate
    shape: int
    columns: Array
    prepared: Prepared
    alone: Explained
    p_value: float
    implausible: str

    @property
    def name(self) -> str:
        """`effect@place`."""
        return self.candidate.name

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.columns.shape[1])


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
    scored, invisible = _score_all(found, on, weight, progress)
    ranked = sorted(scored, key=lambda s: s.alone.rms)
    path = _path(ranked, on, progress)
    turns = response.slots[list(response.rest.model.chain.joint_slots)]
    free = _look_for_free_structure(path, on, turns, data, fitted, weight)
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
        adjusted=_benjamini_yekutieli({s.name: s.p_value for s in ranked}),
        path=tuple(path),
        borrowed=free.borrowed,
        rivals={s.name: _rivals(s, path, ranked, on) for s in path},
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


def _score_all(
    found: Sequence[Candidate], on: Bench, weight: Array, progress: Tick
) -> tuple[list[Scored], list[tuple[Effect, str]]]:
    scored, invisible = [], []
    for number, candidate in enumerate(found):
        best = _score(candidate, on, weight)
        if isinstance(best, str):
            invisible.append((candidate.effect, best))
        else:
            scored.append(best)
        progress(number + 1, 2 * len(found))
    return scored, invisible


def _score(candidate: Candidate, on: Bench, weight: Array) -> Scored | str:
    """The candidate at the shape that explains most, or why it cannot show."""
    tried = []
    for number, raw in enumerate(candidate.columns):
        columns = raw * weight
        prepared = on.prepare(columns)
        tried.append((on.explain(prepared), number, columns, prepared))
    alone, shape, columns, prepared = min(tried, key=lambda one: one[0].in_sample)
    moved = float(np.linalg.norm(prepared.inside))
    rank = rank_of(prepared.inside, columns)
    if rank == 0 or moved < VISIBLE * on.sigma:
        beyond = moved / np.sqrt(len(on.residual) / 3) * 1e3
        return f"a typical size moves the TCP by only {beyond:.2g} mm beyond what the fitted parameters already explain"
    p_value = _p_value(on.explain().in_sample, alone.in_sample, rank, on.freedom)
    return Scored(
        candidate, shape, columns, prepared, alone, min(1.0, p_value * len(tried)), _implausible(candidate, alone)
    )


def _p_value(before: float, after: float, rank: int, freedom: int) -> float:
    """F test of `rank` further parameters."""
    rest = max(freedom - rank, 1)
    return float(f_distribution.sf((before - after) / rank / (after / rest), rank, rest)) if after > 0 else 0.0


def _implausible(candidate: Candidate, alone: Explained) -> str:
    for parameter, theta, error in zip(candidate.parameters, alone.theta, alone.error, strict=True):
        below, above = theta + SURE * error < parameter.lower, theta - SURE * error > parameter.upper
        if below or above:
            return f"{parameter.name} would have to be {theta * parameter.typical / parameter.si:.3g}, against physics"
    return ""


def _benjamini_yekutieli(p_values: dict[str, float]) -> dict[str, float]:
    """p values that allow for the number of candidates under any dependence (Benjamini & Yekutieli 2001)."""
    m = len(p_values)
    factor = m * sum(1.0 / k for k in range(1, m + 1))
    adjusted, smallest = {}, 1.0
    for rank, name in reversed(list(enumerate(sorted(p_values, key=lambda name: p_values[name]), start=1))):
        smallest = min(smallest, p_values[name] * factor / rank)
        adjusted[name] = smallest
    return adjusted


def _path(ranked: Sequence[Scored], on: Bench, progress: Tick) -> list[Scored]:
    """Effects taken one after the other as long as one is significant, plausible, and predicts better."""
    path: list[Scored] = []
    now = start = on.explain()
    harmonic = len(ranked) * sum(1.0 / k for k in range(1, len(ranked) + 1))
    while len(path) < MOST_EFFECTS:
        taken = [one.prepared for one in path]
        choices = []
        for one in ranked:
            if one not in path and not one.implausible:
                then = on.explain(*taken, one.prepared)
                p_value = _p_value(now.in_sample, then.in_sample, one.size, on.freedom - sum(s.size for s in path))
                if p_value * harmonic * len(one.candidate.columns) < SIGNIFICANT and _helps(then, now, start):
                    choices.append((then, one))
        progress(1 + len(path), MOST_EFFECTS)
        if not choices:
            break
        best = min(choices, key=lambda choice: choice[0].rms)[0]
        near = [choice for choice in choices if paired(best.held_out, choice[0].held_out) < 1.0]
        now, simplest = min(near, key=lambda choice: (choice[1].size, choice[0].rms))
        path.append(simplest)
    return path


def _helps(then: Explained, now: Explained, start: Explained) -> bool:
    """Whether the prediction surely gets better, and by more than linearisation at the start may pretend."""
    gain = now.held_out.mean() - then.held_out.mean()
    enough = 1.0 - (1.0 - WORTHWHILE) ** 2
    return bool(gain > enough * start.held_out.mean()) and paired(then.held_out, now.held_out) > SURE


def _in_order(ranked: Sequence[Scored], path: Sequence[Scored]) -> list[Scored]:
    return [*path, *(one for one in ranked if one not in path)]


def _rivals(one: Scored, path: Sequence[Scored], ranked: Sequence[Scored], on: Bench) -> tuple[str, ...]:
    """Candidates that, in its place, could not be told from it."""
    others = [other.prepared for other in path[: path.index(one)]]
    without, with_it = on.explain(*others), on.explain(*others, one.prepared)
    gain = float(without.held_out.mean() - with_it.held_out.mean())
    rivals = []
    for rival in ranked:
        if rival is one or rival.implausible:
            continue
        instead = on.explain(*others, rival.prepared)
        much = float(without.held_out.mean() - instead.held_out.mean()) > 0.5 * gain
        if much and (
            paired(with_it.held_out, instead.held_out) < SURE
            or coincidence(one.prepared.inside, rival.prepared.inside) > COINCIDE
        ):
            rivals.append(rival.name)
    return tuple(rivals)


@dataclass(frozen=True, eq=False)
class _Free:
    """What free functions say of what the path leaves."""

    functions: tuple[FreeFunction, ...]
    borrowed: dict[str, str]
    anatomy: tuple[tuple[FreeFunction, float], ...]


def _look_for_free_structure(
    path: Sequence[Scored], on: Bench, turns: Array, data: Measurements, fitted: Fit, weight: Array
) -> _Free:
    """Nameless functions that explain much of what the path leaves, whom of the path they replace, and the anatomy."""
    shared, own = quantities(data, fitted.rest.joint_torque)
    functions = [*single_functions(turns, shared, own), *product_functions(turns, shared, own)]
    ready = [(function, on.prepare(function.columns * weight)) for function in functions]
    tried = sorted(
        ((on.explain(*(one.prepared for one in path), prepared).rms, function) for function, prepared in ready),
        key=lambda one: one[0],
    )
    anatomy = tuple((function, rms) for rms, function in tried[:5])
    nameless = [(function, prepared) for function, prepared in ready if not function.has_a_name]
    free = _free_path([one.prepared for one in path], nameless, on)
    borrowed: dict[str, str] = {}
    if free:
        follows = {name for function, _ in free for name in function.follows}
        joints = {function.joint for function, _ in free}
        beside = [p for f, p in ready if len(f.follows) == 1 and f.joint in joints and f.follows[0] in follows]
        among = [*(prepared for _, prepared in free), *beside]
        for one in path:
            others = [other.prepared for other in path if other is not one]
            without, with_it = on.explain(*others, *among), on.explain(*others, one.prepared, *among)
            if not _helps(with_it, without, on.explain()):
                borrowed[one.name] = free[0][0].name
    return _Free(tuple(function for function, _ in free), borrowed, anatomy)


def _free_path(
    taken: Sequence[Prepared], nameless: Sequence[tuple[FreeFunction, Prepared]], on: Bench
) -> list[tuple[FreeFunction, Prepared]]:
    """Free functions taken one after the other as long as one is material, all at the joint of the first."""
    chosen: list[tuple[FreeFunction, Prepared]] = []
    now = on.explain(*taken)
    while len(chosen) < MOST_FREE:
        left = [one for one in nameless if not chosen or one[0].joint == chosen[0][0].joint]
        tried = [(on.explain(*taken, *(p for _, p in chosen), one[1]), one) for one in left if one not in chosen]
        then, best = min(tried, key=lambda pair: pair[0].rms)
        if then.rms > (1.0 - MATERIAL) * now.rms or paired(then.held_out, now.held_out) < SURE:
            break
        chosen.append(best)
        now = then
    return chosen


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
    """Rows that stick out even of what everything named and free together leaves."""
    from lrm_ident.fit import OUTLIER_DISTANCE
    from lrm_ident.loss import robust_scale

    distance = np.sqrt(diagnosis.before)
    best = min(diagnosis.scored, key=lambda one: one.alone.rms, default=None)
    if best is not None:
        distance = np.minimum(distance, np.sqrt(best.alone.held_out))
    rows = np.flatnonzero(distance > 2 * OUTLIER_DISTANCE * robust_scale(distance))
    return [int(row) for row in rows]
