"""The best next poses: what to measure so that parameters become known, and rival effects fall apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.detmax import check_number, exchange_by
from lrm_ident.design.discrimination import Separation, check_visible, rival_columns, separation
from lrm_ident.design.fisher_information import Rows, TooPoor, whiten
from lrm_ident.design.observability import MM_PER_M, Index, Observability, identification_jacobian, observability
from lrm_ident.design.optimality import Criterion, Determinants, criterion_of
from lrm_ident.design.parameter_elimination import fittable
from lrm_ident.diagnosis.linearised_fit import PRIOR_SIZES
from lrm_ident.fit.identifiability import identifiable
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model

BLIND_DRAWS, STARTS = 20, 4
SEPARATING = 0.5  # share of the criterion that the rivals have
SAMPLE = 20  # poses at which to look whether the side of approach matters


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What a set of poses would tell.

    Attributes:
        errors: (P,), expected standard error of each parameter, as the RMS motion of the TCP over the candidates that
            it stands for (mm). A parameter that the poses do not tell is known to three typical sizes beforehand.
        tcp: RMS over the candidates of the distance by which the predicted TCP will be off for all of them (mm).
        apart: the rivals, None if none are named.
    """

    errors: Array
    tcp: float
    apart: Separation | None


@dataclass(frozen=True, eq=False)
class Design:
    """Poses to measure, in the order to measure them.

    Attributes:
        poses: every row's angles, load, and side of approach. number: (R,). repeat_of: (R,), its own number if none.
        rows: (n,), the candidates chosen.
        keys: the parameters that the poses are chosen for.
        index: of the chosen poses alone; blind: medians of as many poses drawn blindly.
        before: what is known from the poses measured already, None if there are none. after: with the new poses.
        blind_after: the same with poses drawn blindly: the draw in the middle by what can be told apart, or by `tcp`.
    """

    poses: Poses
    number: NDArray[np.int64]
    repeat_of: NDArray[np.int64]
    rows: Rows
    keys: tuple[str, ...]
    index: Observability
    blind: Observability
    before: Knowledge | None
    after: Knowledge
    blind_after: Knowledge


@dataclass(frozen=True, eq=False)
class Offer:
    """Candidate poses, where they come from in words, and how many combinations each rule refused."""

    poses: Poses
    words: str
    refused: dict[str, int]


@dataclass(frozen=True, eq=False)
class Task:
    """What a design is for.

    Attributes:
        model: at whose parameters everything is linearised. keys: fitted parameters; None for all that the candidates
            can tell at this noise.
        rivals: effects to tell apart. noise: m per axis. have: poses measured already, or None.
        repeats: how many of the poses to measure twice. first: number of the first new pose.
    """

    model: Model
    keys: tuple[str, ...] | None
    rivals: tuple[Effect, ...]
    count: int
    index: Index
    noise: float
    have: Poses | None
    repeats: int
    first: int
    seed: int


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of poses: of the fitted parameters (N, 3, m) and of each rival (N, 3, m_k), of typical sizes, in mm."""

    fitted: Array
    rivals: tuple[Array, ...]

    def take(self, rows: Rows) -> _Columns:
        return _Columns(self.fitted[rows], tuple(columns[rows] for columns in self.rivals))

    def and_(self, other: _Columns | None) -> _Columns:
        if other is None:
            return self
        pairs = zip(self.rivals, other.rivals, strict=True)
        return _Columns(np.concatenate([self.fitted, other.fitted]), tuple(np.concatenate(pair) for pair in pairs))


def design(task: Task, offered: Poses, progress: Tick = silent) -> Design:
    """Chooses poses among those offered; from which side to approach each is chosen too.

    Raises:
        TooPoor: the candidates cannot tell all parameters.
        LrmError: an impossible number of poses, rivals that cannot be tested or told apart.
    """
    rng = np.random.default_rng(task.seed)
    sided = _from_both_sides(offered) if _side_matters(task, offered) else _from_any_side(offered, rng)
    rest = equilibrium(task.model, sided)
    check_visible(rest, task.rivals)
    keys = task.keys or identifiable(rest, fittable(task.model), task.noise).kept
    columns = _columns(task, rest, keys)
    have = None if task.have is None else _columns(task, equilibrium(task.model, task.have), keys)
    _check_number(task, columns)
    chosen = exchange_by(_criterion(task, columns, have), task.count, STARTS, task.seed, progress)
    draws = [rng.choice(len(sided), task.count, replace=False) for _ in range(BLIND_DRAWS)]
    indices = np.median([list(vars(observability(columns.fitted[rows])).values()) for rows in draws], axis=0)
    order, *blind_orders = (_order(sided, rows, task.repeats, rng) for rows in (chosen.rows, *draws))
    blind = [_knowledge(task, columns, columns.take(rows).and_(have)) for rows in blind_orders]
    number = np.arange(task.first, task.first + len(order))
    first = {int(row): int(number[k]) for k, row in reversed(list(enumerate(order)))}
    return Design(
        poses=sided.take(order),
        number=number,
        repeat_of=np.array([first[int(row)] for row in order]),
        rows=chosen.rows,
        keys=keys,
        index=observability(columns.fitted[chosen.rows]),
        blind=Observability(*indices.tolist()),
        before=None if have is None else _knowledge(task, columns, have),
        after=_knowledge(task, columns, columns.take(order).and_(have)),
        blind_after=sorted(blind, key=_doubt)[BLIND_DRAWS // 2],
    )


def _from_both_sides(poses: Poses) -> Poses:
    """Every pose twice in a row: all joints coming from below (+1), then all from above (−1)."""
    twice = np.repeat(np.arange(len(poses)), 2)
    return _sided(poses.take(twice), np.tile([1.0, -1.0], len(poses)))


def _from_any_side(poses: Poses, rng: np.random.Generator) -> Poses:
    """Every pose once, from a random side, so that no hysteresis hides in other parameters."""
    return _sided(poses, rng.choice([1.0, -1.0], len(poses)))


def _sided(poses: Poses, side: Array) -> Poses:
    return Poses(poses.q, poses.payload, np.repeat(side[:, None], poses.q.shape[1], axis=1))


def _side_matters(task: Task, offered: Poses) -> bool:
    """Whether a rival moves the TCP otherwise when joints come from the other side."""
    some = _from_both_sides(offered.take(np.arange(min(len(offered), SAMPLE))))
    moved = rival_columns(task.model, some, task.rivals, task.keys or ()) if task.rivals else []
    return any(not np.allclose(columns[0::2], columns[1::2]) for columns in moved)


def _check_number(task: Task, columns: _Columns) -> None:
    """Raises `LrmError` if so many poses are not there, or cannot tell all parameters."""
    known = 0 if task.have is None else len(task.have)
    width = columns.fitted.shape[2] + sum(rival.shape[2] for rival in columns.rivals)
    check_number(task.count, columns.fitted.shape, augments=True)
    if 3 * (task.count + known) < width:
        least = -(-width // 3) - known
        raise LrmError(f"{task.count + known} poses cannot tell {width} parameters; ask for at least {least} (-n)")


def _columns(task: Task, rest: Equilibrium, keys: Sequence[str]) -> _Columns:
    fitted = identification_jacobian(rest, keys)
    return _Columns(fitted, tuple(rival_columns(task.model, rest.poses, task.rivals, keys)) if task.rivals else ())


def _criterion(task: Task, columns: _Columns, have: _Columns | None) -> Criterion:
    """The index of the fitted parameters; with rivals, half of it log det of theirs, the fitted ones projected out."""
    known = None if have is None else _information(have.fitted)
    if not columns.rivals:
        return criterion_of(columns.fitted, task.index, known)
    wide = np.concatenate([columns.fitted, *columns.rivals], axis=2)
    known_wide = None if have is None else _information(np.concatenate([have.fitted, *have.rivals], axis=2))
    m, extra = columns.fitted.shape[2], wide.shape[2] - columns.fitted.shape[2]
    general, apart = 0.5 * (1.0 - SEPARATING) / m, 0.5 * SEPARATING / extra
    alone = whiten(columns.fitted, known)
    try:
        return Determinants(((alone, general - apart), (whiten(wide, known_wide), apart)))
    except TooPoor:
        names = " and ".join(f"{effect.id}@{effect.place}" for effect in task.rivals)
        raise LrmError(
            f"no choice of these {len(columns.fitted)} candidates can tell {names} apart; offer more levels "
            "(--levels), other loads (--loads-g), or fewer rivals"
        ) from None


def _information(columns: Array) -> Array:
    stacked = columns.reshape(-1, columns.shape[2])
    return np.asarray(stacked.T @ stacked)


def _knowledge(task: Task, everywhere: _Columns, measured: _Columns) -> Knowledge:
    """What measured poses tell, judged over all candidates."""
    noise = task.noise * MM_PER_M
    prior = (noise / PRIOR_SIZES) ** 2 * np.eye(measured.fitted.shape[2])
    covariance = np.linalg.inv(_information(measured.fitted) + prior) * noise**2
    motion = np.sqrt((everywhere.fitted**2).sum(axis=1).mean(axis=0))
    spread = np.einsum("nci,ij,ncj->n", everywhere.fitted, covariance, everywhere.fitted, optimize=True)
    apart = None
    if measured.rivals:
        flat = [columns.reshape(-1, columns.shape[2]) for columns in (measured.fitted, *measured.rivals)]
        apart = separation(task.rivals, flat[0], flat[1:], noise)
    return Knowledge(np.sqrt(np.diag(covariance)) * motion, float(np.sqrt(spread.mean())), apart)


def _doubt(known: Knowledge) -> float:
    """By what draws are compared: the largest effect that could hide among its rivals, or the error of the TCP."""
    if known.apart is None:
        return known.tcp
    return max(np.inf if rival.least is None else rival.least for rival in known.apart.rivals)


def _order(poses: Poses, rows: Rows, repeats: int, rng: np.random.Generator) -> Rows:
    """The rows to measure in order, some twice: load by load, since loads are changed by hand, at random otherwise.

    An order that runs with no joint keeps drifts apart from errors of a joint.
    """
    again = rng.choice(rows, min(repeats, len(rows)), replace=False)
    every = rng.permutation(np.concatenate([rows, again]))
    return np.asarray(every[np.argsort(poses.payload[every], kind="stable")])
