"""Experiment design: the next poses to measure, D-optimal for parameters, Ds-optimal to discriminate rival effects.

Effects that follow time or what the arm bore before do not show at single poses. For these the order of the poses is
random, and the arm holds half of the poses for a dwell time before the reading: the shortest one with which the rivals
are expected to be told apart. Fedorov 1972, Theory of Optimal Experiments; Atkinson & Donev 1992.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import PLAIN, Whitening
from lrm_ident.design.detmax import check_count, maximise_criterion
from lrm_ident.design.discrimination import (
    Discrimination,
    Rival,
    UnsuitableRival,
    check_testable,
    discrimination_of,
    rival_columns,
)
from lrm_ident.design.expected_lead import CandidateCause, CausePair, as_measured, expected, told_in_trials
from lrm_ident.design.fisher_information import RankDeficient, Rows, whiten
from lrm_ident.design.observability import MM_PER_M, Index, Observability, identification_jacobian, observability
from lrm_ident.design.optimality import Criterion, DeterminantCriterion, criterion_of
from lrm_ident.diagnosis.screening.candidates import unfitted_rows
from lrm_ident.diagnosis.screening.linearised_fit import PRIOR_SD
from lrm_ident.fitting.identifiability import select_identifiable
from lrm_ident.fitting.parameter_sets import fittable
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arm.arm import Arm, feasible_approach
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.covariance import Covariance
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

RANDOM_DRAWS, STARTS = 20, 4
RIVAL_SHARE = 0.5  # of the criterion
SIDE_POSES = 20  # at which to check whether the side of approach matters
DWELLS_S = (0.0, 30.0, 120.0, 480.0)
"""Dwell times that are tried, where a rival follows time: the shortest which tells the rivals apart is taken."""


class Indistinguishable(LrmError):
    """The candidates do not tell the rivals apart, whichever are chosen."""


@dataclass(frozen=True, eq=False)
class ExpectedAccuracy:
    """Expected accuracy of a fit to a set of poses, from the covariance of its parameters.

    Attributes:
        standard_errors: (P,), of each parameter, as the RMS motion of the TCP over the candidates that it stands for
            (mm). The prior of a parameter has a standard deviation of three typical sizes.
        tcp: RMS over the candidates of the expected distance error of the predicted TCP (mm).
        discrimination: between the rivals, None if none are named.
    """

    standard_errors: Array
    tcp: float
    discrimination: Discrimination | None

    @property
    def rivals(self) -> tuple[Rival, ...]:
        """What is expected of each rival; none if none are named."""
        return () if self.discrimination is None else self.discrimination.rivals


@dataclass(frozen=True, eq=False)
class PoseDesign:
    """Poses to measure, in the order to measure them.

    Attributes:
        poses: every row's angles, load, and side of approach. number: (R,). repeat_of: (R,), its own number if none.
        rows: (n,), the candidates chosen. keys: the parameters that the poses are chosen for.
        observability: of the chosen poses alone; random_baseline: medians of as many random poses.
        before: expected from the poses measured already, None if there are none. after: with the new poses.
        random_after: the same with random poses: the median draw by detectable size of the rivals, or by `tcp`.
        hold: (R,), how long the arm stands at each before it is measured (s), beside the usual pace.
        pairs: expectation of every rival of the size that it is thought to have beside every other one. trials: how
            many of `TRIALS` simulated measurements tell the first of two from the second, by their names.
    """

    poses: Poses
    number: NDArray[np.int64]
    repeat_of: NDArray[np.int64]
    rows: Rows
    keys: tuple[str, ...]
    observability: Observability
    random_baseline: Observability
    before: ExpectedAccuracy | None
    after: ExpectedAccuracy
    random_after: ExpectedAccuracy
    hold: Array
    pairs: tuple[CausePair, ...] = ()
    trials: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @property
    def distinguishable(self) -> bool:
        """Whether every rival is expected to be told from every other one, if its formula is exact."""
        return all(pair.distinguishable_if_exact for pair in self.pairs)

    @property
    def dwell(self) -> float:
        """How long the arm holds half of the poses (s); 0: none."""
        return float(self.hold.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class ClearAngles:
    """Origin of candidate poses.

    Attributes:
        clear: angles that keep the rules, of those `tried`. random: whether they are random, no combinations of levels.
        seen: of the clear ones, those that the camera sees; None without a camera. drawn: of these, those that were
            drawn at random, where they are too many. shapeless: whether the arm has no shapes to be kept clear.
    """

    clear: int
    tried: int
    random: bool
    seen: int | None
    drawn: int | None
    shapeless: bool


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """Candidate poses, their origin (of a file as its reader describes it), and how many each rule rejected."""

    poses: Poses
    origin: ClearAngles | str
    rejected: dict[str, int]


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Problem that a design solves.

    Attributes:
        model: at whose parameters everything is linearised. keys: fitted parameters; None for all that are identifiable
            at the candidates with this noise. Those of a rival that is fitted already are the rival's.
        rivals: effects to discriminate. causes: as they are thought to be there; empty: of typical size.
        noise: m per axis. measured: poses measured already, or None.
        repeats: how many of the poses to measure twice. first_number: of the first new pose.
        weights: with which poses will be measured; without a stated standard deviation: `noise`, the same for all.
        measured_weights: with which those that are measured already were; None: as the others will be.
        prior: covariance of the fitted parameters as they are known beforehand, in their order; None: unknown.
    """

    model: Model
    keys: tuple[str, ...] | None
    rivals: tuple[Effect, ...]
    count: int
    index: Index
    noise: float
    measured: Poses | None
    repeats: int
    first_number: int
    seed: int
    weights: Callable[[Poses], Whitening] = lambda _: PLAIN
    measured_weights: Whitening | None = None
    prior: Covariance | None = None
    causes: tuple[CandidateCause, ...] = ()

    def likely(self, keys: Sequence[str]) -> tuple[CandidateCause, ...]:
        """The rivals as they may be there, beside fitted parameters `keys`."""
        return self.causes or tuple(CandidateCause.typical(effect, keys) for effect in self.rivals)


Columns = list[Array]
"""Columns of poses: of the fitted parameters (N, R, m), then of each rival (N, R, m_k); of typical sizes, in mm."""


def design(
    problem: DesignProblem, candidates: Poses, progress: OnProgress = silent, executor: Executor | None = None
) -> PoseDesign:
    """Chooses poses among candidates by DETMAX; from which side to approach each is chosen too where it matters.

    Raises:
        RankDeficient: the candidates do not determine all parameters.
        LrmError: an impossible number of poses, or rivals that cannot be tested or discriminated.
    """
    rng = np.random.default_rng(problem.seed)
    ordered = tuple(effect for effect in problem.rivals if "time" in effect.depends_on)
    at_poses = replace(
        problem,
        rivals=tuple(effect for effect in problem.rivals if effect not in ordered),
        keys=None if problem.keys is None else beside(problem, problem.keys),
    )
    if _side_matters(at_poses, candidates):
        sided = _distinct(_from_both_sides(problem.model.arm, candidates))
    else:  # random, so that other parameters do not absorb hysteresis
        sided = _sided(problem.model.arm, candidates, rng.choice([1.0, -1.0], len(candidates)))
    settled = solve_equilibrium(problem.model, sided)
    whitening = problem.weights(sided)
    check_testable(settled, at_poses.rivals, whitening.sensed)
    noise = problem.noise if whitening.sd is None else whitening.unit
    every = select_identifiable(settled, fittable(problem.model), noise, whitening).kept
    keys = beside(problem, every) if at_poses.keys is None else at_poses.keys
    moved, weighted = identification_jacobian(settled, keys), _weighted(at_poses, whitening, settled, keys)
    measured = _known(at_poses, keys, weighted)
    width, already = sum(part.shape[2] for part in weighted), 0 if problem.measured is None else len(problem.measured)
    already += 0 if problem.prior is None else len(keys)
    check_count(problem.count, len(sided), width, already, int(np.max(whitening.measured)))
    criterion = _criterion(at_poses, weighted, measured)
    chosen = maximise_criterion(criterion, problem.count, STARTS, problem.seed, progress, executor).rows
    draws = [rng.choice(len(sided), problem.count, replace=False) for _ in range(RANDOM_DRAWS)]
    order, *random_orders = (_order(sided, rows, problem.repeats, rng) for rows in (chosen, *draws))
    hold, pairs = _held(problem, keys, sided.take(order), rng if ordered else None)
    if ordered:
        turns = [_in_turn(problem, keys, sided.take(rows), hold) for rows in (order, *random_orders)]
        measured = _known(problem, keys, turns[0])
        sets = [_stack(turn, np.arange(len(order)), measured) for turn in turns]
    else:
        sets = [_stack(weighted, rows, measured) for rows in (order, *random_orders)]
    after, *random_after = map(partial(_accuracy, problem, moved), sets)
    number = np.arange(problem.first_number, problem.first_number + len(order))
    first = {int(row): int(number[k]) for k, row in reversed(list(enumerate(order)))}
    return PoseDesign(
        poses=sided.take(order),
        number=number,
        repeat_of=np.array([first[int(row)] for row in order]),
        rows=chosen,
        keys=keys,
        observability=observability(weighted[0][chosen]),
        random_baseline=Observability.median(weighted[0], draws),
        before=None if measured is None else _accuracy(problem, moved, measured),
        after=after,
        random_after=sorted(random_after, key=_uncertainty)[RANDOM_DRAWS // 2],
        hold=hold,
        pairs=pairs,
    )


def tried(problem: DesignProblem, designed: PoseDesign) -> PoseDesign:
    """The design, tried on simulated measurements of every rival."""
    if len(problem.rivals) < 2:
        return designed
    model, parts = problem.model.with_free(designed.keys), _parts(problem, designed.poses, designed.hold)
    trials = told_in_trials(model, problem.likely(designed.keys), parts, problem.noise, problem.seed)
    return replace(designed, trials=trials)


def beside(problem: DesignProblem, keys: Sequence[str]) -> tuple[str, ...]:
    """Parameters to fit beside the rivals. Raises `UnsuitableRival`: a single rival that is fitted already."""
    keys_of = {effect.name: {*effect.keys} for effect in problem.rivals}
    fitted = {name for name, rows in keys_of.items() if rows & {*keys} and not _lacks(problem, name, keys)}
    if fitted and len(keys_of) == 1:
        why = "has nothing that is not fitted already; name effects that the model lacks"
        raise UnsuitableRival(next(iter(fitted)), why)
    taken = {key for name in fitted for key in keys_of[name]}
    return tuple(key for key in keys if key not in taken)


def _lacks(problem: DesignProblem, name: str, keys: Sequence[str]) -> bool:
    """Whether something of a rival is not among the fitted `keys`."""
    return any(unfitted_rows(effect, keys) for effect in problem.rivals if effect.name == name)


def _known(problem: DesignProblem, keys: Sequence[str], columns: Columns) -> Columns | None:
    """Columns of the poses measured already, and of the prior; None where there is neither."""
    measured = None
    if problem.measured is not None:
        weights = problem.weights(problem.measured) if problem.measured_weights is None else problem.measured_weights
        measured = _weighted(problem, weights, solve_equilibrium(problem.model, problem.measured), keys)
    return measured if problem.prior is None else _with_prior(problem, problem.prior, columns, measured)


def _parts(problem: DesignProblem, poses: Poses, hold: Array | None) -> list[Poses]:
    """All poses: those measured already, and those of a design as if they were measured after them."""
    poses = as_measured(poses, problem.measured, hold)
    return [poses] if problem.measured is None else [problem.measured, poses]


def _held(
    problem: DesignProblem, keys: Sequence[str], poses: Poses, rng: np.random.Generator | None
) -> tuple[Array, tuple[CausePair, ...]]:
    """How long to hold each of the poses, and the rivals in pairs as expected then: half of the poses for the shortest
    of `DWELLS_S` that tells all of them apart, else for the best. `rng`: None where no rival follows time."""
    model, causes, size = problem.model.with_free(keys), problem.likely(keys), len(poses)
    held = np.zeros(size) if rng is None else rng.permutation(np.arange(size) % 2).astype(np.float64)
    tries = []
    for dwell in DWELLS_S if rng is not None else (0.0,):
        hold = dwell * held
        pairs = () if len(causes) < 2 else expected(model, causes, _parts(problem, poses, hold), problem.noise)
        tries.append((hold, pairs))
        if all(pair.distinguishable_if_exact for pair in pairs):
            return hold, pairs
    return max(
        tries,
        key=lambda attempt: (sum(p.distinguishable_if_exact for p in attempt[1]), min(p.lead for p in attempt[1])),
    )


def _in_turn(problem: DesignProblem, keys: Sequence[str], poses: Poses, hold: Array) -> Columns:
    """Columns of poses as they are measured one after the other."""
    settled = solve_equilibrium(problem.model, as_measured(poses, problem.measured, hold))
    whitening = problem.weights(poses)
    check_testable(settled, problem.rivals, whitening.sensed)
    return _weighted(problem, whitening, settled, keys)


def _from_both_sides(arm: Arm, poses: Poses) -> Poses:
    """Every pose twice in a row: all joints coming from below (+1), then all from above (−1)."""
    twice = np.repeat(np.arange(len(poses)), 2)
    return _sided(arm, poses.take(twice), np.tile([1.0, -1.0], len(poses)))


def _distinct(twice: Poses) -> Poses:
    """Poses of both sides, once where both are one: with all joints at limits."""
    assert twice.direction is not None
    differ = np.any(twice.direction[0::2] != twice.direction[1::2], axis=1)
    return twice.take(np.column_stack([np.ones_like(differ), differ]).ravel())


def _sided(arm: Arm, poses: Poses, side: Array) -> Poses:
    """Poses to which all joints come from one side (N,), those at a limit from within."""
    every = np.repeat(side[:, None], poses.q.shape[1], axis=1)
    return Poses(poses.q, poses.payload, feasible_approach(arm, poses.q, every))


def _side_matters(problem: DesignProblem, candidates: Poses) -> bool:
    """Whether a rival moves the TCP otherwise when joints come from the other side."""
    some = _from_both_sides(problem.model.arm, candidates.take(np.arange(min(len(candidates), SIDE_POSES))))
    moved = rival_columns(problem.model, some, problem.rivals, problem.keys or ())
    return any(not np.allclose(columns[0::2], columns[1::2]) for columns in moved)


def _weighted(problem: DesignProblem, whitening: Whitening, settled: Equilibrium, keys: Sequence[str]) -> Columns:
    """Columns as if all that is measured were positions with the problem's noise."""
    scale = 1.0 if whitening.sd is None else problem.noise / whitening.unit
    rivals = rival_columns(problem.model, settled.poses, problem.rivals, keys, whitening.sensed)
    fitted = identification_jacobian(settled, keys, whitening=whitening)
    return [scale * fitted, *(scale * whitening.unit * whitening(part) for part in rivals)]


def _with_prior(problem: DesignProblem, covariance: Covariance, columns: Columns, measured: Columns | None) -> Columns:
    """Columns of the poses measured already, and of a prior as if it were measurements: one number a parameter."""
    typical = np.array([problem.model.parameter(key).typical for key in covariance.keys])
    # Rows R with RᵀR = C⁻¹ say as much as the prior; times σ they are as noisy as a measurement
    root = np.linalg.inv(np.linalg.cholesky(covariance.matrix / np.outer(typical, typical)))
    prior_rows = [problem.noise * MM_PER_M * root, *(np.zeros((len(root), part.shape[2])) for part in columns[1:])]
    every = [part[None] for part in prior_rows]
    return every if measured is None else _stack(every, np.arange(1), measured)


def _stack(columns: Columns, rows: Rows, measured: Columns | None) -> Columns:
    """Columns of some rows, and of the poses measured already: (1, K, m), K numbers of all poses together."""
    both = [[part[rows]] for part in columns]
    for parts, more in zip(both, measured or [], strict=False):
        parts.append(more)
    return [np.concatenate([part.reshape(-1, part.shape[2]) for part in parts])[None] for parts in both]


def _criterion(problem: DesignProblem, columns: Columns, measured: Columns | None) -> Criterion:
    """The index of the fitted parameters; with rivals, half of it log det of theirs, the fitted ones projected out."""
    fitted, prior = columns[0], None if measured is None else _information(measured[0])
    if not problem.rivals:
        return criterion_of(fitted, problem.index, prior)
    wide = np.concatenate(columns, axis=2)
    wide_prior = None if measured is None else _information(np.concatenate(measured, axis=2))
    m, extra = fitted.shape[2], wide.shape[2] - fitted.shape[2]
    # log det of the rivals' own information (Schur complement) = log det of all − log det of the fitted ones
    general, rivals = 0.5 * (1.0 - RIVAL_SHARE) / m, 0.5 * RIVAL_SHARE / extra
    whitened = whiten(fitted, prior)
    try:
        return DeterminantCriterion(((whitened, general - rivals), (whiten(wide, wide_prior), rivals)))
    except RankDeficient:
        names = " and ".join(effect.name for effect in problem.rivals)
        raise Indistinguishable(f"no choice of these {len(fitted)} candidates can tell {names} apart") from None


def _information(columns: Array) -> Array:
    stacked = columns.reshape(-1, columns.shape[2])
    return np.asarray(stacked.T @ stacked)


def _accuracy(problem: DesignProblem, moved: Array, measured: Columns) -> ExpectedAccuracy:
    """Expected accuracy of a fit to measured poses, over all candidates, whose TCP the parameters move (N, 3, m)."""
    noise = problem.noise * MM_PER_M
    # Columns are of typical sizes: C = σ² (XᵀX + (σ / PRIOR_SD)² I)⁻¹, and J C Jᵀ of the TCP, its trace pose by pose
    prior = (noise / PRIOR_SD) ** 2 * np.eye(measured[0].shape[2])
    covariance = np.linalg.inv(_information(measured[0]) + prior) * noise**2
    motion = np.sqrt((moved**2).sum(axis=1).mean(axis=0))
    variance = np.einsum("nci,ij,ncj->n", moved, covariance, moved, optimize=True)
    discrimination = None
    if problem.rivals:
        fitted, *rivals = (columns.reshape(-1, columns.shape[2]) for columns in measured)
        discrimination = discrimination_of(problem.rivals, fitted, rivals, noise)
    return ExpectedAccuracy(np.sqrt(np.diag(covariance)) * motion, float(np.sqrt(variance.mean())), discrimination)


def _uncertainty(accuracy: ExpectedAccuracy) -> float:
    """The measure by which draws are compared: the largest detectable size of a rival, or the error of the TCP."""
    if accuracy.discrimination is None:
        return accuracy.tcp
    sizes = [rival.detectable_size for rival in accuracy.discrimination.rivals]
    return max(np.inf if size is None else size for size in sizes)


def _order(poses: Poses, rows: Rows, repeats: int, rng: np.random.Generator) -> Rows:
    """The rows to measure in order, some twice: load by load, since loads are changed by hand, at random otherwise.

    A random order keeps drifts uncorrelated with the joints.
    """
    again = rng.choice(rows, min(repeats, len(rows)), replace=False)
    every = rng.permutation(np.concatenate([rows, again]))
    return np.asarray(every[np.argsort(poses.payload[every], kind="stable")])
