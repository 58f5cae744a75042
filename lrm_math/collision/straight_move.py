"""Continuous collision check of straight moves in joint space (Schwarzer, Saha & Latombe 2005)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene

RESOLUTION = 5e-4
"""m: bisection ends here; a move that keeps the margin by less than this may still be refused."""
FIRST_INTERVAL = 0.2
"""m: a move is first cut into intervals on which no two bodies move against each other by more."""
LEAST_AXIS_DISTANCE = 1e-3
"""m: axes nearer than this count as so far apart in the bound of curvature, which has a pole where they meet."""
ROUND_OFF = 1e-9
"""m."""
MOVES = 64
"""Straight moves that are checked at once."""


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


@dataclass(frozen=True, eq=False)
class ArmBodies:
    """The bodies of one arm, rigid or elastic, along a motion of its joints.

    `separations`: (N, pairs) of poses (N, n), m. `rate`: bound on how fast these change, as a multiple of the rigid
    arm's. `step`: largest joint step between the first samples (rad).
    """

    scene: Scene
    separations: Callable[[Array], Array]
    rate: float = 1.0
    step: float = np.inf

    def separation(self, q: ArrayLike) -> float:
        """The smallest separation (m) of one pose (n,) in rad."""
        return float(self.separations(np.atleast_2d(q)).min())


def rigid_bodies(scene: Scene) -> ArmBodies:
    """The bodies of the nominal rigid arm."""
    return ArmBodies(scene, lambda q: scene.separations(scene.frames(q)))


def check_path(bodies: ArmBodies, path: Array, keep: float | Array) -> tuple[MotionClearance, int]:
    """Whether all pairs of bodies keep a separation (m, below zero for an overlap) on straight moves through poses
    (K, n) in rad, and the number, from 0, of the move that this is of: the first that is not free, or the nearest one.

    `keep`: one separation for all pairs, or (pairs,), one for each.

    The separations at both ends of an interval bound those inside from below (`_Motions.lower_bound`). An interval
    where that bound is below `keep` is bisected. So a free move is free everywhere, not only at the poses sampled, as
    far as `bodies.rate` is right: for the rigid arm it is.
    """
    clearances: list[tuple[MotionClearance, int]] = []
    for first in range(0, len(path) - 1, MOVES):
        clearance, move = _check_moves(bodies, path[first : first + MOVES + 1], keep)
        clearances.append((clearance, first + move))
        if not clearance.free:
            return clearances[-1]
    return min(clearances, key=lambda clearance: clearance[0].distance - clearance[0].margin)


def _check_moves(bodies: ArmBodies, path: Array, keep: float | Array) -> tuple[MotionClearance, int]:
    """`check_path` of a few moves, all of them at once: a place is the number of its move and its fraction of it."""
    travel, last = np.diff(path, axis=0), len(path) - 2
    motions = _Motions.of(bodies, travel)

    def sample(at: Array) -> _Samples:
        move = np.minimum(at.astype(np.intp), last)
        return _Samples(at, bodies.separations(path[move] + (at - move)[:, None] * travel[move]))

    pieces = np.maximum(motions.fastest / FIRST_INTERVAL, np.abs(travel).max(axis=1) / bodies.step).astype(np.intp) + 1
    parts = [move + np.arange(count) / count for move, count in enumerate(pieces.tolist())]
    samples = sample(np.concatenate([*parts, [last + 1.0]]))
    lo, hi = samples.take(slice(None, -1)), samples.take(slice(1, None))
    violated = samples.first_within(keep)
    while True:
        width, move = hi.at - lo.at, lo.at.astype(np.intp)
        proven = (motions.lower_bound(lo.near, hi.near, width, move) >= keep - ROUND_OFF).all(axis=1)
        rest = ~proven & (lo.at <= violated)
        lo, hi, short = lo.take(rest), hi.take(rest), (width * motions.fastest[move] <= 2 * RESOLUTION)[rest]
        if short.all():
            break
        middle = sample(0.5 * (lo.at + hi.at)[~short])
        samples = samples.joined(middle)
        violated = min(violated, middle.first_within(keep), lo.take(short).at.min(initial=np.inf))
        lo, hi = lo.take(short).joined(lo.take(~short), middle), hi.take(short).joined(middle, hi.take(~short))
    if not len(lo.at):
        return _result(bodies.scene, samples, None, keep, last)
    k = int(lo.at.argmin())
    return _result(bodies.scene, lo.take([k]).joined(hi.take([k])), float(lo.at[k]), keep, int(lo.at[k]))


@dataclass(frozen=True, eq=False)
class _Motions:
    """Bounds on M straight moves, per pair of bodies: `speed` (M, pairs), m per move, and `acceleration` (M, pairs), m
    per move², of any two points against each other, infinite where it has no bound; `radii`, by which the distance of
    the axes exceeds the separation; `fastest` (M,), the largest speed."""

    speed: Array
    acceleration: Array
    radii: Array
    fastest: Array

    @classmethod
    def of(cls, bodies: ArmBodies, travel: Array) -> _Motions:
        """Bounds for moves that travel so far (rad)."""
        turned = np.abs(travel)
        speed = bodies.rate * (turned @ bodies.scene.motion_bound.T)
        bend = 2.0 * bodies.rate * turned.sum(axis=1, keepdims=True) * speed
        acceleration = np.where(bodies.scene.curved, bend, np.inf)
        return cls(speed, acceleration, bodies.scene.radii, speed.max(axis=1))

    def lower_bound(self, lo: Array, hi: Array, width: Array, move: NDArray[np.intp]) -> Array:
        """A lower bound of separations on N intervals of `width` (N,) of moves (N,), with `lo` and `hi` (N, pairs) at
        their ends.

        The better one of two. No separation changes faster than `speed`. And the distance of two points has a second
        derivative of at most speed² / distance + acceleration =: c; so has the least over all points of two axes. Where
        it is at most c, f lies above its chord by no more than c t (width − t) / 2 below it: a move that leaves an
        obstacle is above its start at once.
        """
        speed, width = self.speed[move], width[:, None]
        mean, rise = 0.5 * (lo + hi), np.abs(hi - lo)
        slack = 0.5 * speed * width
        axes = np.maximum(np.minimum(lo, hi) + self.radii - slack, LEAST_AXIS_DISTANCE)
        sag = 0.5 * (speed**2 / axes + self.acceleration[move]) * width**2
        inner = mean - 0.25 * sag - 0.25 * rise**2 / np.where(sag > 0.0, sag, 1.0)
        return np.asarray(np.maximum(mean - slack, np.where(rise >= sag, np.minimum(lo, hi), inner)))


@dataclass(frozen=True, eq=False)
class _Samples:
    """Sampled poses: fraction of the move (N,), and the separation (N, pairs) of every pair there (m)."""

    at: Array
    near: Array

    def take(self, rows: slice | list[int] | NDArray[np.bool_]) -> _Samples:
        return _Samples(self.at[rows], self.near[rows])

    def joined(self, *others: _Samples) -> _Samples:
        parts = (self, *others)
        return _Samples(np.concatenate([part.at for part in parts]), np.concatenate([part.near for part in parts]))

    def first_within(self, keep: float | Array) -> float:
        """Fraction of the first pose that comes within what has to be kept; infinity if none does."""
        return float(self.at[(self.near < keep - ROUND_OFF).any(axis=1)].min(initial=np.inf))


def _result(
    scene: Scene, samples: _Samples, proven: float | None, keep: float | Array, move: int
) -> tuple[MotionClearance, int]:
    """The clearance of a move, not free, proven up to a place; None: of the nearest sample, all moves up to this one
    being free."""
    required = np.broadcast_to(keep, samples.near.shape[1])
    slack = samples.near - required
    row = int(slack.min(axis=1).argmin())
    pair, at = int(slack[row].argmin()), float(samples.at[row])
    move = min(int(at), move) if proven is None else move
    first, second = scene.names[pair].tolist()
    distance, share = float(samples.near[row, pair]), 1.0 if proven is None else proven - move
    return MotionClearance(proven is None, distance, first, second, at - move, share, float(required[pair])), move
