"""A recording of a tracker as arrays, whatever program exported it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.rigid_motion import rotation_matrix
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame
from lrm_math.arrays import Array
from lrm_math.errors import FileError, UnknownName

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

LEAST_FRAMES = 100
TOOL, BASE = 1, 0
"""Numbers of the two bodies in the frames of a rest."""


@dataclass(frozen=True, eq=False)
class BodyTrack:
    """One body over N frames: `position` (N, 3) in m, NaN where it was not seen.

    `rotation`: (N, 3, 3), columns its axes in the room; None if the file has none that can be understood, and then
    `unknown_rotation` says why.
    """

    position: Array
    rotation: Array | None = None
    unknown_rotation: str = "the file has positions only"


@dataclass(frozen=True, eq=False)
class RecordedTake:
    """N frames of named bodies. `t`: (N,), time of each frame (s)."""

    path: Path
    t: Array
    bodies: Mapping[str, BodyTrack]

    def pair(self, tool: str | None, base: str | None) -> BodyPair:
        """The body at the tip, and the one at the base if there is one.

        Raises `UnknownName`; `FileError`: several bodies and none named, or a base without rotations.
        """
        if tool is None:
            if len(self.bodies) != 1:
                raise FileError(self.path, "", f"{len(self.bodies)} bodies: {', '.join(self.bodies)}", "name --tool")
            tool = next(iter(self.bodies))
        for name in (tool, base):
            if name is not None and name not in self.bodies:
                raise UnknownName("body", name, self.bodies)
        reference = None if base is None else self.bodies[base]
        if reference is not None and reference.rotation is None:
            raise FileError(self.path, f"body {base}", f"no rotation: {reference.unknown_rotation}")
        return BodyPair(self.t, self.bodies[tool], reference)


@dataclass(frozen=True, eq=False)
class BodyPair:
    """The bodies at the tip and at the base over N frames; no base: positions are in the room's frame. `t`: (N,), s."""

    t: Array
    tool: BodyTrack
    base: BodyTrack | None

    @property
    def numbers(self) -> TargetNumbers:
        """Names of the bodies in `frames`."""
        return TargetNumbers(TOOL, None if self.base is None else BASE)

    @property
    def tip(self) -> Array:
        """(N, 3), tip in the frame of the base (m), NaN where a body was not seen; Conenna 2024, section 6.1."""
        if self.base is None or self.base.rotation is None:
            return self.tool.position
        between = self.tool.position - self.base.position
        return np.asarray(np.einsum("nji,nj->ni", self.base.rotation, between))

    def frames(self, rows: NDArray[np.int64]) -> list[TrackerFrame]:
        """Some of the frames, as a live tracker sends them."""
        bodies = {TOOL: self.tool} if self.base is None else {TOOL: self.tool, BASE: self.base}
        return [TrackerFrame(row, float(self.t[row]), _seen(bodies, row)) for row in rows.tolist()]


def matrices(quaternions: Array) -> Array:
    """(N, 3, 3) of quaternions (N, 4), x, y, z, w; NaN where one is, or is zero."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    valid = (length > 0.0) & np.isfinite(length)
    return rotation_matrix(np.roll(quaternions, 1, axis=1) / np.where(valid, length, np.nan))


def _seen(bodies: Mapping[int, BodyTrack], row: int) -> dict[int, TargetPose]:
    return {
        number: TargetPose(body.position[row], np.full((3, 3), np.nan) if body.rotation is None else body.rotation[row])
        for number, body in bodies.items()
        if np.isfinite(body.position[row]).all()
        and (body.rotation is None or number == TOOL or np.isfinite(body.rotation[row]).all())
    }


@dataclass(frozen=True, eq=False)
class TipTrack:
    """A tip over N frames in which it was seen: times t (N,), ascending (s), and positions (N, 3), m."""

    path: Path
    t: Array
    position: Array

    @staticmethod
    def of(path: Path, pair: BodyPair) -> TipTrack:
        """The tip of a pair of bodies. Raises `FileError`: it was hardly seen, or times do not ascend."""
        measured = np.isfinite(pair.tip).all(axis=1)
        if measured.sum() < LEAST_FRAMES:
            raise FileError(
                path, "", f"{int(measured.sum())} frames in which the tip was seen", f"{LEAST_FRAMES} at least"
            )
        t = pair.t[measured]
        if (np.diff(t) <= 0.0).any():
            row = 1 + int(np.argmax(np.diff(t) <= 0.0))
            raise FileError(path, f"frame {row + 1}", "its time is not after that of the frame before")
        return TipTrack(path, t, pair.tip[measured])

    @property
    def frame_s(self) -> float:
        """Usual time between frames (s)."""
        return float(np.median(np.diff(self.t)))

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline  # takes a second to load

        return CubicSpline(self.t, self.position)

    def at(self, t: Array) -> Array:
        """(…, 3), positions (m) at times (…), by a cubic spline through the frames; beyond them the nearest one.

        Straight lines between frames would take 1 % of a swing of 4 Hz away at 77 frames a second.
        """
        return np.asarray(self._spline(np.clip(t, self.t[0], self.t[-1])))

    def noise_at(self, t: Array) -> float:
        """Scatter along an axis (m) of positions at times (…): between frames less than at one."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        share = np.clip((t - self.t[after - 1]) / (self.t[after] - self.t[after - 1]), 0.0, 1.0)
        return self.noise * float(np.sqrt(np.mean(_cardinal_squares(share))))

    def seen(self, t: Array, gap: float) -> NDArray[np.bool_]:
        """(…), whether frames less than a gap (s) apart are on both sides of a time (…)."""
        after = np.searchsorted(self.t, t)
        inside = (after > 0) & (after < len(self.t))
        after = np.clip(after, 1, len(self.t) - 1)
        return np.asarray(inside & (self.t[after] - self.t[after - 1] < gap))

    @property
    def noise(self) -> float:
        """Scatter of a frame along an axis (m): of fourth differences, which motion hardly has; the median's (MAD)."""
        return float(np.median(np.abs(np.diff(self.position, n=4, axis=0))) / np.sqrt(70.0) / 0.6745)


def _cardinal_squares(share: Array) -> Array:
    """(…), variance of a cubic spline through values of variance 1 and distance 1, at a share (…) of a distance.

    At k distances from a value the cardinal spline falls by 2 − √3 with each (Schoenberg 1973): its square is summed.
    """
    from scipy.interpolate import CubicSpline

    near = np.arange(-12, 13)
    of_one = CubicSpline(near, near == 0)
    return np.asarray(sum(of_one(share + k) ** 2 for k in range(-10, 10)))
