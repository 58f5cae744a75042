"""Likely shapes of an effect that has many: a periodogram of the residual as a motion of the slot that it moves.

A frequency, or a time constant with what was before it, has hundreds of values to try. The residual is projected on
the motion that the effect's slot makes, where each value costs a few numbers a pose, and only the likely ones are then
tried beside everything that is fitted. p values are corrected for all.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from lrm_ident.diagnosis.screening.candidates import Candidate
from lrm_math.arrays import Array
from lrm_math.effects.targets import Kind, kind_of, slot_of

MANY, LIKELY = 12, 4
"""Shapes that are all tried; of more, those that are tried."""
APART = 3
"""Neighbours of a likely shape that are not tried, since it stands for them."""
NO_RANK = 1e-12
"""Part of the sum of squares below which a direction is round-off."""


def with_likely_shapes(candidate: Candidate, residual: Array) -> Candidate:
    """The candidate with the likely ones of many shapes, by the residual (N, 3) that a fit leaves (m).

    Its amounts are linear in the parameters that are no shapes, and zero without them.
    """
    effect = candidate.effect
    if len(candidate.shapes) <= MANY or kind_of(effect) is not Kind.MOTION:
        return candidate
    settled, slots = candidate.response.equilibrium, candidate.response.equilibrium.model.load_slots
    index = settled.model.chain.index
    motions = [candidate.response.slots[index[slot_of(target)]][:3] for target in effect.targets]
    tau = tuple(settled.tau[slots.index(index[slot])] for slot in effect.load_slots)
    ones = np.ones(len(residual))
    beside = [motion * part for motion in motions for part in (ones, *tau)]
    fitted, _ = np.linalg.qr(np.concatenate([motion.reshape(1, -1) for motion in beside]).T)
    error = np.nan_to_num(residual.T).reshape(-1)
    error = error - fitted @ (fitted.T @ error)

    columns = np.empty((len(candidate.shapes), len(candidate.rows), len(error)))
    for column, (shape, row) in zip(
        columns.reshape(-1, len(error)), product(candidate.shapes, candidate.rows), strict=True
    ):
        amounts = effect.amounts(settled.poses, tau, [1.0 if i == row else p for i, p in enumerate(shape)])
        column[:] = sum(m * amount for m, amount in zip(motions, amounts, strict=True)).reshape(-1)
    gains = _explained(columns, fitted, error)
    likely: list[int] = []
    for number in np.argsort(-gains).tolist():
        if len(likely) < LIKELY and all(abs(number - other) > APART for other in likely):
            likely.append(number)
    return replace(candidate, shapes=tuple(candidate.shapes[i] for i in sorted(likely)), scanned=len(gains))


def _explained(columns: Array, fitted: Array, error: Array) -> Array:
    """(S,), square of the error (3 N,) that each of S sets of columns (S, k, 3 N) takes beside those `fitted` (m²)."""
    beside, along = columns @ fitted, columns @ error
    gram = columns @ columns.transpose(0, 2, 1)
    gram += NO_RANK * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(gram.shape[1])
    gram -= beside @ beside.transpose(0, 2, 1)
    return np.asarray(np.einsum("sk,skl,sl->s", along, np.linalg.pinv(gram, rcond=NO_RANK), along))
