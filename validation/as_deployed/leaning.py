"""Bases that lean: gravity is tilted against the frame of measurement, alone or beside other hidden effects."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from validation.as_deployed.catalogue import continued_schedule
from validation.as_deployed.recording import FRESH, WorldPlan, WorldRecording, recorded
from validation.hidden_effects.case import Build, no_effect, stable_seed
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, LOADS_KG
from validation.synthetic import (
    ArmDescription,
    GroundTruth,
    base_displacement_to_deviations,
    load_arm,
    random_poses,
)
from validation.synthetic.screws import rotation_matrix

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

    def tilted(self, arm: ArmDescription) -> ArmDescription:
        """The arm with this gravity."""
        turn = math.radians(self.tilt_deg) * np.array([self.axis == name for name in "xyz"], dtype=float)
        x, y, z = (rotation_matrix(turn) @ np.array(arm.gravity_m_per_s2)).tolist()
        return replace(arm, gravity_m_per_s2=(x, y, z))


def leaning_recording(seed: int, lean: Lean | None = None, build: Build = no_effect) -> WorldRecording:
    """The world of a seed, or of another lean with its random arm; `build` makes what else is hidden."""
    lean = lean or Lean.of(seed)
    arm = lean.tilted(load_arm(ARM_FILE))
    truth = GroundTruth.random(arm, stable_seed("lean", seed, "arm"), build(arm, seed))
    seeds = [stable_seed("lean", seed, what) for what in ("poses", "fresh", "loads", "noise")]
    counts = (lean.poses, FRESH)
    q = np.vstack([random_poses(arm, n, at, floor_m=FLOOR_M) for n, at in zip(counts, seeds[:2], strict=True)])
    load = np.random.default_rng(seeds[2]).choice(LOADS_KG, size=len(q))
    plan = WorldPlan(q, load, continued_schedule(lean.poses, 1, q.shape[1]), lean.poses)
    return recorded(ARM_FILE, arm, base_displacement_to_deviations(arm, truth), plan, seeds[3])
