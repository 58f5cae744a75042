"""Measured poses of an arm: commands, what was measured of them, its noise and weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.rigid_motion import rotation_vectors, turned_covariance
from lrm_ident.data.source import COMPUTED, Source
from lrm_ident.data.weights.whitening import Whitening, whitening_of
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, with_borne_loads
from lrm_math.model.model import Model
from lrm_math.model.sensed import Sensed, encoder_angles, from_anchor, tool_rotation

PER_POSE = ("pose", "tcp", "sd", "covariance", "attitude", "feedback", "distance", "distance_sd", "repeat_of")
"""Arrays with a row for each pose."""


@dataclass(frozen=True)
class TouchedFrame:
    """A thing that moves as a whole when it is put elsewhere: a board with touched points, or one lone point.

    `placement`: name of where it stood. `points`: names of its touched points. `turns`: whether these are several at
    known places, so that its attitude shows.
    """

    placement: str
    points: tuple[str, ...]
    turns: bool

    @property
    def words(self) -> str:
        """Its placement; with the point where that stands alone."""
        return self.placement if self.turns else f"{self.placement}, point {self.points[0]}"


@dataclass(frozen=True, eq=False)
class Measurements:
    """N measured poses.

    Attributes:
        pose: (N,), pose numbers.
        tcp: (N, 3), measured TCP position (m), NaN where only a distance was measured.
        sd: (N,), standard deviation of each position per axis (m), else of its distance, or None.
        noise_sd: standard deviation per axis for all poses (m), or None.
        repeat_of: (N,), number of the pose that a row repeats, else its own number.
        covariance: (N, 6, 6), of position and rotation vector (m, rad), NaN where not stated; None without any.
        attitude: (N, 3, 3), rotation of the tool's frame, NaN where not measured; None where there is none to use.
        feedback: (N, n), what encoders read (rad), NaN where they did not; None where there is none to use.
        feedback_sd: its standard deviation (rad).
        distance: (N,), of the TCP from a fixed point (m), NaN where not measured; None where there is none to use.
        distance_sd: (N,), its standard deviation (m), or None. distance_from: (3,), that point (m); None: not known.
        touched: what `poses.placement` numbers from 1; empty where nothing was touched.
        model_sd: standard deviation per axis by which a model misses positions whatever their noise (m).
    """

    poses: Poses
    pose: NDArray[np.int64]
    tcp: Array
    sd: Array | None
    noise_sd: float | None
    repeat_of: NDArray[np.int64]
    source: Source = COMPUTED
    covariance: Array | None = None
    attitude: Array | None = None
    feedback: Array | None = None
    feedback_sd: float | None = None
    distance: Array | None = None
    distance_sd: Array | None = None
    distance_from: Array | None = None
    touched: tuple[TouchedFrame, ...] = ()
    model_sd: float = 0.0
    _complete: Measurements | None = None

    @classmethod
    def of_tcp(
        cls,
        poses: Poses,
        tcp: Array,
        noise_sd: float | None = None,
        *,
        sd: Array | None = None,
        pose: NDArray[np.int64] | None = None,
        repeat_of: NDArray[np.int64] | None = None,
        source: Source = COMPUTED,
    ) -> Measurements:
        """Measured positions `tcp` (N, 3), m, of poses that are numbered from 1 where `pose` does not say otherwise."""
        number = np.arange(1, len(tcp) + 1) if pose is None else pose
        return cls(poses, number, tcp, sd, noise_sd, number if repeat_of is None else repeat_of, source)

    def __repr__(self) -> str:
        of = "" if self.source.arm is None else f" of {self.source.arm.name}"
        poses, joints = len(self), self.poses.q.shape[1]
        there = {
            "positions": len(self.positions) > 0,
            "orientations": self.attitude is not None,
            "touched points": bool(self.touched),
            "distances": self.distance is not None,
            "joint feedback": self.feedback is not None,
            "standard deviations": self.sd is not None or self.covariance is not None,
            "payloads": bool(self.poses.payload.any()),
            "times": self.poses.t is not None,
            "sessions": self.poses.session is not None,
            "temperatures": self.poses.temperature is not None,
            "gravity": self.poses.gravity is not None,
        }
        columns = ", ".join(name for name, is_there in there.items() if is_there)
        return f"<Measurements{of}: {poses} poses, {joints} joints; {columns}; {self.source.path.name}>"

    @cached_property
    def whitening(self) -> Whitening:
        """The weights of what was measured."""
        if self.covariance is None and self.distance is None:
            return Whitening(self._sd)
        size = 3 if self.attitude is None else 6
        unknown = np.full((len(self), size, size), np.nan)
        blocks = unknown if self.covariance is None else self.covariance[:, :size, :size].copy()
        np.einsum("nii->ni", blocks)[:, :3] += self.model_sd**2
        np.einsum("nii->ni", blocks)[np.isnan(self.tcp[:, 0]), :3] = np.nan
        if self.attitude is not None:
            np.einsum("nii->ni", blocks)[np.isnan(self.attitude[:, 0, 0]), 3:] = np.nan
        alone = [np.empty((len(self), 0))]
        if self.feedback is not None and self.feedback_sd is not None:
            alone.append(np.where(np.isnan(self.feedback), np.nan, self.feedback_sd))
        if self.distance is not None:
            sd = np.ones(len(self)) if self.distance_sd is None else self.distance_sd
            alone.append(np.where(np.isnan(self.distance), np.nan, sd)[:, None])
        return whitening_of(self._sd, blocks, np.concatenate(alone, axis=1), self.sensed)

    @property
    def _sd(self) -> Array | None:
        """(N,), standard deviation by which positions are weighed (m): the stated one, and the model's error."""
        return self.sd if self.sd is None or not self.model_sd else np.hypot(self.sd, self.model_sd)

    @property
    def sensed(self) -> Sensed:
        """Quantities that were measured."""
        point = None
        if self.distance is not None:
            x, y, z = self._anchor.tolist()
            point = (x, y, z)
        return Sensed(self.attitude is not None, self.feedback is not None, point)

    @property
    def _anchor(self) -> Array:
        """(3,), stated part of the point that distances are measured from (m)."""
        return np.zeros(3) if self.distance_from is None else self.distance_from

    @property
    def several_kinds(self) -> bool:
        """Whether numbers of several kinds are weighed together: positions and orientations, feedback or distances."""
        beside = self.attitude is not None or self.feedback is not None
        return beside or (self.distance is not None and len(self.positions) > 0)

    @property
    def measured_rows(self) -> int:
        """Number of all numbers that were measured and are used."""
        return int((self.whitening.measured * np.ones(len(self))).sum())

    @property
    def positions(self) -> NDArray[np.int64]:
        """Rows with a position."""
        return np.flatnonzero(~np.isnan(self.tcp[:, 0]))

    def position_error(self, settled: Equilibrium) -> Array:
        """(N, 3), measured less predicted TCP (m); where only the distance was measured, what shows along it."""
        error = self.tcp - settled.tcp
        gone = np.isnan(error[:, 0])
        if self.distance is not None and gone.any():
            line = from_anchor(settled, self._anchor)
            length = np.linalg.norm(line, axis=1)
            error[gone] = (((self.distance - length) / length)[:, None] * line)[gone]
        return error

    def errors(self, settled: Equilibrium) -> ErrorStats:
        """Statistics of the errors of positions, and of orientations where there are any."""
        return error_stats(self.position_error(settled), self.turn_error(settled))

    def places(self, settled: Equilibrium) -> Array:
        """(N, 3), where each TCP was measured, or is predicted where only a distance was (m)."""
        return np.where(np.isnan(self.tcp), settled.tcp, self.tcp)

    def turn_error(self, settled: Equilibrium) -> Array:
        """(N, 3), measured less predicted orientation of the tool as rotation vectors (rad); NaN where not measured."""
        if self.attitude is None:
            return np.full((len(self), 3), np.nan)
        return rotation_vectors(self.attitude @ tool_rotation(settled).transpose(0, 2, 1))

    def residual(self, settled: Equilibrium) -> Array:
        """(N, R), what was measured less what the model predicts: m, rad; zero where nothing was measured."""
        parts = [self.tcp - settled.tcp]
        if self.attitude is not None:
            parts.append(self.turn_error(settled))
        if self.feedback is not None:
            parts.append(self.feedback - encoder_angles(settled))
        if self.distance is not None:
            length = np.linalg.norm(from_anchor(settled, self._anchor), axis=1)
            parts.append((self.distance - length)[:, None])
        return parts[0] if len(parts) == 1 else np.nan_to_num(np.concatenate(parts, axis=1))

    def noting(self, *notices: str) -> Measurements:
        """The same with more warnings about where they come from."""
        return replace(self, source=self.source.noting(*notices))

    @property
    def complete(self) -> Measurements:
        """These measurements with the poses that were left out."""
        return self._complete or self

    def turned(self, rotation: Array, translation: Array) -> Measurements:
        """Moves them to another frame: positions to R p + t, with rotation R (3, 3) and translation t (3,), m."""
        return replace(
            self,
            poses=self.poses.turned(rotation),
            tcp=self.tcp @ rotation.T + translation,
            covariance=None if self.covariance is None else turned_covariance(self.covariance, rotation),
            attitude=None if self.attitude is None else rotation @ self.attitude,
            distance_from=None if self.distance_from is None else rotation @ self.distance_from + translation,
            _complete=None if self._complete is None else self._complete.turned(rotation, translation),
        )

    def __len__(self) -> int:
        return len(self.pose)

    def borne_by(self, model: Model) -> Measurements:
        """The same, with the loads that this model's arm bore before each pose, if an effect of it follows them."""
        if not model.remembers or self.poses.history is None:
            return self
        return replace(self, poses=with_borne_loads(model, self.poses))

    def take(self, rows: ArrayLike) -> Measurements:
        """The given rows (indices or a mask)."""
        chosen = np.asarray(rows)
        parts = {name: getattr(self, name) for name in PER_POSE}
        return replace(
            self,
            **{name: part[chosen] for name, part in parts.items() if part is not None},
            poses=self.poses.take(chosen),
            _complete=None,
        )

    def without(self, numbers: Sequence[int]) -> Measurements:
        """Leaves the poses of these numbers out, which `left_out` then names too."""
        gone = np.isin(self.pose, numbers)
        left_out = tuple(sorted({*self.source.left_out, *self.pose[gone].tolist()}))
        return replace(self.take(~gone), source=replace(self.source, left_out=left_out), _complete=self.complete)

    def only(self, numbers: Sequence[int]) -> Measurements:
        """The poses of these numbers alone. Raises `FileError` if there are none."""
        chosen = np.isin(self.pose, numbers)
        if not chosen.any():
            raise self.source.fault("no poses that the fit left out", "--left-out is of the fit's own data")
        return self.take(chosen)


Part = Callable[[Measurements], Measurements]
"""Chooses poses of measurements."""


def every_pose(data: Measurements) -> Measurements:
    """All poses."""
    return data
