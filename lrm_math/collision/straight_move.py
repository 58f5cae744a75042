"""Straight moves in joint space, proven free of collision from end to end and not only at samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene

RESOLUTION = 5e-4
"""m: a move that keeps the margin is still refused if less than this is left, where the bound cannot tell."""
FIRST_STRETCH = 0.2
"""m: a move is first cut into stretches on which no two bodies shift against each other by more."""


@dataclass(frozen=True)
class Move:
    """What is known of a straight move.

    Attributes:
        free: whether all pairs of bodies keep the margin, all the way.
        distance: m, of the bodies `first` and `second` at `fraction` of the move (0 to 1): where it first comes within
            the margin, or, if free, the least among the poses looked at.
        proven: the part of the move, from its start, that is proven free; 1 if free.
        margin: m, that had to be kept.
    """

    free: bool
    distance: float
    first: str
    second: str
    fraction: float
    proven: float
    margin: float

    def __str__(self) -> str:
        met = f"{self.first} and {self.second} are {self.distance * 1e3:.1f} mm apart at {self.fraction:.1%} of the way"
        return f"free: {met}" if self.free else f"refused: {met}; {self.margin * 1e3:.1f} mm must be kept"


def check_move(scene: Scene, q0: ArrayLike, q1: ArrayLike, margin: float | None = None) -> Move:
    """Whether the nominal rigid arm keeps a margin on the straight way from q0 to q1, each (n,) in rad.

    No pair's distance changes faster than `scene.sweep` allows, so its distances at both ends of a stretch of the way
    bound those in between from below. A stretch where that bound is not above the margin is halved (Schwarzer, Saha &
    Latombe 2005). So a free move is free everywhere, not only at the poses looked at.

    The proof is of the rigid arm; its sag is the margin's to cover. All joints have to move together, each in
    proportion: a ramp gets the move as `plan.stream` cuts it.

    Args:
        margin: m; the one of the arm's file if None.

    Raises:
        LrmError: angles of the wrong shape or not finite, a margin below zero.
    """
    keep = scene.margin_or(margin)
    start = scene.pose(q0)
    way = scene.pose(q1) - start
    speed = scene.sweep @ np.abs(way)
    fastest = float(speed.max())

    def look(at: Array) -> _Looks:
        return _Looks(at, scene.distances(scene.frames(start + at[:, None] * way)))

    looks = look(np.linspace(0.0, 1.0, 2 + int(fastest / FIRST_STRETCH)))
    lo, hi = looks.take(slice(None, -1)), looks.take(slice(1, None))
    wall = looks.first_within(keep)
    while True:
        width = hi.at - lo.at
        proven = (lo.near + hi.near - speed * width[:, None] >= 2 * keep).all(axis=1)
        rest = ~proven & (lo.at <= wall)
        lo, hi, short = lo.take(rest), hi.take(rest), (width * fastest <= 2 * RESOLUTION)[rest]
        if short.all():
            break
        middle = look(0.5 * (lo.at + hi.at)[~short])
        looks = looks.also(middle)
        wall = min(wall, middle.first_within(keep), lo.take(short).at.min(initial=np.inf))
        lo, hi = (
            lo.take(short).also(lo.take(~short)).also(middle),
            hi.take(short).also(middle).also(hi.take(~short)),
        )
    if not len(lo.at):
        return _verdict(scene, looks, 1.0, keep)
    k = int(lo.at.argmin())
    return _verdict(scene, lo.take([k]).also(hi.take([k])), float(lo.at[k]), keep)


@dataclass(frozen=True, eq=False)
class _Looks:
    """Poses looked at: where on the move (N,), and the distance (N, pairs) of every pair there (m)."""

    at: Array
    near: Array

    def take(self, rows: slice | list[int] | NDArray[np.bool_]) -> _Looks:
        return _Looks(self.at[rows], self.near[rows])

    def also(self, others: _Looks) -> _Looks:
        return _Looks(np.concatenate([self.at, others.at]), np.concatenate([self.near, others.near]))

    def first_within(self, margin: float) -> float:
        """Where the first pose stands that comes within the margin; infinity if none does."""
        return float(self.at[self.near.min(axis=1) < margin].min(initial=np.inf))


def _verdict(scene: Scene, looks: _Looks, proven: float, margin: float) -> Move:
    row = int(looks.near.min(axis=1).argmin())
    pair = scene.pair_of(looks.near[row])
    return Move(proven == 1.0, pair.distance, pair.first, pair.second, float(looks.at[row]), proven, margin)
