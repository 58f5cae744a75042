"""Expected lead of the true cause over another one: what poses will tell of two causes, before anybody measures them.

If one cause is there, everything else and another cause in its place are fitted. With a motion δ that these cannot
imitate, squared errors differ by |δ|² with a standard deviation of 2 σ |δ|: so by |δ| / 2 σ standard errors (Vuong
1989; Atkinson & Fedorov 1975). A trial draws such measurements and counts (Monte Carlo).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from lrm_ident.design.observability import MM_PER_M, identification_jacobian
from lrm_ident.diagnosis.screening.candidates import Candidate, differentiate_candidates, unfitted_rows
from lrm_ident.diagnosis.screening.column_spaces import orthonormal_basis, principal_cosine
from lrm_ident.diagnosis.screening.linearised_fit import PRIOR_SD
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects import FREE_FORMS, Effect
from lrm_math.kinematics.history import PACE_S, history_of
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium, with_borne_loads
from lrm_math.model.model import Model

NEEDED = Z_THRESHOLD + 1.2816
"""Standard errors to be expected: then nine in ten measurements show the `Z_THRESHOLD` that a name needs."""
NO_MOTION = 1e-9
"""m: round-off."""
MOST_SHAPES = 12
"""Of a cause that another might stand in for: a bound on time."""
TRIALS = 20
"""Measurements that are simulated of each cause."""


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


@dataclass(frozen=True)
class CausePair:
    """Two causes on some poses.

    lead: standard errors by which the first, if it is there, beats the second at the shape that imitates it best; of a
        cause with a memory of unknown time constant, at the constant where that is least.
    cosine: of their motions then; a diagnosis calls them alike if it is large, whatever the errors.
    one_form: whether a free form refines both. Where that form fits better, their formulas tell nothing.

    What is told anyway and what only if the formula of the cause is exact are kept apart: poses that leave two
    formulas alike do not show either whether one of them is exact.
    """

    there: str
    instead: str
    lead: float
    cosine: float
    one_form: bool = False

    @property
    def distinguishable_if_exact(self) -> bool:
        """Whether the data will tell them apart if the formula of the first is exact."""
        return self.lead >= NEEDED and self.cosine <= EQUIVALENCE_COSINE

    @property
    def distinguishable(self) -> bool:
        """Whether the data will tell them apart, exact or not."""
        return self.distinguishable_if_exact and not self.one_form


@dataclass(frozen=True, eq=False)
class CauseColumns:
    """Columns (R, m) in m per typical size, of each cause at each of its shapes; the first `likely` shapes are those at
    which it may be there. What the fitted parameters imitate is projected out by their `known` basis (R + P, rank)."""

    causes: tuple[CandidateCause, ...]
    known: Array
    columns: tuple[tuple[Array, ...], ...]
    likely: tuple[int, ...]

    def left(self, motion: Array) -> Array:
        """(R + P, k), motions (R, k) less what the fitted parameters imitate of them."""
        padded = np.concatenate([motion, np.zeros((len(self.known) - len(motion), motion.shape[1]))])
        return np.asarray(padded - self.known @ (self.known.T @ padded))


def expected(
    model: Model, causes: Sequence[CandidateCause], parts: Sequence[Poses], noise: float
) -> tuple[CausePair, ...]:
    """Every cause beside every other one, on all poses of the parts. `noise`: m per axis."""
    columns_of = cause_columns(model, causes, parts, noise)
    unexplained = [[columns_of.left(shape) for shape in shapes] for shapes in columns_of.columns]
    bases = [[orthonormal_basis(columns) for columns in shapes] for shapes in unexplained]
    leads = []
    for (a, cause), (b, other) in permutations(enumerate(causes), 2):
        apart, likely, best = min(
            (_distance(unexplained[a][k] @ cause.size, basis), k, j)
            for k in range(columns_of.likely[a])
            for j, basis in enumerate(bases[b])
        )
        cosine = principal_cosine(unexplained[a][likely], unexplained[b][best])
        names = cause.effect.name, other.effect.name
        leads.append(CausePair(*names, apart / (2.0 * noise), cosine, _share_a_form(cause.effect, other.effect)))
    return tuple(leads)


def told_in_trials(
    model: Model, causes: Sequence[CandidateCause], parts: Sequence[Poses], noise: float, seed: int
) -> dict[tuple[str, str], int]:
    """How many of `TRIALS` simulated measurements of each cause tell it from each other one, as a diagnosis compares:
    squared errors per pose, in pairs, the shapes of both fitted.

    All is linear about the model. A cause with a memory has another of its time constants in every measurement.
    `noise`: m per axis.
    """
    rng, columns_of = np.random.default_rng(seed), cause_columns(model, causes, parts, noise)
    bases = [[orthonormal_basis(columns_of.left(shape)) for shape in shapes] for shapes in columns_of.columns]
    count = {}
    for a, cause in enumerate(causes):
        motions = [columns @ cause.size for columns in columns_of.columns[a][: columns_of.likely[a]]]
        seen = np.stack([motions[k % len(motions)] for k in range(TRIALS)], axis=1)
        rest = columns_of.left(seen + rng.normal(0.0, noise, seen.shape))
        errors = [_least_errors(rest, shapes, len(seen)) for shapes in bases]
        for b, other in enumerate(causes):
            if a != b:
                differ = errors[b] - errors[a]
                error = np.maximum(differ.std(axis=0, ddof=1) / np.sqrt(len(differ)), NO_MOTION**2)
                z = differ.mean(axis=0) / error
                count[cause.effect.name, other.effect.name] = int(np.count_nonzero(z >= Z_THRESHOLD))
    return count


def _least_errors(rest: Array, bases: Sequence[Array], rows: int) -> Array:
    """(N, k), squared errors of each pose with the shape that fits each column of `rest` best."""
    unexplained = np.stack([rest - basis @ (basis.T @ rest) for basis in bases])
    best = (unexplained**2).sum(axis=1).argmin(axis=0)
    chosen = unexplained[best, :, np.arange(rest.shape[1])].T[:rows]
    return np.asarray((chosen.reshape(-1, 3, rest.shape[1]) ** 2).sum(axis=1))


def _share_a_form(effect: Effect, other: Effect) -> bool:
    ids = {effect.id, other.id}
    return effect.place == other.place and len(ids) == 2 and any(ids <= {*form.variant_of} for form in FREE_FORMS)


def _distance(motion: Array, basis: Array) -> float:
    return float(np.linalg.norm(motion - basis @ (basis.T @ motion)))


def cause_columns(model: Model, causes: Sequence[CandidateCause], parts: Sequence[Poses], noise: float) -> CauseColumns:
    """The columns of some causes on all poses of the parts; the model's free parameters are fitted beside them."""
    settled = [solve_equilibrium(model, with_borne_loads(model, part)) for part in parts]
    fitted = np.concatenate(
        [identification_jacobian(equilibrium, model.free).reshape(-1, len(model.free)) for equilibrium in settled]
    )
    fitted /= MM_PER_M
    ridge = noise / PRIOR_SD * np.eye(fitted.shape[1])
    wanted = [(cause.effect, cause.rows) for cause in causes]
    candidates = [differentiate_candidates(equilibrium, wanted)[1] for equilibrium in settled]
    columns, likely = [], []
    for k, cause in enumerate(causes):
        candidates_of = [part[k] for part in candidates]
        shapes, count = _shapes(cause, candidates_of)
        columns.append(
            tuple(np.concatenate([candidate.columns(shape) for candidate in candidates_of]) for shape in shapes)
        )
        likely.append(count)
    basis = orthonormal_basis(np.concatenate([fitted, ridge]))
    return CauseColumns(tuple(causes), basis, tuple(columns), tuple(likely))


def _shapes(cause: CandidateCause, candidates: Sequence[Candidate]) -> tuple[tuple[tuple[float, ...], ...], int]:
    """Shapes of a cause on all parts, at most `MOST_SHAPES` and evenly among those to try; the first may be there."""
    tried = max((candidate.shapes for candidate in candidates), key=len)
    if cause.shape is not None:
        others = [shape for shape in tried if shape != cause.shape]
        return (cause.shape, *_evenly(others, MOST_SHAPES - 1)), 1
    shapes = tuple(_evenly(tried, MOST_SHAPES))
    return shapes, len(shapes) if cause.effect.remembers else 1


def _evenly(shapes: Sequence[tuple[float, ...]], most: int) -> list[tuple[float, ...]]:
    if len(shapes) <= most:
        return list(shapes)
    return [shapes[int(k)] for k in np.linspace(0.0, len(shapes) - 1.0, most)]


def as_measured(poses: Poses, after: Poses | None, hold: Array | None = None) -> Poses:
    """Poses with the order, times and session that they have if they are measured in turn, `after` others.

    `hold`: (N,), how long the arm stands at each before it is measured, beside the usual pace (s).
    """
    number = np.arange(len(poses)) + 1 + (0 if after is None else max(after.names(np.arange(len(after))), default=0))
    timed = after is None or after.t is not None
    begun = 0.0 if after is None or after.t is None else float(np.max(after.t))
    waits = np.zeros(len(poses)) if hold is None else hold
    t: Array | None = np.asarray(begun + np.cumsum(PACE_S + waits)) if timed or hold is not None else None
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
