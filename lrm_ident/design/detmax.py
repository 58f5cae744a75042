"""Choosing n of N poses: the exchange search of Mitchell 1974 (DETMAX), from several random starts.

An excursion takes the best k poses in, one by one, and then the least useful k out, or the other way round; it counts
if the score rose, else k grows. k = 1 is the thesis's search (Figure 6.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.fisher_information import Rows, Whitened, whiten
from lrm_ident.design.observability import Index
from lrm_ident.design.optimality import Criterion, Scored, criterion_of
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

LONGEST_EXCURSION, STARTS = 6, 10
REAL_GAIN = 1e-9  # rise of the score below which a search has arrived
BOUND_STEPS = 300


@dataclass(frozen=True, eq=False)
class Chosen:
    """A set of poses.

    Attributes:
        rows: (n,), ascending, of the candidates.
        score: of the criterion. starts: the score that each random start ended with.
        blind: the score of each random start itself: what choosing blindly gives.
    """

    rows: Rows
    score: float
    starts: tuple[float, ...]
    blind: tuple[float, ...]


def exchange(
    columns: Array,
    n: int = 50,
    index: Index = "O1",
    starts: int = STARTS,
    seed: int = 0,
    already: Array | None = None,
    progress: Tick = silent,
) -> Chosen:
    """The n poses that raise an index most, together with what is known already.

    Args:
        columns: (N, 3, m), Jacobian of every candidate pose (`identification_jacobian`). The set that is best for O1
            does not depend on the units; for the other indices scaled columns have a meaning.
        already: (m, m), information JᵀJ of poses measured already, in the same units, or None.

    Raises:
        TooPoor: the candidates do not tell all parameters. LrmError: n is no possible number.
    """
    check_number(n, columns.shape, already is not None)
    return exchange_by(criterion_of(columns, index, already), n, starts, seed, progress)


def check_number(n: int, shape: tuple[int, ...], augments: bool = False) -> None:
    """Raises `LrmError` unless n of the candidates (N, 3, m) can tell m parameters (or add to what is known)."""
    N, _, m = shape
    if n > N:
        raise LrmError(f"{n} poses asked for, but there are only {N} candidates")
    if n < 1 or (3 * n < m and not augments):
        raise LrmError(f"{n} poses cannot tell {m} parameters; ask for at least {max(1, -(-m // 3))} (-n)")


def exchange_by(criterion: Criterion, n: int, starts: int = STARTS, seed: int = 0, progress: Tick = silent) -> Chosen:
    """The n poses that score highest, from several random starts."""
    rng = np.random.default_rng(seed)
    found: list[tuple[Rows, float]] = []
    blind = []
    for number in range(starts):
        rows = rng.choice(criterion.count, n, replace=False)
        begun = criterion.of(rows)
        blind.append(begun.score)
        found.append(_climb(criterion, rows, begun))
        progress(number + 1, starts)
    rows, score = max(found, key=lambda one: one[1])
    return Chosen(np.sort(rows), score, tuple(value for _, value in found), tuple(blind))


def _climb(criterion: Criterion, rows: Rows, scored: Scored) -> tuple[Rows, float]:
    """Excursions from one set until none raises the score; the score anew, without the updates' round-off."""
    inside = np.zeros(criterion.count, dtype=np.bool_)
    inside[rows] = True
    length = 1
    while length <= LONGEST_EXCURSION:
        for first in (1, -1):
            trial = _excursion(inside, scored, length, first)
            if trial is not None and trial[1].score > scored.score + REAL_GAIN:
                inside, scored = trial
                length = 0
                break
        length += 1
    chosen = np.flatnonzero(inside)
    return chosen, criterion.of(chosen).score


def _excursion(
    inside: NDArray[np.bool_], scored: Scored, length: int, first: int
) -> tuple[NDArray[np.bool_], Scored] | None:
    """The best `length` poses in and the least useful out (`first` = 1), or out and in (−1); None if it cannot be."""
    inside = inside.copy()
    for sign in [first] * length + [-first] * length:
        among = np.flatnonzero(~inside if sign > 0 else inside)
        if not len(among):
            return None
        scores = scored.scores(sign, among)
        best = int(np.argmax(scores))
        if np.isneginf(scores[best]):
            return None
        scored = scored.changed(int(among[best]), sign)
        inside[among[best]] = sign > 0
    return inside, scored


def best_possible_o1(columns: Array, rows: Rows, steps: int = BOUND_STEPS) -> float:
    """No set of as many candidates as `rows` has an O1 above this.

    log det is concave in the weights of the poses, so its tangent at any weights in [0, 1] bounds every set of n: the
    log-determinant there, less m, plus the n largest traces of V. The weights are improved by conditional gradients
    (Frank & Wolfe 1956), from the set given.
    """
    of, n, m = whiten(columns), len(rows), columns.shape[2]
    weights = np.zeros(len(columns))
    weights[rows] = 1.0
    bound = np.inf
    for step in range(steps):
        slope, log_det = _slope(of, weights)
        corner = np.zeros(len(columns))
        corner[np.argsort(-slope)[:n]] = 1.0
        bound = min(bound, log_det - m + float(slope @ corner))
        weights += 2.0 / (step + 4.0) * (corner - weights)
    return float(np.exp(0.5 * bound / m) / np.sqrt(n))


def _slope(of: Whitened, weights: Array) -> tuple[Array, float]:
    """∂ log det/∂weight of every pose (N,), and the log-determinant, in the units given."""
    m = of.columns.shape[2]
    root = (of.columns * np.sqrt(weights)[:, None]).reshape(-1, m)
    M = root.T @ root + 1e-14 * np.eye(m)
    slope = np.einsum("cni,cni->n", of.columns @ np.linalg.inv(M), of.columns)
    return slope, float(np.linalg.slogdet(M)[1]) + of.offset
