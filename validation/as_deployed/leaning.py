"""Bases that lean: gravity is tilted against the frame of measurement, alone or beside other hidden effects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from validation.as_deployed.catalogue import recording_of
from validation.as_deployed.recording import WorldRecording
from validation.hidden_effects.case import Build, Case, no_effect

SEEDS, MOST_DEG = 20, 8
COUNTS = (300, 150, 80, 60, 40)


@dataclass(frozen=True)
class Lean:
    """Angle of a lean about x or y of the frame of measurement, and how many poses are measured."""

    axis: str
    tilt_deg: int
    poses: int

    @classmethod
    def of(cls, seed: int) -> Lean:
        """The angles 0 to 8° in turn, each about either axis, with either sign; 300 to 40 poses."""
        sign = 1 if seed // 2 % 2 else -1
        return cls("xy"[seed % 2], sign * (seed % (MOST_DEG + 1)), COUNTS[seed % len(COUNTS)])

    @property
    def words(self) -> str:
        """The truth, for a table."""
        return f"gravity {self.tilt_deg}° about {self.axis}" if self.tilt_deg else "level"

    @property
    def turn_rad(self) -> Array:
        """(3,), rotation vector of gravity."""
        return np.asarray(math.radians(self.tilt_deg) * np.array([self.axis == name for name in "xyz"], dtype=float))


def leaning_recording(seed: int, lean: Lean | None = None, build: Build = no_effect) -> WorldRecording:
    """The world of a seed, or of another lean with its random arm; `build` makes what else is hidden."""
    lean = lean or Lean.of(seed)
    return recording_of(Case("lean", (), build), seed, lean.poses, gravity_turn_rad=lean.turn_rad)
