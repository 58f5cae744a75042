"""Experiment design: the next poses to measure, D-optimal for parameters, Ds-optimal to discriminate rival effects.

Fedorov 1972, Theory of Optimal Experiments; Atkinson & Donev 1992.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.detmax import check_count, maximise_criterion
from lrm_ident.design.discrimination import Discrimination, check_testable, discrimination_of, rival_columns
from lrm_ident.design.fisher_information import RankDeficient, Rows, whiten
from lrm_ident.design.observability import MM_PER_M, Index, Observability, identification_jacobian, observability
from lrm_ident.design.optimality import Criterion, DeterminantCriterion, criterion_of
from lrm_ident.design.parameter_elimination import fittable
from lrm_ident.diagnosis.linearised_fit import PRIOR_SD
from lrm_ident.estimation.identifiability import select_identifiable
from lrm_ident.progress import OnProgress, silent
from lrm_ident.weights.whitening import PLAIN, Whitening, root_of
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model

RANDOM_DRAWS, STARTS = 20, 4
RIVAL_SHARE = 0.5  # of the criterion
SIDE_POSES = 20  # at which to check whether the side of approach matters


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


@dataclass(frozen=True, eq=False)
class PoseDesign:
    """Poses to measure, in the order to measure them.

    Attributes:
        poses: every row's angles, load, and side of approach. number: (R,). repeat_of: (R,), its own number if none.
        rows: (n,), the candidates chosen. keys: the parameters that the poses are chosen for.
        observability: of the chosen poses alone; random_baseline: medians of as many random poses.
        before: expected from the poses measured already, None if there are none. after: with the new poses.
        random_after: the same with random poses: the median draw by detectable size of the rivals, or by `tcp`.
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


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """Candidate poses, a description of their origin, and how many combinations each rule rejected."""

    poses: Poses
    description: str
    rejected: dict[str, int]


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """What a design is for.

    Attributes:
        model: at whose parameters everything is linearised. keys: fitted parameters; None for all that are identifiable
            at the candidates with this noise.
        rivals: effects to discriminate. noise: m per axis. measured: poses measured already, or None.
        repeats: how many of the poses to measure twice. first_number: of the first new pose.
        covariance: (N, 3, 3), m², with which positions will be measured; None: `noise`, the same for all.
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
    covariance: Callable[[Poses], Array] | None = None


Columns = list[Array]
"""Columns of poses: of the fitted parameters (N, 3, m), then of each rival (N, 3, m_k); of typical sizes, in mm."""


def design(
    problem: DesignProblem, candidates: Poses, progress: OnProgress = silent, executor: Executor | None = None
) -> PoseDesign:
    """Chooses poses among candidates by DETMAX; from which side to approach each is chosen too where it matters.

    Raises:
        RankDeficient: the candidates do not determine all parameters.
        LrmError: an impossible number of poses, or rivals that cannot be tested or discriminated.
    """
    rng = np.random.default_rng(problem.seed)
    if _side_matters(problem, candidates):
        sided = _from_both_sides(candidates)
    else:  # random, so that other parameters do not absorb hysteresis
        sided = _sided(candidates, rng.choice([1.0, -1.0], len(candidates)))
    rest = equilibrium(problem.model, sided)
    check_testable(rest, problem.rivals)
    whitening = _whitening(problem, sided)
    noise = problem.noise if problem.covariance is None else whitening.unit
    keys = problem.keys or select_identifiable(rest, fittable(problem.model), noise, whitening).kept
    columns, measured = _columns(problem, rest, keys), None
    if problem.measured is not None:
        own = _whitening(problem, problem.measured)
        measured = _weighted(problem, own, _columns(problem, equilibrium(problem.model, problem.measured), keys))
    weighted = _weighted(problem, whitening, columns)
    width, already = sum(part.shape[2] for part in columns), 0 if problem.measured is None else len(problem.measured)
    check_count(problem.count, len(sided), width, already)
    criterion = _criterion(problem, weighted, measured)
    chosen = maximise_criterion(criterion, problem.count, STARTS, problem.seed, progress, executor).rows
    draws = [rng.choice(len(sided), problem.count, replace=False) for _ in range(RANDOM_DRAWS)]
    order, *random_orders = (_order(sided, rows, problem.repeats, rng) for rows in (chosen, *draws))
    after, *random_after = (
        _accuracy(problem, columns, _stack(weighted, rows, measured)) for rows in (order, *random_orders)
    )
    number = np.arange(problem.first_number, problem.first_number + len(order))
    first = {int(row): int(number[k]) for k, row in reversed(list(enumerate(order)))}
    return PoseDesign(
        poses=sided.take(order),
        number=number,
        repeat_of=np.array([first[int(row)] for row in order]),
        rows=chosen,
        keys=keys,
        observability=observability(columns[0][chosen]),
        random_baseline=Observability.median(columns[0], draws),
        before=None if measured is None else _accuracy(problem, columns, measured),
        after=after,
        random_after=sorted(random_after, key=_uncertainty)[RANDOM_DRAWS // 2],
    )


def _from_both_sides(poses: Poses) -> Poses:
    """Every pose twice in a row: all joints coming from below (+1), then all from above (−1)."""
    twice = np.repeat(np.arange(len(poses)), 2)
    return _sided(poses.take(twice), np.tile([1.0, -1.0], len(poses)))


def _sided(poses: Poses, side: Array) -> Poses:
    return Poses(poses.q, poses.payload, np.repeat(side[:, None], poses.q.shape[1], axis=1))


def _side_matters(problem: DesignProblem, candidates: Poses) -> bool:
    """Whether a rival moves the TCP otherwise when joints come from the other side."""
    some = _from_both_sides(candidates.take(np.arange(min(len(candidates), SIDE_POSES))))
    moved = rival_columns(problem.model, some, problem.rivals, problem.keys or ())
    return any(not np.allclose(columns[0::2], columns[1::2]) for columns in moved)


def _whitening(problem: DesignProblem, poses: Poses) -> Whitening:
    """Weights of positions measured at poses."""
    if problem.covariance is None:
        return PLAIN
    covariance = problem.covariance(poses)
    return Whitening(np.sqrt(np.einsum("nii->n", covariance) / 3.0), root_of(covariance))


def _weighted(problem: DesignProblem, whitening: Whitening, columns: Columns) -> Columns:
    """Columns as if all positions had the problem's noise."""
    return columns if problem.covariance is None else [problem.noise * whitening(part) for part in columns]


def _columns(problem: DesignProblem, rest: Equilibrium, keys: Sequence[str]) -> Columns:
    return [identification_jacobian(rest, keys), *rival_columns(problem.model, rest.poses, problem.rivals, keys)]


def _stack(columns: Columns, rows: Rows, measured: Columns | None) -> Columns:
    """Columns of some rows, and of the poses measured already."""
    chosen = [part[rows] for part in columns]
    return chosen if measured is None else [np.concatenate(pair) for pair in zip(chosen, measured, strict=True)]


def _criterion(problem: DesignProblem, columns: Columns, measured: Columns | None) -> Criterion:
    """The index of the fitted parameters; with rivals, half of it log det of theirs, the fitted ones projected out."""
    fitted, prior = columns[0], None if measured is None else _information(measured[0])
    if not problem.rivals:
        return criterion_of(fitted, problem.index, prior)
    wide = np.concatenate(columns, axis=2)
    wide_prior = None if measured is None else _information(np.concatenate(measured, axis=2))
    m, extra = fitted.shape[2], wide.shape[2] - fitted.shape[2]
    general, rivals = 0.5 * (1.0 - RIVAL_SHARE) / m, 0.5 * RIVAL_SHARE / extra
    whitened = whiten(fitted, prior)
    try:
        return DeterminantCriterion(((whitened, general - rivals), (whiten(wide, wide_prior), rivals)))
    except RankDeficient:
        names = " and ".join(f"{effect.id}@{effect.place}" for effect in problem.rivals)
        raise LrmError(
            f"no choice of these {len(fitted)} candidates can tell {names} apart; offer more levels "
            "(--levels), other loads (--loads-g), or fewer rivals"
        ) from None


def _information(columns: Array) -> Array:
    stacked = columns.reshape(-1, columns.shape[2])
    return np.asarray(stacked.T @ stacked)


def _accuracy(problem: DesignProblem, candidates: Columns, measured: Columns) -> ExpectedAccuracy:
    """Expected accuracy of a fit to measured poses, over all candidates."""
    noise = problem.noise * MM_PER_M
    prior = (noise / PRIOR_SD) ** 2 * np.eye(measured[0].shape[2])
    covariance = np.linalg.inv(_information(measured[0]) + prior) * noise**2
    motion = np.sqrt((candidates[0] ** 2).sum(axis=1).mean(axis=0))
    variance = np.einsum("nci,ij,ncj->n", candidates[0], covariance, candidates[0], optimize=True)
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
