"""Continuous collision check of straight moves in joint space (Schwarzer, Saha & Latombe 2005)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene

RESOLUTION = 5e-4
"""m: bisection ends here; a move that keeps the margin by less than this may still be refused."""
FIRST_INTERVAL = 0.2
"""m: a move is first cut into intervals on which no two bodies move against each other by more."""


@dataclass(frozen=True)
class MotionClearance:
    """The result of the collision check of a straight move.

    Attributes:
        free: whether all pairs of bodies keep the margin on the whole move.
        distance: m, of the bodies `first` and `second` at `fraction` of the move (0 to 1): where it first comes within
            the margin, or, if free, the least of the poses sampled.
        proven: the part of the move, from its start, that is proven free; 1 if free.
        margin: m, required.
    """

    free: bool
    distance: float
    first: str
    second: str
    fraction: float
    proven: float
    margin: float

    def __str__(self) -> str:
        apart = f"{self.first} and {self.second} are {self.distance * 1e3:.1f} mm apart"
        closest = f"{apart} at {self.fraction:.1%} of the way"
        return f"free: {closest}" if self.free else f"refused: {closest}; {self.margin * 1e3:.1f} mm must be kept"


def check_move(scene: Scene, q0: ArrayLike, q1: ArrayLike, margin: float | None = None) -> MotionClearance:
    """Whether the nominal rigid arm keeps a margin on the straight move from q0 to q1, each (n,) in rad.

    `scene.motion_bound` bounds the rate of change of every distance, so the distances at both ends of an interval bound
    those inside from below. An interval where that bound is not above the margin is bisected (Schwarzer, Saha & Latombe
    2005). So a free move is free everywhere, not only at the poses sampled.

    The proof holds for the rigid arm; the margin has to cover elastic deflection. All joints have to move in
    proportion: a ramp gets the move as `rrt_connect.interpolate_path` cuts it.

    Args:
        margin: m; the one of the arm's file if None.

    Raises:
        LrmError: angles of the wrong shape or not finite, a margin below zero.
    """
    keep = scene.margin_or_default(margin)
    start = scene.pose(q0)
    travel = scene.pose(q1) - start
    speed = scene.motion_bound @ np.abs(travel)
    fastest = float(speed.max())

    def sample(at: Array) -> _Samples:
        return _Samples(at, scene.distances(scene.frames(start + at[:, None] * travel)))

    samples = sample(np.linspace(0.0, 1.0, 2 + int(fastest / FIRST_INTERVAL)))
    lo, hi = samples.take(slice(None, -1)), samples.take(slice(1, None))
    violated = samples.first_within(keep)
    while True:
        width = hi.at - lo.at
        proven = (lo.near + hi.near - speed * width[:, None] >= 2 * keep).all(axis=1)
        rest = ~proven & (lo.at <= violated)
        lo, hi, short = lo.take(rest), hi.take(rest), (width * fastest <= 2 * RESOLUTION)[rest]
        if short.all():
            break
        middle = sample(0.5 * (lo.at + hi.at)[~short])
        samples = samples.joined(middle)
        violated = min(violated, middle.first_within(keep), lo.take(short).at.min(initial=np.inf))
        lo, hi = lo.take(short).joined(lo.take(~short), middle), hi.take(short).joined(middle, hi.take(~short))
    if not len(lo.at):
        return _result(scene, samples, 1.0, keep)
    k = int(lo.at.argmin())
    return _result(scene, lo.take([k]).joined(hi.take([k])), float(lo.at[k]), keep)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Sampled poses: fraction of the move (N,), and the distance (N, pairs) of every pair there (m)."""

    at: Array
    near: Array

    def take(self, rows: slice | list[int] | NDArray[np.bool_]) -> _Samples:
        return _Samples(self.at[rows], self.near[rows])

    def joined(self, *others: _Samples) -> _Samples:
        parts = (self, *others)
        return _Samples(np.concatenate([part.at for part in parts]), np.concatenate([part.near for part in parts]))

    def first_within(self, margin: float) -> float:
        """Fraction of the first pose that comes within the margin; infinity if none does."""
        return float(self.at[self.near.min(axis=1) < margin].min(initial=np.inf))


def _result(scene: Scene, samples: _Samples, proven: float, margin: float) -> MotionClearance:
    row = int(samples.near.min(axis=1).argmin())
    pair, fraction = scene.closest_pair(samples.near[row]), float(samples.at[row])
    return MotionClearance(proven == 1.0, pair.distance, pair.first, pair.second, fraction, proven, margin)
