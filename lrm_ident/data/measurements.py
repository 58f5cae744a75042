"""Measured poses of an arm: commands, what was measured of them, its noise and weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.observations.positions import Positions
from lrm_ident.data.observations.touched_points import TouchedFrame, TouchedPoints
from lrm_ident.data.source import COMPUTED, Source
from lrm_ident.data.weights.whitening import Whitening, joint_root
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, with_borne_loads
from lrm_math.model.model import Model
from lrm_math.model.sensed import Sensed

Numbers = NDArray[np.int64]
Observed = TypeVar("Observed", bound=Observation)


@dataclass(frozen=True, eq=False)
class Measurements:
    """N measured poses.

    Attributes:
        observations: what was measured of them, positions of the TCP first (NaN where other things alone were).
        pose: (N,), pose numbers.
        repeat_of: (N,), number of the pose that a row repeats, else its own number.
    """

    poses: Poses
    observations: tuple[Observation, ...]
    pose: Numbers
    repeat_of: Numbers
    source: Source = COMPUTED
    _complete: Measurements | None = None

    @classmethod
    def of_tcp(
        cls, poses: Poses, tcp: Array, noise_sd: float | None = None, *, sd: Array | None = None,
        pose: Numbers | None = None, repeat_of: Numbers | None = None, source: Source = COMPUTED,
    ) -> Measurements:  # fmt: skip
        """Measured positions `tcp` (N, 3), m, of poses that are numbered from 1 where `pose` does not say otherwise."""
        number = np.arange(1, len(tcp) + 1) if pose is None else pose
        seen = (Positions(tcp, sd, noise_sd=noise_sd),)
        return cls(poses, seen, number, number if repeat_of is None else repeat_of, source)

    def __repr__(self) -> str:
        of = "" if self.source.arm is None else f" of {self.source.arm.name}"
        poses, joints = len(self), self.poses.q.shape[1]
        there = {
            **{observation.words: bool(observation.measured.any()) for observation in self.observations},
            "standard deviations": self.sd is not None,
            "payloads": bool(self.poses.payload.any()),
            "times": self.poses.t is not None,
            "sessions": self.poses.session is not None,
            "temperatures": self.poses.temperature is not None,
            "gravity": self.poses.gravity is not None,
        }
        columns = ", ".join(name for name, is_there in there.items() if is_there)
        return f"<Measurements{of}: {poses} poses, {joints} joints; {columns}; {self.source.path.name}>"

    @property
    def positions(self) -> Positions:
        """The measured positions."""
        return self.of(Positions)[0]

    @property
    def tcp(self) -> Array:
        """(N, 3), measured TCP positions (m), NaN where there is none."""
        return self.positions.values

    @property
    def touched(self) -> tuple[TouchedFrame, ...]:
        """What `poses.placement` numbers from 1; empty where nothing was touched."""
        return tuple(frame for points in self.of(TouchedPoints) for frame in points.frames)

    def of(self, kind: type[Observed]) -> list[Observed]:
        """The observations of a kind: one, or none."""
        return [observation for observation in self.observations if isinstance(observation, kind)]

    def beside(self, *more: Observation) -> Measurements:
        """The same with further observations."""
        return replace(self, observations=(*self.observations, *more))

    def with_positions(self, positions: Positions) -> Measurements:
        """The same with other positions."""
        return replace(self, observations=(positions, *self.observations[1:]))

    def with_tcp(self, tcp: Array) -> Measurements:
        """The same with other positions (N, 3), m, of the same noise."""
        return self.with_positions(replace(self.positions, values=tcp))

    @cached_property
    def whitening(self) -> Whitening:
        """The weights of what was measured."""
        sd, error = self.sd, self.positions.model_sd
        sd = np.hypot(sd, error) if sd is not None and error else sd
        if len(self.observations) == 1 and self.positions.blocks is None:
            return Whitening(sd)
        return Whitening(sd, joint_root(self.observations), self.sensed)

    @property
    def sd(self) -> Array | None:
        """(N,), standard deviation of each position per axis (m), else of what else in metres was measured; or None."""
        sd_known = None
        for observation in self.observations:
            if observation.is_length and observation.rms_sd is not None and observation.measured.any():
                sd = np.where(observation.measured, observation.rms_sd, np.nan)
                sd_known = sd if sd_known is None else np.where(np.isnan(sd_known), sd, sd_known)
        return sd_known

    @property
    def sensed(self) -> Sensed:
        """Quantities that were measured."""
        return Sensed(tuple(observation.measurand for observation in self.observations))

    @property
    def several_kinds(self) -> bool:
        """Whether numbers of several kinds are weighed together."""
        return sum(bool(observation.measured.any()) for observation in self.observations) > 1

    @property
    def first(self) -> Observation:
        """The first that was measured of those in metres: the errors that are reported."""
        return next(
            (observation for observation in self.observations if observation.is_length and observation.measured.any()),
            self.positions,
        )

    def rows_of(self, observation: Observation) -> slice:
        """Rows of an observation in the residual of a pose."""
        spans = self.sensed.spans(self.poses.q.shape[1])
        return next(
            rows for observed, (_, rows) in zip(self.observations, spans, strict=True) if observed is observation
        )

    @property
    def measured_rows(self) -> int:
        """Number of all numbers that were measured and are used."""
        return int((self.whitening.measured * np.ones(len(self))).sum())

    def position_error(self, settled: Equilibrium) -> Array:
        """(N, 3), measured less predicted TCP (m); where no position was measured, what shows of it."""
        return _first_known([observation.shift(settled) for observation in self.observations])

    def turn_error(self, settled: Equilibrium) -> Array:
        """(N, 3), measured less predicted orientation of the tool as rotation vectors (rad); NaN where not measured."""
        return _first_known([observation.turn(settled) for observation in self.observations])

    def errors(self, settled: Equilibrium) -> ErrorStats:
        """Statistics of the errors of positions, and of orientations where there are any."""
        return error_stats(self.position_error(settled), self.turn_error(settled))

    def places(self, settled: Equilibrium) -> Array:
        """(N, 3), where each TCP was measured, or is predicted where its position was not (m)."""
        return np.where(np.isnan(self.tcp), settled.tcp, self.tcp)

    def residual(self, settled: Equilibrium) -> Array:
        """(N, R), what was measured less what the model predicts: m, rad; zero where nothing was measured."""
        parts = [observation.residual(settled) for observation in self.observations]
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
            observations=tuple(observation.turned(rotation, translation) for observation in self.observations),
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
        return replace(
            self,
            poses=self.poses.take(chosen),
            observations=tuple(observation.take(chosen) for observation in self.observations),
            pose=self.pose[chosen],
            repeat_of=self.repeat_of[chosen],
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


def _first_known(errors: Sequence[Array]) -> Array:
    """(N, 3), the first of several errors that is known of each pose, else NaN."""
    first_error = errors[0]
    for other in errors[1:]:
        first_error = np.where(np.isnan(first_error), other, first_error)
    return first_error
