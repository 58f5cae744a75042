"""Replication of a cause: whether it is chosen in both halves of the data, each fitted alone (split-half reliability).

Each candidate is estimated on one half, all parameters within their bounds, and predicts the other, and the reverse. A
cause replicates if it predicts both better than nothing does, and no other plain effect beats it in either. Halves are
every other block of the joint space, and where the order is known its first and second half; what depends on time needs
both of these.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.diagnosis.screening.bounded_fit import BoundedFit
from lrm_ident.diagnosis.screening.candidates import FORM
from lrm_ident.diagnosis.screening.linearised_fit import at_most_outliers
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import Screening
from lrm_ident.fitting.cross_validation import held_out_folds
from lrm_ident.residual.better_prediction import paired_z, paired_z_of_each
from lrm_ident.residual.thresholds import ONE_DEVIATION, Z_THRESHOLD
from lrm_math.arrays import Array

NEEDS_ALL_TIMES = frozenset({"time", "session"})
Halves = tuple[NDArray[np.int64], NDArray[np.int64]]


def replicates(screening: Screening, scored: ScoredCandidate, equivalent: Collection[str]) -> bool:
    """Whether an effect is chosen in both halves of the screened poses. `equivalent`: names that are as good as it,
    or were compared with it by refits."""
    rivals = [
        other
        for other in screening.scored
        if other.name != scored.name
        and other.name not in equivalent
        and not other.implausible
        and other.candidate.priority != FORM
        and not other.candidate.effect.is_free_form
    ]
    bounded = BoundedFit.of(screening)
    return all(_chosen(bounded, halves, scored, rivals) for halves in _halves(screening, scored))


def _halves(screening: Screening, scored: ScoredCandidate) -> Iterator[Halves]:
    data = screening.subset[1]
    odd = held_out_folds(data) % 2
    yield np.flatnonzero(odd == 0), np.flatnonzero(odd == 1)
    if data.poses.direction is not None and NEEDS_ALL_TIMES.isdisjoint(scored.candidate.effect.depends_on):
        order = np.argsort(data.pose, kind="stable")
        yield order[: len(order) // 2], order[len(order) // 2 :]


def _chosen(bounded: BoundedFit, halves: Halves, scored: ScoredCandidate, rivals: Sequence[ScoredCandidate]) -> bool:
    """Whether a candidate predicts both halves better than nothing, and none of the rivals does better."""
    if min(map(len, halves)) < 2:
        return False
    return all(
        _predicts_best(bounded.from_poses(training), half, scored, rivals) for half, training in (halves, halves[::-1])
    )


def _predicts_best(
    fit: BoundedFit, half: NDArray[np.int64], scored: ScoredCandidate, rivals: Sequence[ScoredCandidate]
) -> bool:
    """Whether a candidate predicts a half of the poses, of which the estimates are not made, better than the others."""
    before = fit.baseline.squares[half]

    def predicted(candidates: Sequence[ScoredCandidate]) -> Array:
        squares = np.array([each.squares[half] for each in fit.explain_each(candidates)]).reshape(-1, len(half))
        return at_most_outliers(squares, before)

    [own] = predicted([scored])
    if paired_z(own, before) < ONE_DEVIATION:
        return False
    return not (paired_z_of_each(predicted(rivals), own) > Z_THRESHOLD).any()
