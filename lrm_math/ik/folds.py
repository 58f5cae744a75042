"""Where axes nearly line up, some motion of the joints hardly moves the tool: ways to a pose meet there, at a fold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.chain import Array
from lrm_math.ik.linkage import Linkage
from lrm_math.ik.newton import Aim


@dataclass(frozen=True, eq=False)
class Slowest:
    """The motion of the joints that moves the tool least, at K places.

    Attributes:
        slope: (K,), how fast the tool goes: m/rad, turns weighed by `newton.LEVER`.
        along: (K, n), how the joints turn, the one that turns most by 1.
        across: (K, rows), which way the tool goes, a unit vector.
    """

    slope: Array
    along: Array
    across: Array

    @classmethod
    def of(cls, linkage: Linkage, aim: Aim, amounts: Array) -> Slowest:
        """At amounts (K, V) of the moving slots (rad, m)."""
        across, slopes, along = np.linalg.svd(_by_joint(linkage, aim, amounts), full_matrices=False)
        largest = np.abs(along[:, -1]).max(axis=1, keepdims=True)
        return cls(slopes[:, -1] / largest[:, 0], along[:, -1] / largest, across[:, :, -1])

    def take(self, rows: NDArray[np.bool_]) -> Slowest:
        """Some of the places."""
        return Slowest(self.slope[rows], self.along[rows], self.across[rows])

    def slope_at(self, linkage: Linkage, aim: Aim, amounts: Array) -> Array:
        """(K,), how fast the tool goes the same way with the same motion at amounts (K, V): m/rad."""
        return np.asarray(np.einsum("kr,krn,kn->k", self.across, _by_joint(linkage, aim, amounts), self.along))


def _by_joint(linkage: Linkage, aim: Aim, amounts: Array) -> Array:
    """(K, rows, n), the Jacobian of the joints."""
    placed = linkage.place(amounts)
    return aim.rows_of(linkage.jacobian(placed), placed.tcp)[:, :, linkage.joints]
