"""Folds: singular configurations, where axes line up and two solutions of the inverse meet (Borrel & Liégeois 1986).

Near one, some motion of the joints hardly moves the tool: the right singular vector of the Jacobian that belongs to its
smallest singular value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.linkage import Linkage
from lrm_math.ik.newton import Aim, Reached

STEPS_ASIDE = (0.03, 0.1)
"""rad: how far to step off a fold."""


@dataclass(frozen=True, eq=False)
class Slowest:
    """The motion of the joints that moves the tool least, at K places.

    Attributes:
        slope: (K,), how fast the tool goes: m/rad, turns weighed by `newton.LEVER`; but for the scale of `along` the
            smallest singular value.
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


def beside_folds(linkage: Linkage, aim: Aim, reached: Reached, count: int) -> Array:
    """(M, V), starts on both sides of where the `count` best candidates that miss the goal are stuck.

    Where two solutions merge, a joint motion leaves the tool where it is, and descent may end on the ridge between
    the two: the way on is along that motion, either way.
    """
    best = np.flatnonzero(~reached.met)[np.argsort(reached.miss[~reached.met])][:count]
    amounts = reached.amounts[best]
    still = np.linalg.svd(_by_joint(linkage, aim, amounts))[2][:, -1]
    out = np.concatenate([amounts] * (2 * len(STEPS_ASIDE)))
    out[:, linkage.joints] += np.concatenate([way * size * still for size in STEPS_ASIDE for way in (1.0, -1.0)])
    return out


def _by_joint(linkage: Linkage, aim: Aim, amounts: Array) -> Array:
    """(K, rows, n), the Jacobian of the joints."""
    placed = linkage.place(amounts)
    return aim.rows_of(linkage.jacobian(placed), placed.tcp)[:, :, linkage.joints]
