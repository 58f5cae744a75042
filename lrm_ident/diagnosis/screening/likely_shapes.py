"""Likely shapes of an effect that has many: a periodogram of the residual as a motion of the slot that it moves.

A frequency, or a time constant with what was before it, has hundreds of values to try. The residual is projected on
the motion that the effect's slot makes, where each value costs a few numbers a pose, and only the likely ones are then
tried beside everything that is fitted. p values are corrected for all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.diagnosis.screening.candidates import Candidate
from lrm_math.arrays import Array
from lrm_math.effects.derivatives import by_parameters
from lrm_math.effects.targets import Kind, kind_of, slot_of

MANY, LIKELY = 12, 4
"""Shapes that are all tried; of more, those that are tried."""
APART = 3
"""Neighbours of a likely shape that are not tried, since it stands for them."""
NO_RANK = 1e-8


def with_likely_shapes(candidate: Candidate, residual: Array) -> Candidate:
    """The candidate with the likely ones of many shapes, by the residual (N, 3) that a fit leaves (m)."""
    effect = candidate.effect
    if len(candidate.shapes) <= MANY or len(effect.targets) != 1 or kind_of(effect) is not Kind.MOTION:
        return candidate
    settled, slots = candidate.response.equilibrium, candidate.response.equilibrium.model.load_slots
    index = settled.model.chain.index
    motion = candidate.response.slots[index[slot_of(effect.targets[0])]][:3]
    tau = tuple(settled.tau[slots.index(index[slot])] for slot in effect.load_slots)
    size = np.sqrt((motion**2).sum(axis=0))
    seen = (motion * np.nan_to_num(residual.T)).sum(axis=0) / np.where(size > 0.0, size, 1.0)
    fitted, _ = np.linalg.qr(size[:, None] * np.column_stack([np.ones(len(size)), *tau]))
    seen = seen - fitted @ (fitted.T @ seen)

    def explained(shape: tuple[float, ...]) -> float:
        rows = by_parameters(effect, settled.poses, tau, shape, settled.model.within)
        columns = size[:, None] * np.stack([np.broadcast_to(rows[row][0], len(size)) for row in candidate.rows], axis=1)
        own, along, _ = np.linalg.svd(columns - fitted @ (fitted.T @ columns), full_matrices=False)
        return float(((own[:, along > NO_RANK * np.linalg.norm(columns)].T @ seen) ** 2).sum())

    gains = np.array([explained(shape) for shape in candidate.shapes])
    likely: list[int] = []
    for number in np.argsort(-gains).tolist():
        if len(likely) < LIKELY and all(abs(number - other) > APART for other in likely):
            likely.append(number)
    return replace(candidate, shapes=tuple(candidate.shapes[i] for i in sorted(likely)), scanned=len(gains))
