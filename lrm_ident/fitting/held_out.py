"""Blocks of a cross-validation, and the held-out residuals that they add up to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class HeldOutBlock:
    """One block of a cross-validation: a fit to training rows, and its residuals (measured − predicted).

    Attributes:
        train, test: (M,), training rows, of many some; (n,), rows left out.
        train_residual, test_residual: (M, 3) and (n, 3), of the TCP position (m).
        weighted: (n, R), whitened test residual of all that was measured, times the whitening's unit (m); None where
            no correlations are stated.
        test_turn: (n, 3), test residual of the orientation as rotation vectors (rad), NaN where not measured.
        deployed_residual: (n, 3), of the TCP (m) where the fit is used `as_deployed_at` these poses; None: as
            `test_residual`.
        time_unknown_residual: (n, 3), the same where neither the time since power-on is known nor what the arm did
            before; None: that changes nothing.
    """

    train: NDArray[np.int64]
    test: NDArray[np.int64]
    train_residual: Array
    test_residual: Array
    weighted: Array | None = None
    test_turn: Array | None = None
    deployed_residual: Array | None = None
    time_unknown_residual: Array | None = None

    @property
    def deployed(self) -> Array:
        """(n, 3), test residual of the fit as it is deployed (m)."""
        return self.test_residual if self.deployed_residual is None else self.deployed_residual


def held_out_turns(blocks: Sequence[HeldOutBlock]) -> Array | None:
    """(N, 3), held-out error of every orientation (rad), NaN where not measured; None where no orientation was."""
    return _in_order(blocks, [block.test_turn for block in blocks])


def held_out_residual(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N, 3), held-out residual of every pose (m)."""
    rows = _in_order(blocks, [block.test_residual for block in blocks])
    return np.empty((0, 3)) if rows is None else rows


def deployed_residual(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N, 3), held-out residual of every pose where each fold's fit is used as it is deployed (m)."""
    rows = _in_order(blocks, [block.deployed for block in blocks])
    return np.empty((0, 3)) if rows is None else rows


def time_unknown_residual(blocks: Sequence[HeldOutBlock]) -> Array | None:
    """(N, 3), `deployed_residual` where nothing is known of before (m); None where that changes nothing."""
    return _in_order(blocks, [block.time_unknown_residual for block in blocks])


def held_out_squares(blocks: Sequence[HeldOutBlock]) -> Array:
    """(N,), squares by which models are compared: of held-out residuals, weighted by their noise where it is stated."""
    weighted = _in_order(blocks, [block.weighted for block in blocks])
    return np.asarray(((held_out_residual(blocks) if weighted is None else weighted) ** 2).sum(axis=1))


def _in_order(blocks: Sequence[HeldOutBlock], parts: Sequence[Array | None]) -> Array | None:
    """(N, R), values (n, R) at the `test` rows of each block in the order of the poses; None where a block has none."""
    present = [part for part in parts if part is not None]
    if not present or len(present) < len(blocks):
        return None
    out = np.empty((sum(map(len, present)), present[0].shape[1]))
    out[np.concatenate([block.test for block in blocks])] = np.concatenate(present)
    return out
