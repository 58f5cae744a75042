"""Change of the measuring frame within a file: the tracker, or the arm's base, was moved between two poses.

Each side of every split that is tried is registered to the arm on its own (Kabsch 1976), and scored by the coarse fit.
The pose is then the one at which the distances from both registered sides add up to the least (a change point by least
absolute deviations, Bai 1995).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.coarse_fit import coarse_fit
from lrm_ident.data.registration.point_set import registered
from lrm_ident.data.registration.row_choice import drawn_rows
from lrm_ident.data.registration.similarity import Similarity
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

SPLITS = 6
MOST_POSES = 60
"""Poses of each side by which a split is scored."""


@dataclass(frozen=True, eq=False)
class MovedFrame:
    """Poses `first` to `last` are in another frame than those before: turned by `angle` (rad), and moved by `distance`
    (m, at their centre). `score`: what a coarse fit of the worse side misses (m)."""

    first: int
    last: int
    angle: float
    distance: float
    score: float


@dataclass(frozen=True, eq=False)
class _Side:
    """Poses on one side of a split: the motion into the arm's frame, the fitted arm there, and its score (m)."""

    motion: Similarity
    model: Model
    score: float

    @staticmethod
    def of(arm: Arm, poses: Poses, tcp: Array) -> _Side | None:
        """The side, registered; None for too few poses to tell anything."""
        seen, motion = registered(arm, poses, tcp)
        fitted = coarse_fit(arm, poses, seen, fixed_base=True)
        return _Side(motion, fitted.equilibrium.model, fitted.score) if fitted.overdetermined else None


def moved_frame(arm: Arm, data: Measurements) -> MovedFrame | None:
    """The change of frame that leaves the least, of measurements in the order of their rows; None for too few poses."""
    rows, boundaries = data.positions.rows, _splits(data)
    split = min(filter(None, (_split(arm, data, first) for first in boundaries)), key=_missed, default=None)
    if split is None:
        return None
    far = np.stack([_far(side, data.poses.take(rows), data.tcp[rows]) for side in split])
    first = int(np.argmin(np.concatenate([[0.0], np.cumsum(far[0] - far[1])])))
    exact = _split(arm, data, first)
    if exact is None:
        return None
    before, after = exact
    centre = data.tcp[rows[first:]].mean(axis=0)
    turn = before.motion.rotation.T @ after.motion.rotation
    there = (after.motion.apply(centre[None]) - before.motion.translation) @ before.motion.rotation
    angle = float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
    there_first, there_last = data.pose[rows[[first, -1]]].tolist()
    return MovedFrame(there_first, there_last, angle, float(np.linalg.norm(there - centre)), _missed(exact))


def _splits(data: Measurements) -> list[int]:
    """Numbers of rows before which the frame may have changed: where a session begins, and evenly spaced ones."""
    count, session = len(data.positions.rows), data.poses.session
    even = np.linspace(0, count, SPLITS + 1)[1:-1].astype(int).tolist()
    begun = [] if session is None else (np.flatnonzero(np.diff(session[data.positions.rows])) + 1).tolist()
    return [*begun[:SPLITS], *even]


def _split(arm: Arm, data: Measurements, first: int) -> tuple[_Side, _Side] | None:
    """Both sides of a split; None where one has too few poses."""
    sides = []
    for part in (data.positions.rows[:first], data.positions.rows[first:]):
        if not len(part):
            return None
        chosen = part[drawn_rows(len(part), MOST_POSES)]
        side = _Side.of(arm, data.poses.take(chosen), data.tcp[chosen])
        if side is None:
            return None
        sides.append(side)
    return sides[0], sides[1]


def _missed(sides: tuple[_Side, _Side]) -> float:
    """What the worse side misses (m)."""
    return max(side.score for side in sides)


def _far(side: _Side, poses: Poses, tcp: Array) -> Array:
    """(N,), distances (m) of positions from a side's arm."""
    return np.asarray(np.linalg.norm(side.motion.apply(tcp) - solve_equilibrium(side.model, poses).tcp, axis=1))
