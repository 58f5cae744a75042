"""DETMAX exchange (Mitchell 1974): n of N poses that maximise a criterion, from several random starts.

An excursion adds the best k poses, one by one, and then removes the least useful k, or the reverse; it is accepted if
the score rose, else k grows. k = 1 is the thesis's search (Figure 6.1).
"""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.fisher_information import Rows, whiten
from lrm_ident.design.observability import Index
from lrm_ident.design.optimality import Criterion, PoseSetScore, criterion_of
from lrm_ident.fitting.executors import in_order, in_this_process
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

MAX_EXCURSION, STARTS = 6, 10
SCORE_TOLERANCE = 1e-9  # rise of the score below which a search has converged
BOUND_STEPS = 300


@dataclass(frozen=True, eq=False)
class ExchangeResult:
    """The best set of poses: rows (n,) of the candidates, ascending; its score."""

    rows: Rows
    score: float


def exchange(
    columns: Array,
    n: int = 50,
    index: Index = "O1",
    starts: int = STARTS,
    seed: int = 0,
    prior_information: Array | None = None,
    progress: OnProgress = silent,
) -> ExchangeResult:
    """The n poses that maximise an index.

    Args:
        columns: (N, R, m), Jacobian of every candidate pose (`identification_jacobian`). The set that is best for O1
            does not depend on the units; for the other indices scaled columns have a meaning.
        prior_information: (m, m), information JᵀJ of poses measured already, in the same units, or None.

    Raises:
        RankDeficient: the candidates do not determine all parameters. LrmError: an impossible n.
    """
    check_count(n, len(columns), columns.shape[2] if prior_information is None else 1, rows=columns.shape[1])
    return maximise_criterion(criterion_of(columns, index, prior_information), n, starts, seed, progress)


def check_count(n: int, candidates: int, parameters: int, measured: int = 0, rows: int = 3) -> None:
    """Raises `LrmError` unless n of the candidates, with poses measured already, can determine the parameters.

    `rows`: how many numbers are measured of a pose.
    """
    if n > candidates:
        raise LrmError(f"{n} poses requested, but there are only {candidates} candidates")
    least = max(1, -(-parameters // rows) - measured)
    if n < least:
        raise LrmError(f"{n + measured} poses cannot tell {parameters} parameters; ask for at least {least} (-n)")


def maximise_criterion(
    criterion: Criterion,
    n: int,
    starts: int = STARTS,
    seed: int = 0,
    progress: OnProgress = silent,
    executor: Executor | None = None,
) -> ExchangeResult:
    """The n poses that score highest, from several random starts.

    Args:
        executor: where the starts climb side by side; None: here, which for hundreds of candidates is sooner.
    """
    rng = np.random.default_rng(seed)
    first = [rng.choice(criterion.count, n, replace=False) for _ in range(starts)]
    with nullcontext(executor) if executor else in_this_process() as pool:
        designs = in_order(pool, partial(_climb, criterion), first, progress)
    return max(designs, key=lambda designed: designed.score)


def _climb(criterion: Criterion, rows: Rows) -> ExchangeResult:
    """Excursions from one set until none raises the score, computed anew without the updates' round-off."""
    scored = criterion.evaluate(rows)
    inside = np.zeros(criterion.count, dtype=np.bool_)
    inside[rows] = True
    length = 1
    while length <= MAX_EXCURSION:
        for first in (1, -1):
            trial = _excursion(inside, scored, length, first)
            if trial is None or trial[1].score <= scored.score + SCORE_TOLERANCE:
                continue
            anew = criterion.evaluate(np.flatnonzero(trial[0]))
            if anew.score > scored.score + SCORE_TOLERANCE:
                inside, scored, length = trial[0], anew, 0
                break
        length += 1
    return ExchangeResult(np.flatnonzero(inside), scored.score)


def _excursion(
    inside: NDArray[np.bool_], scored: PoseSetScore, length: int, first: int
) -> tuple[NDArray[np.bool_], PoseSetScore] | None:
    """Adds the best `length` poses, removes the least useful (`first` = 1), or the reverse (−1); None if infeasible."""
    inside = inside.copy()
    for sign in [first] * length + [-first] * length:
        among = np.flatnonzero(~inside if sign > 0 else inside)
        if not len(among):
            return None
        scores = scored.scores(sign, among)
        best = int(np.argmax(scores))
        if np.isneginf(scores[best]):
            return None
        scored = scored.updated(int(among[best]), sign)
        inside[among[best]] = sign > 0
    return inside, scored


def o1_upper_bound(columns: Array, rows: Rows) -> float:
    """Upper bound of O1 over all sets of as many candidates as `rows`.

    log det is concave in the weights of the poses, so its tangent at any weights in [0, 1] bounds every set of n: the
    log-determinant there, less m, plus the n largest traces of V. The weights are improved by conditional gradients
    (Frank & Wolfe 1956), from the set given.
    """
    whitened, n, m = whiten(columns), len(rows), columns.shape[2]
    weights = np.zeros(len(columns))
    weights[rows] = 1.0
    bound = np.inf
    for step in range(BOUND_STEPS):
        root = (whitened.columns * np.sqrt(weights)[:, None]).reshape(-1, m)
        M = root.T @ root + 1e-14 * np.eye(m)
        gradient = np.einsum("cni,cni->n", whitened.columns @ np.linalg.inv(M), whitened.columns)
        corner = np.zeros(len(columns))
        corner[np.argsort(-gradient)[:n]] = 1.0
        log_det = float(np.linalg.slogdet(M)[1]) + whitened.log_det_offset
        bound = min(bound, log_det - m + float(gradient @ corner))
        weights += 2.0 / (step + 4.0) * (corner - weights)
    return float(np.exp(0.5 * bound / m) / np.sqrt(n))
