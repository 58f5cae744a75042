"""Distorted trackers, and a base that rocks between its feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from validation.synthetic import EndLoad, HiddenEffect
from validation.synthetic.arm_description import Vector3
from validation.synthetic.hidden_effect import BaseError

CENTRE_M = np.array([0.0, 0.0, 0.25])
REACH_M = 0.4


@dataclass(frozen=True)
class LensTracker(HiddenEffect):
    """A lens that stretches space by the square of the distance from the middle of what it sees; share at REACH_M."""

    share: float

    def measurement_error(self, tcp_m: Array) -> Array:
        apart = tcp_m - CENTRE_M
        square = (apart**2).sum(axis=1, keepdims=True) / REACH_M**2
        return np.asarray(self.share * square * apart)


@dataclass(frozen=True)
class DepthTracker(HiddenEffect):
    """A camera whose scale of depth grows with the distance, by share_per_m."""

    camera_m: Vector3
    share_per_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        sight = tcp_m - np.array(self.camera_m)
        far = np.linalg.norm(sight, axis=1, keepdims=True)
        middle = np.linalg.norm(CENTRE_M - np.array(self.camera_m))
        return np.asarray(self.share_per_m * (far - middle) ** 2 * sight / far)


@dataclass(frozen=True)
class RockingFeet(BaseError):
    """A base on feet of unequal length: about an axis (unit vector in its frame) it tips to the side of the moment.

    tilt_rad: to either side; softness_nm: moment at which three quarters of it are reached.
    """

    axis: Vector3
    tilt_rad: float
    softness_nm: float

    def turn(self, load: EndLoad) -> Array:
        axis = np.array(self.axis)
        turn = self.tilt_rad * np.tanh(load.moment_nm @ axis / self.softness_nm)
        return np.asarray(turn[:, None] * axis)
