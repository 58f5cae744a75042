"""Advice: the next poses that distinguish the candidate causes of an error, tried before anybody measures them.

Poses are proposed from the least effort on: a few at any angles, then with a second load, then more; where a cause
follows time, half of them are held for a while (`lrm_ident.design.pose_design`). They are tried by the lead that is
expected of the true cause (`lrm_ident.design.expected_lead`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from lrm_ident.design.candidate_poses import ClearanceRules, floor_above_table, random_poses
from lrm_ident.design.expected_lead import CandidateCause, CausePair, as_measured, cause_columns, expected
from lrm_ident.design.pose_design import (
    CandidateSet,
    DesignProblem,
    Indistinguishable,
    PoseDesign,
    beside,
    design,
    tried,
)
from lrm_ident.diagnosis.screening.candidates import unfitted_rows
from lrm_ident.fitting.parameter_sets import fittable
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model

COUNTS = (40, 80)
"""Poses that are proposed."""
OFFERED = 200
"""Random poses that they are chosen from, with each load."""
SECOND_LOAD_KG = 0.1
"""Of an arm that was measured without a load only."""


@dataclass(frozen=True, eq=False)
class MeasuringPlan:
    """Poses to measure, in this order, with some loads (kg); `hold`: s before the reading of half of them, 0: none."""

    poses: Poses
    loads: tuple[float, ...]
    hold: float


@dataclass(frozen=True, eq=False)
class Advice:
    """The plan that distinguishes causes, or the best one where none does; `pairs` are expected with it."""

    plan: MeasuringPlan | None
    pairs: tuple[CausePair, ...]

    @property
    def alike(self) -> tuple[CausePair, ...]:
        """Pairs that no plan tells apart, exact formulas or not, the worst first."""
        return tuple(
            sorted((pair for pair in self.pairs if not pair.distinguishable_if_exact), key=lambda pair: pair.lead)
        )

    @property
    def works(self) -> bool:
        """Whether the plan tells all of them apart; if their formulas are exact."""
        return self.plan is not None and not self.alike

    @property
    def helps(self) -> bool:
        """Whether the plan tells the first cause, or another, from some of them."""
        return any(frozenset((p.there, p.instead)) not in self._together for p in self.pairs)

    @property
    def _together(self) -> set[frozenset[str]]:
        return {frozenset((pair.there, pair.instead)) for pair in self.alike}


class IndistinguishableByOffer(Indistinguishable):
    """The candidates do not tell the rivals apart; `advice`: on others."""

    def __init__(self, words: str, advice: Advice) -> None:
        super().__init__(words)
        self.advice = advice


def advise(
    model: Model,
    causes: Sequence[CandidateCause],
    measured: Poses | None,
    noise: float,
    seed: int = 0,
    most: int = COUNTS[-1],
) -> Advice:
    """The first plan that tells all causes apart, together with the poses measured already; else the best.

    Args:
        model: without the causes; its free parameters are fitted beside them. noise: m per axis.
        most: poses that a plan may have.
    """
    best = Advice(None, ())
    for count, kilograms in _recipes(measured, most):
        if count > COUNTS[0] and any(pair.cosine > EQUIVALENCE_COSINE for pair in best.alike):
            break  # more poses of the same kind do not change how alike two motions are
        advice = _advice(model, causes, measured, noise, seed, count, kilograms)
        if advice is None:
            continue
        if advice.works:
            return advice
        if best.plan is None or _least(advice.pairs) > _least(best.pairs):
            best = advice
    return best


def advise_beside(model: Model, present: Effect, rivals: Sequence[Effect], measured: Poses, noise: float) -> Advice:
    """The advice on an effect that the model has, and others that fitted as well in its place.

    Each of the others has the shape and the size at which it moves the tip most like it, beside what the other
    parameters make up for (least squares). `noise`: m per axis.
    """
    without = model.with_free([key for key in model.free if key not in present.keys])
    values = dict(zip(present.parameters, map(model.value, present.keys), strict=True))
    shape = tuple(0.0 if parameter.fixed is None else value for parameter, value in values.items())
    size = np.array([value / parameter.typical for parameter, value in values.items() if parameter.fixed is None])
    present_cause = CandidateCause(present, unfitted_rows(present, without.free), size, shape)
    alike = [CandidateCause.typical(effect, without.free) for effect in rivals]
    columns_of = cause_columns(without, [present_cause, *alike], [measured], noise)
    motion = columns_of.left(columns_of.columns[0][0] @ size[:, None])[:, 0]
    fitted = [
        min((_like(motion, columns_of.left(column)) for column in shapes), key=itemgetter(1))
        for shapes in columns_of.columns[1:]
    ]
    sized = [replace(cause, size=theta) for cause, (theta, _) in zip(alike, fitted, strict=True)]
    return advise(without, (present_cause, *sized), measured, noise)


def _like(motion: Array, columns: Array) -> tuple[Array, float]:
    """Sizes of columns (R, m) that come nearest to a motion (R,), and the square of what they leave."""
    theta: Array = np.linalg.lstsq(columns, motion, rcond=None)[0].astype(np.float64)
    return theta, float(np.sum((motion - columns @ theta) ** 2))


def next_poses(
    problem: DesignProblem,
    candidates: CandidateSet,
    progress: OnProgress = silent,
    executor: Executor | None = None,
) -> PoseDesign:
    """The design of some candidates, its rivals tried by simulation.

    Raises `LrmError`: no design; `IndistinguishableByOffer`: the candidates cannot tell the rivals apart.
    """
    try:
        return tried(problem, design(problem, candidates.poses, progress, executor))
    except Indistinguishable as error:
        keys = beside(problem, problem.keys or fittable(problem.model))
        model = problem.model.with_free(keys)
        advice = advise(model, problem.likely(keys), problem.measured, problem.noise, problem.seed)
        raise IndistinguishableByOffer(str(error), advice) from None


def _least(pairs: Sequence[CausePair]) -> tuple[int, float]:
    return -sum(not pair.distinguishable_if_exact for pair in pairs), min((pair.lead for pair in pairs), default=0.0)


def _recipes(measured: Poses | None, most: int) -> Iterator[tuple[int, tuple[float, ...]]]:
    """Numbers of poses and loads (kg) of plans, from the least effort on."""
    before = np.zeros(1) if measured is None else np.unique(np.round(measured.payload, 4))
    loads = [tuple(before.tolist())]
    if len(before) == 1:
        loads.append((0.0, float(before[0]) or SECOND_LOAD_KG))
    return ((count, kilograms) for count in COUNTS if count <= most for kilograms in loads)


def _advice(
    model: Model,
    causes: Sequence[CandidateCause],
    measured: Poses | None,
    noise: float,
    seed: int,
    count: int,
    kilograms: tuple[float, ...],
) -> Advice | None:
    """The best `count` poses of random ones with some loads, as if they were measured now, at random where a design is
    not possible; None where too few keep clear."""
    offered = random_poses(model.arm, OFFERED, ClearanceRules(floor=floor_above_table(model.arm)), seed)
    if len(offered) * len(kilograms) < count:
        return None
    every = Poses(np.tile(offered, (len(kilograms), 1)), np.repeat(kilograms, len(offered)))
    rivals = tuple(cause.effect for cause in causes)
    problem = DesignProblem(model, model.free, rivals, count, "O1", noise, measured, 0, 1, seed, causes=tuple(causes))
    hold = 0.0
    try:
        designed = design(problem, every)
        poses, pairs = as_measured(designed.poses, measured, designed.hold), designed.pairs
        hold = designed.dwell
    except LrmError:
        rng = np.random.default_rng(seed)
        poses = as_measured(every.take(rng.choice(len(every), count, replace=False)), measured)
        pairs = expected(model, causes, [poses] if measured is None else [measured, poses], noise)
    return Advice(MeasuringPlan(poses, kilograms, hold), pairs)
