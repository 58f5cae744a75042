"""Advice: the next poses that distinguish the candidate causes of an error, tried before anybody measures them.

Poses are proposed from the least effort on: a few at any angles, then with a second load, then more; where a cause
follows time, half of them are held for a while (`lrm_ident.design.pose_design`). They are tried by the lead that is
expected of the true cause (`lrm_ident.design.expected_lead`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from lrm_ident.design.candidate_poses import ClearanceRules, floor_above_table, random_poses
from lrm_ident.design.expected_lead import NEEDED, CandidateCause, CausePair, as_measured, expected
from lrm_ident.design.pose_design import (
    CandidateSet,
    DesignProblem,
    Indistinguishable,
    PoseDesign,
    beside,
    design,
    tried,
)
from lrm_ident.fitting.parameter_sets import fittable
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE, Z_THRESHOLD
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
    """Poses to measure, in this order: `poses`, in words `how`, and as options of `design`."""

    poses: Poses
    how: str
    options: str


@dataclass(frozen=True, eq=False)
class Advice:
    """The plan that distinguishes causes, or the best one where none does; `pairs` are expected with it."""

    plan: MeasuringPlan | None
    pairs: tuple[CausePair, ...]

    @property
    def alike(self) -> tuple[CausePair, ...]:
        """Pairs that no plan tells apart, the worst first."""
        return tuple(sorted((pair for pair in self.pairs if not pair.told), key=lambda pair: pair.lead))

    @property
    def works(self) -> bool:
        """Whether the plan tells all of them apart."""
        return self.plan is not None and not self.alike

    @property
    def helps(self) -> bool:
        """Whether the plan tells the first cause, or another, from some of them."""
        return any(frozenset((p.there, p.instead)) not in self._together for p in self.pairs)

    @property
    def _together(self) -> set[frozenset[str]]:
        return {frozenset((pair.there, pair.instead)) for pair in self.alike}

    @property
    def _provided(self) -> str:
        alike = next((pair for pair in self.pairs if pair.told and pair.one_form), None)
        return "" if alike is None else f", if the formula of {alike.there} or {alike.instead} is exact"

    @property
    def sentence(self) -> str:
        """What to measure and what it will tell; or that nothing will, and why."""
        if self.plan is None:
            return "No pose that keeps clear was found, so no poses can be proposed."
        if self.works:
            least = min(pair.lead for pair in self.pairs)
            return (
                f"{self.plan.how}, distinguish them: the true cause is expected to lead by {least:.1f} standard errors "
                f"or more ({Z_THRESHOLD:g} are needed){self._provided}."
            )
        worst = self.alike[0]
        why = (
            f"they move the tip alike (cosine {worst.cosine:.2f})"
            if worst.cosine > EQUIVALENCE_COSINE
            else f"it would lead by {worst.lead:.1f} standard errors, and {NEEDED:.1f} must be expected"
        )
        none = f"No poses tried can distinguish {worst.there} from {worst.instead}: {why}"
        return f"{none}; {self.plan.how}, distinguish the others." if self.helps else f"{none}, with {self.plan.how}."


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
        found = _advice(model, causes, measured, noise, seed, count, kilograms)
        if found is None:
            continue
        if found.works:
            return found
        if best.plan is None or _least(found.pairs) > _least(best.pairs):
            best = found
    return best


def next_poses(
    problem: DesignProblem,
    candidates: CandidateSet,
    progress: OnProgress = silent,
    executor: Executor | None = None,
) -> PoseDesign:
    """The design of some candidates, its rivals tried by simulation.

    Raises `LrmError`: no design; where the candidates cannot tell the rivals apart, with the advice on others.
    """
    try:
        return tried(problem, design(problem, candidates.poses, progress, executor))
    except Indistinguishable as error:
        keys = beside(problem, problem.keys or fittable(problem.model))
        model = problem.model.with_free(keys)
        advice = advise(model, problem.likely(keys), problem.measured, problem.noise, problem.seed)
        offer_words = f" (--separate … {advice.plan.options})" if advice.plan and advice.helps else ""
        raise Indistinguishable(f"{error}. {advice.sentence}{offer_words}") from None


def _least(pairs: Sequence[CausePair]) -> tuple[int, float]:
    return -sum(not pair.told for pair in pairs), min((pair.lead for pair in pairs), default=0.0)


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
    waiting = ""
    try:
        found = design(problem, every)
        poses, pairs = as_measured(found.poses, measured, found.hold), found.pairs
        if found.dwell:
            waiting = f", half of them held for {found.dwell:g} s before the reading"
    except LrmError:
        rng = np.random.default_rng(seed)
        poses = as_measured(every.take(rng.choice(len(every), count, replace=False)), measured)
        pairs = expected(model, causes, [poses] if measured is None else [measured, poses], noise)
    grams = ",".join(f"{1e3 * load:g}" for load in kilograms)
    carrying = "without a load" if kilograms == (0.0,) else f"with {' and '.join(grams.split(','))} g"
    how = f"{count} poses at any angles, {carrying}, each joint coming from both sides, in random order{waiting}"
    return Advice(MeasuringPlan(poses, how, f"--levels any --loads-g {grams} -n {count}"), pairs)
