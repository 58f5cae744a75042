"""Held-out error: each pose predicted by a model that never saw it nor its neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.levenberg_marquardt import Bounds, fit
from lrm_ident.fit.loss import Loss
from lrm_ident.fit.priors import Prior
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model

FOLDS = 10


def blocks(q: Array, repeat_of: NDArray[np.int64], count: int = FOLDS) -> NDArray[np.int64]:
    """(N,), number of the joint-space block of each pose.

    The poses are halved again and again along the joint that spreads most, in parts that differ in size by at most
    one pose (a k-d tree; Bentley 1975), so that neighbours stay together. Poses of equal angles and repetitions of a
    pose are never parted.

    Args:
        q: (N, n), rad.
        repeat_of: (N,), equal numbers belong together.

    Raises:
        LrmError: fewer distinct poses than blocks.
    """
    same = _groups(q, repeat_of)
    first = np.unique(same, return_index=True)[1]
    if len(first) < count:
        raise LrmError(f"{len(first)} distinct poses for {count} folds; measure at least {count}")
    label = np.empty(len(first), dtype=np.int64)
    next_label = iter(range(count))
    for part in _halve(q[first], np.arange(len(first)), count):
        label[part] = next(next_label)
    return label[same]


def _groups(q: Array, repeat_of: NDArray[np.int64]) -> NDArray[np.int64]:
    _, by_angle = np.unique(np.round(q, 6), axis=0, return_inverse=True)
    _, by_name = np.unique(repeat_of, return_inverse=True)
    group = by_angle.reshape(-1)
    while True:
        lowest = np.full(by_name.max() + 1, len(q))
        np.minimum.at(lowest, by_name, group)
        merged = lowest[by_name]
        lowest = np.full(group.max() + 1, len(q))
        np.minimum.at(lowest, group, merged)
        merged = lowest[group]
        if np.array_equal(merged, group):
            return np.unique(group, return_inverse=True)[1].reshape(-1)
        group = merged


def _halve(q: Array, rows: NDArray[np.int64], count: int) -> Iterator[NDArray[np.int64]]:
    if count == 1:
        yield rows
        return
    joint = int(np.argmax(q[rows].std(axis=0)))
    order = rows[np.lexsort((*q[rows].T, q[rows, joint]))]
    left = count // 2
    cut = round(len(rows) * left / count)
    yield from _halve(q, order[:cut], left)
    yield from _halve(q, order[cut:], count - left)


def held_out(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss | None = None,
    progress: Tick = silent,
    count: int = FOLDS,
    prior: Prior | None = None,
) -> Array:
    """(N, 3), measured − predicted TCP (m), each block predicted by a fit of the model's free parameters to the others.

    Raises:
        LrmError: too few poses, or a fold that does not converge.
    """
    fold = blocks(data.poses.q, data.repeat_of, count)
    residual = np.empty_like(data.tcp)
    for number in range(count):
        left_out = fold == number
        fitted = fit(model, data.take(~left_out), bounds, loss, prior).model if model.free else model
        residual[left_out] = data.tcp[left_out] - equilibrium(fitted, data.poses.take(left_out)).tcp
        progress(number + 1, count)
    return residual
