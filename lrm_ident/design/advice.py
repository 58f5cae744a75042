"""Advice: the next poses that distinguish the candidate causes of an error, tried before anybody measures them.

Poses are proposed from the least effort on: a few at any angles, then with a second load, then more. They are tried: if
one cause is there, by how many standard errors will it beat each other one, everything refitted? With a motion δ that
the other cause cannot imitate, squared errors differ by |δ|² with a standard deviation of 2 σ |δ|: so by |δ| / 2 σ
standard errors (Vuong 1989; Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from lrm_ident.design.candidate_poses import ClearanceRules, floor_above_table, random_poses
from lrm_ident.design.observability import MM_PER_M, identification_jacobian
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.diagnosis.screening.candidates import differentiate_candidates, unfitted_rows
from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis, principal_cosine
from lrm_ident.diagnosis.screening.linearised_fit import PRIOR_SD
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import FREE_FORMS, Effect
from lrm_math.errors import LrmError
from lrm_math.kinematics.history import PACE_S, history_of
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium, with_borne_loads
from lrm_math.model.model import Model

NEEDED = Z_THRESHOLD + 1.2816
"""Standard errors to be expected: then nine in ten measurements show the `Z_THRESHOLD` that a name needs."""
COUNTS = (40, 80)
"""Poses that are proposed."""
OFFERED = 300
"""Random poses that they are chosen from, with each load."""
NO_MOTION = 1e-9
"""m: round-off."""
MOST_SHAPES = 12
"""Of a cause that another might stand in for: a bound on time."""
SECOND_LOAD_KG = 0.1
"""Of an arm that was measured without a load only."""


@dataclass(frozen=True, eq=False)
class CandidateCause:
    """A candidate cause: its parameters that are not fitted (`rows`), in typical sizes (m,), and the shape found."""

    effect: Effect
    rows: tuple[int, ...]
    size: Array
    shape: tuple[float, ...] | None = None

    @classmethod
    def found(cls, scored: ScoredCandidate, motion: float) -> CandidateCause:
        """One as a screening estimates it alone, as large as if it made all the motion that is to be explained (m, the
        root of the sum of squares): an estimate of what explains little alone is too small."""
        share = motion / max(float(np.linalg.norm(scored.added)), NO_MOTION)
        return cls(scored.candidate.effect, scored.candidate.rows, scored.alone.theta * share, scored.shape)

    @classmethod
    def typical(cls, effect: Effect, fitted: Sequence[str]) -> CandidateCause:
        """One of typical size."""
        rows = unfitted_rows(effect, fitted)
        return cls(effect, rows, np.ones(len(rows)))


@dataclass(frozen=True, eq=False)
class MeasuringPlan:
    """Poses to measure, in this order: `poses`, in words `how`, and as options of `design`."""

    poses: Poses
    how: str
    options: str


@dataclass(frozen=True)
class CausePair:
    """Two causes on some poses.

    lead: standard errors by which the first, if it is there, beats the second at the shape that imitates it best.
    cosine: of their motions then; a diagnosis calls them alike if it is large, whatever the errors.
    one_form: whether a free form refines both. Where that form fits better, their formulas tell nothing.
    """

    there: str
    instead: str
    lead: float
    cosine: float
    one_form: bool = False

    @property
    def told(self) -> bool:
        """Whether the data will tell them apart."""
        return self.lead >= NEEDED and self.cosine <= EQUIVALENCE_COSINE


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
    for plan in _plans(model, causes, measured, noise, seed, most):
        found = Advice(
            plan, expected(model, causes, [plan.poses] if measured is None else [measured, plan.poses], noise)
        )
        if found.works:
            return found
        if best.plan is None or _least(found) > _least(best):
            best = found
    return best


def _least(advice: Advice) -> tuple[int, float]:
    return -len(advice.alike), min(pair.lead for pair in advice.pairs)


def expected(
    model: Model, causes: Sequence[CandidateCause], parts: Sequence[Poses], noise: float
) -> tuple[CausePair, ...]:
    """Every cause beside every other one, on all poses of the parts. `noise`: m per axis."""
    columns = [_columns(model, causes, part) for part in parts]
    fitted = np.concatenate([own for own, _ in columns])
    each = [
        [np.concatenate(shape) for shape in zip(*several, strict=True)]
        for several in zip(*(c for _, c in columns), strict=True)
    ]
    ridge = noise / PRIOR_SD
    known = orthonormal_basis(np.concatenate([fitted, ridge * np.eye(fitted.shape[1])]))

    def left(motion: Array) -> Array:
        padded = np.concatenate([motion, np.zeros((len(known) - len(motion), motion.shape[1]))])
        return np.asarray(padded - known @ (known.T @ padded))

    own = [[left(shape) for shape in shapes] for shapes in each]
    found = []
    for (a, one), (b, other) in permutations(enumerate(causes), 2):
        motion = own[a][0] @ one.size
        apart, best = min((_distance(motion, columns), k) for k, columns in enumerate(own[b]))
        cosine = principal_cosine(own[a][0], own[b][best])
        names = one.effect.name, other.effect.name
        found.append(CausePair(*names, apart / (2.0 * noise), cosine, _share_a_form(one.effect, other.effect)))
    return tuple(found)


def _share_a_form(one: Effect, other: Effect) -> bool:
    ids = {one.id, other.id}
    return one.place == other.place and len(ids) == 2 and any(ids <= {*form.variant_of} for form in FREE_FORMS)


def _distance(motion: Array, columns: Array) -> float:
    basis = orthonormal_basis(columns)
    return float(np.linalg.norm(motion - basis @ (basis.T @ motion)))


def _columns(model: Model, causes: Sequence[CandidateCause], poses: Poses) -> tuple[Array, list[list[Array]]]:
    """(3 N, P) of the fitted parameters, and of each cause (3 N, m) at its shape and at others (m per typical size)."""
    settled = solve_equilibrium(model, with_borne_loads(model, poses))
    fitted = identification_jacobian(settled, model.free).reshape(3 * len(poses), -1) / MM_PER_M
    candidates = differentiate_candidates(settled, [(cause.effect, cause.rows) for cause in causes])[1]
    out = []
    for cause, candidate in zip(causes, candidates, strict=True):
        shapes = [] if cause.shape is None else [cause.shape]
        shapes += [shape for shape in candidate.shapes if shape not in shapes][: MOST_SHAPES - len(shapes)]
        out.append([candidate.columns(shape) for shape in shapes])
    return fitted, out


def _plans(
    model: Model, causes: Sequence[CandidateCause], measured: Poses | None, noise: float, seed: int, most: int
) -> Iterator[MeasuringPlan]:
    """Plans, from the least effort on. A plan that cannot be made is left out."""
    before = np.zeros(1) if measured is None else np.unique(np.round(measured.payload, 4))
    loads = [tuple(before.tolist())]
    if len(before) == 1:
        loads.append((0.0, float(before[0]) or SECOND_LOAD_KG))
    for count in (count for count in COUNTS if count <= most):
        for kilograms in loads:
            offered = random_poses(model.arm, OFFERED, ClearanceRules(floor=floor_above_table(model.arm)), seed)
            if len(offered) * len(kilograms) < count:
                continue
            every = Poses(np.tile(offered, (len(kilograms), 1)), np.repeat(kilograms, len(offered)))
            grams = ",".join(f"{1e3 * load:g}" for load in kilograms)
            carrying = "without a load" if kilograms == (0.0,) else f"with {' and '.join(grams.split(','))} g"
            how = f"{count} poses at any angles, {carrying}, each joint coming from both sides, in random order"
            yield MeasuringPlan(
                _chosen(model, causes, every, measured, noise, count, seed),
                how,
                f"--levels any --loads-g {grams} -n {count}",
            )


def _chosen(
    model: Model,
    causes: Sequence[CandidateCause],
    every: Poses,
    measured: Poses | None,
    noise: float,
    count: int,
    seed: int,
) -> Poses:
    """`count` poses by design, at random where a design is not possible; as if they were measured now."""
    rivals = tuple(cause.effect for cause in causes)
    problem = DesignProblem(model, model.free, rivals, count, "O1", noise, measured, 0, 1, seed)
    try:
        chosen = design(problem, every).poses
    except LrmError:
        rng = np.random.default_rng(seed)
        chosen = every.take(rng.choice(len(every), count, replace=False))
    return as_measured(chosen, measured)


def as_measured(poses: Poses, after: Poses | None) -> Poses:
    """Poses with the order, times and session that they have if they are measured in turn, `after` others."""
    number = np.arange(len(poses)) + 1 + (0 if after is None else max(after.names(np.arange(len(after))), default=0))
    timed = after is None or after.t is not None
    begun = 0.0 if after is None or after.t is None else float(np.max(after.t))
    t: Array | None = np.asarray(begun + PACE_S * (1.0 + np.arange(len(poses)))) if timed else None
    session = None if after is None or after.session is None else np.full(len(poses), 1.0 + float(after.session.max()))
    moves, states = recorded(poses.q, None)
    sides = moves if poses.direction is None else poses.direction
    return replace(
        poses,
        direction=sides,
        friction=states if poses.direction is None else None,
        number=number,
        t=t,
        running=None if t is None else t - t[0],
        session=session,
        history=history_of(poses.q, poses.payload, t, session, number),
    )
