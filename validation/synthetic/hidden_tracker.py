"""Hidden systematic errors of the measuring device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import Vector3
from .hidden_effect import HiddenEffect
from .screws import Array, rotation_matrix

CENTRE_M, REACH_M = np.array([0.0, 0.0, 0.25]), 0.4
"""Middle of what a camera sees, and how far from it the arm comes."""


@dataclass(frozen=True)
class SkewTracker(HiddenEffect):
    """Affine error of the tracker's frame: scale, then non-orthogonal axes, then rotation.

    turn_rad: rotation vector; stretch: scale errors of x, y, z (0.003 is 0.3 %); lean_rad: shear angles of y towards x,
    z towards x and z towards y. About the point centre_m, all in world axes.
    """

    turn_rad: Vector3
    stretch: Vector3
    lean_rad: Vector3
    centre_m: Vector3 = (0.0, 0.0, 0.0)

    def measurement_error(self, tcp_m: Array) -> Array:
        """The affine error of each position (P, 3) in m."""
        yx, zx, zy = np.tan(self.lean_rad)
        shear = np.array([[1.0, yx, zx], [0.0, 1.0, zy], [0.0, 0.0, 1.0]])
        change = rotation_matrix(self.turn_rad) @ shear @ np.diag(1.0 + np.array(self.stretch)) - np.eye(3)
        return np.asarray((tcp_m - np.array(self.centre_m)) @ change.T)


@dataclass(frozen=True)
class OccludedMarker(HiddenEffect):
    """A target of several markers, of which one is hidden on one side of the workspace: its centre moves by size_m."""

    size_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        hidden = (tcp_m[:, 0] > 0.0) & (tcp_m[:, 1] < -0.02)
        return np.asarray(hidden[:, None] * self.size_m * np.array([0.6, -0.5, 0.62]))


@dataclass(frozen=True)
class DistanceDependentNoise(HiddenEffect):
    """A camera whose noise grows with the square of the distance from the arm's axis, up to sd_m per axis."""

    sd_m: float
    seed: int

    def measurement_error(self, tcp_m: Array) -> Array:
        square = (tcp_m[:, :2] ** 2).sum(axis=1)
        noise = np.random.default_rng(self.seed).normal(size=tcp_m.shape)
        return np.asarray(self.sd_m * (square / square.max())[:, None] * noise)


@dataclass(frozen=True)
class RangeError(HiddenEffect):
    """An error of the distance from a device at from_m: along the line of sight."""

    from_m: Vector3

    def error(self, far: Array) -> Array:
        """Error (P, 1) of distances (P, 1), m."""
        raise NotImplementedError

    def measurement_error(self, tcp_m: Array) -> Array:
        sight = tcp_m - np.array(self.from_m)
        far = np.linalg.norm(sight, axis=1, keepdims=True)
        return np.asarray(self.error(far) * sight / far)


@dataclass(frozen=True)
class StereoSteps(RangeError):
    """Two cameras that match whole pixels: the distance comes in steps that grow with its square. No name says so."""

    step_per_m: float

    def error(self, far: Array) -> Array:
        return 1.0 / (np.round(1.0 / far / self.step_per_m) * self.step_per_m) - far


@dataclass(frozen=True)
class CyclicDistance(RangeError):
    """A distance meter that counts phases: its distance errs by a wave of half the wavelength. No name says so."""

    half_wave_m: float
    size_m: float

    def error(self, far: Array) -> Array:
        return np.asarray(self.size_m * np.sin(2.0 * np.pi * far / self.half_wave_m))


@dataclass(frozen=True)
class DepthTracker(RangeError):
    """A camera whose scale of depth grows with the distance, by share_per_m."""

    share_per_m: float

    def error(self, far: Array) -> Array:
        return self.share_per_m * (far - np.linalg.norm(CENTRE_M - np.array(self.from_m))) ** 2


@dataclass(frozen=True)
class FoamMat(HiddenEffect):
    """A mat of foam that the gripper sinks into where a pose is too low: it is lifted by a share. No name says so."""

    top_m: float
    share: float

    def measurement_error(self, tcp_m: Array) -> Array:
        error = np.zeros_like(tcp_m)
        error[:, 2] = self.share * np.maximum(self.top_m - tcp_m[:, 2], 0.0)
        return error


@dataclass(frozen=True)
class RingingTip(HiddenEffect):
    """A tip that still rings as it is measured, the more the longer its way was. No name says so."""

    share: float
    seed: int

    def measurement_error(self, tcp_m: Array) -> Array:
        way = np.linalg.norm(np.diff(tcp_m, axis=0, prepend=tcp_m[:1]), axis=1, keepdims=True)
        return np.asarray(self.share * way * np.random.default_rng(self.seed).normal(size=tcp_m.shape))


@dataclass(frozen=True)
class ProbePretravel(HiddenEffect):
    """A touching probe that is bent by the same length whichever way the tip comes. No name says so."""

    length_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        way = np.diff(tcp_m, axis=0, prepend=tcp_m[:1])
        return np.asarray(-self.length_m * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))


@dataclass(frozen=True)
class LensTracker(HiddenEffect):
    """A lens that stretches space by the square of the distance from the middle of what it sees; share at REACH_M."""

    share: float

    def measurement_error(self, tcp_m: Array) -> Array:
        apart = tcp_m - CENTRE_M
        square = (apart**2).sum(axis=1, keepdims=True) / REACH_M**2
        return np.asarray(self.share * square * apart)
