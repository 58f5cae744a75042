"""Blocks of a cross-validation, and the rows that are compared between models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class HeldOutBlock:
    """One block of a cross-validation: rows `train` and `test`, and what the fit to `train` leaves of `test` (m).

    `test_turn`: (n, 3), that of orientations as rotation vectors (rad), NaN where not measured.
    `train_residual`: (M, 3), what it leaves of `train` (m). `weighted`: (n, R), what it leaves of `test` by its noise,
    of all that was measured, where correlations are stated.
    """

    train: NDArray[np.int64]
    test: NDArray[np.int64]
    train_residual: Array
    test_residual: Array
    weighted: Array | None = None
    test_turn: Array | None = None


def compared_residuals(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N, R), what is compared between models: held-out residuals, weighted by their noise where that is stated."""
    if any(block.weighted is None for block in blocks):
        return held_out_rows(blocks)
    tests = np.concatenate([block.test for block in blocks])
    rows = np.concatenate([block.weighted for block in blocks if block.weighted is not None])
    out = np.empty_like(rows)
    out[tests] = rows
    return out


def held_out_turns(blocks: Sequence[HeldOutBlock]) -> Array | None:
    """(N, 3), the held-out error of every orientation (rad), NaN where not measured; None where it is not known."""
    if not blocks or any(block.test_turn is None for block in blocks):
        return None
    turn = np.empty((sum(len(block.test) for block in blocks), 3))
    for block in blocks:
        turn[block.test] = block.test_turn
    return turn


def held_out_rows(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N, 3), the held-out residual of every pose (m)."""
    residual = np.empty((sum(len(block.test) for block in blocks), 3))
    for block in blocks:
        residual[block.test] = block.test_residual
    return residual


def squared(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N,), squared norms of `compared_residuals`."""
    return np.asarray((compared_residuals(blocks) ** 2).sum(axis=1))
