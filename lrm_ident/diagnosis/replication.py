"""Replication of a cause: whether it is chosen in both halves of the data, each fitted alone (split-half reliability).

Each candidate is estimated on one half and predicts the other, and the reverse. A cause replicates if it
predicts both better than nothing does, and no other plain effect beats it in either. Halves are every other block of
the joint space, and where the order is known its first and second half; what depends on time needs both of these.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.candidates import FORM
from lrm_ident.diagnosis.screening.column_sets import columns_of, side_by_side
from lrm_ident.diagnosis.screening.linearised_fit import LinearisedFit, linearise
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import Screening
from lrm_ident.fitting.cross_validation import held_out_folds
from lrm_ident.residual.better_prediction import paired_z, paired_z_of_each
from lrm_ident.residual.thresholds import ONE_DEVIATION, Z_THRESHOLD

NEEDS_ALL_TIMES = frozenset({"time", "session"})
Halves = tuple[NDArray[np.int64], NDArray[np.int64]]


def replicates(screening: Screening, one: ScoredCandidate, equivalent: Collection[str]) -> bool:
    """Whether an effect is chosen in both halves of the screened poses. `equivalent`: names that are as good as it,
    or were compared with it by refits."""
    rivals = [
        number
        for number, other in enumerate(screening.scored)
        if other.name != one.name
        and other.name not in equivalent
        and not other.implausible
        and other.candidate.priority != FORM
        and not other.candidate.effect.is_free_form
    ]
    row = screening.scored.index(one)
    return all(_chosen(screening, halves, row, rivals) for halves in _halves(screening, one))


def _halves(screening: Screening, one: ScoredCandidate) -> Iterator[Halves]:
    data = screening.subset[1]
    odd = held_out_folds(data) % 2
    yield np.flatnonzero(odd == 0), np.flatnonzero(odd == 1)
    if data.poses.direction is not None and NEEDS_ALL_TIMES.isdisjoint(one.candidate.effect.depends_on):
        order = np.argsort(data.pose, kind="stable")
        yield order[: len(order) // 2], order[len(order) // 2 :]


def _chosen(screening: Screening, halves: Halves, own: int, rivals: Collection[int]) -> bool:
    """Whether candidate number `own` predicts both halves better than nothing, and none of the rivals does better."""
    if min(map(len, halves)) < 2:
        return False
    linear, place = _in_halves(screening.linear, halves), columns_of(screening.sets.stacks)
    each = [screening.sets.columns[:, place[number]] for number in (own, *rivals)]
    columns, stacks = side_by_side(each, len(linear.residual))
    rows = np.argsort(screening.linear.order)[linear.order]
    held_out, *rest = (one.held_out for one in linear.explain_each(linear.in_folds(columns[rows], stacks)))
    others, before = np.array(rest).reshape(-1, len(held_out)), linear.baseline.held_out
    return all(
        paired_z(held_out[half], before[half]) >= ONE_DEVIATION
        and not (paired_z_of_each(others[:, half], held_out[half]) > Z_THRESHOLD).any()
        for half in halves
    )


def _in_halves(linear: LinearisedFit, halves: Halves) -> LinearisedFit:
    """The same fit, its folds two halves."""
    measured, prior = slice(0, linear.measured), slice(linear.measured, None)
    return linearise(
        linear.basis[measured],
        linear.residual[measured],
        halves,
        linear.sigma,
        (linear.basis[prior], linear.residual[prior]),
    )
