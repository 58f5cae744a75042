"""Central differences with respect to every value of a chain, all steps in one batch of poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arrays import Array


def stepped(values: Sequence[object], slots: Sequence[int], poses: int, h: float) -> list[Array]:
    """Slot values of len(slots) blocks of N = `poses` poses; in the k-th block, slot `slots[k]` is larger by h."""
    out = [np.tile(np.broadcast_to(np.asarray(value, dtype=float), poses), len(slots)) for value in values]
    for block, slot in enumerate(slots):
        out[slot][block * poses : (block + 1) * poses] += h
    return out
