"""The poses of a campaign, in the order to measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_pose_table, pose_doubts
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of


@dataclass(frozen=True)
class PlannedPose:
    """A pose to measure.

    `q`: rad. `payload`: kg. `approach`: side from which each joint arrives (1: from below, −1: from above, 0: as it
    comes); empty: all as they come. `repeat_of`: number of the pose that it repeats, else its own. `hold`: how long it
    stands there at least before it is measured (s).
    """

    number: int
    q: tuple[float, ...]
    payload: float
    approach: tuple[int, ...]
    repeat_of: int
    hold: float = 0.0


@dataclass(frozen=True)
class CampaignPlan:
    """Poses in order, the SHA-256 of their file, and what a person should know of it."""

    poses: tuple[PlannedPose, ...]
    sha256: str
    notices: tuple[str, ...] = ()


def lightest(poses: Sequence[PlannedPose], arm: Arm) -> PlannedPose:
    """The pose that loads the joints least: smallest sum of squared gravity torques of the nominal arm."""
    torque = solve_equilibrium(model_of(arm, ()), poses_of(np.array([pose.q for pose in poses]), 0.0)).joint_torque
    return poses[int(np.argmin((torque**2).sum(axis=1)))]


def load_plan(path: Path, arm: Arm) -> CampaignPlan:
    """Reads `pose, q1_deg …, payload_g, approach1 …, repeat_of, hold_s`, as `design` writes. Raises `FileError`."""
    poses, table = load_pose_table(path, arm, more=["repeat_of"])
    number = table.integers("pose")
    if len(set(number.tolist())) < len(number):
        raise FileError(path, "column pose", "a number stands twice")
    repeats = table.integers("repeat_of") if "repeat_of" in table else number
    stated = poses.direction if "approach" in table or "sides" in table else None
    approach = np.zeros((len(number), 0)) if stated is None else stated
    hold = table.column("hold")
    columns = (number, poses.q, poses.payload, approach, repeats, np.zeros(len(number)) if hold is None else hold)
    planned = (
        PlannedPose(int(n), tuple(q.tolist()), float(load), tuple(map(int, sides)), int(of), float(waits))
        for n, q, load, sides, of, waits in zip(*columns, strict=True)
    )
    return CampaignPlan(tuple(planned), table.cells.sha256, pose_doubts(table, arm))
