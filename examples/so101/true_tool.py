"""Frame of the true arm's tool: what a board on the gripper shows a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.rigid_motion import homogeneous
from lrm_math.arrays import Array
from validation.synthetic import ArmDescription, GroundTruth, Schedule, true_state
from validation.synthetic.arm_description import BodyDescription

AXES = ("origin", "x", "y", "z")


def tools_after(arm: ArmDescription, truth: GroundTruth, path: Array) -> Array:
    """(P, 4, 4), true frames of the tool (m) after straight moves along joint angles (P, n), rad.

    The generator knows points only: four bodies without mass, a metre apart, span the frame.
    """
    tool = len(arm.links) + 1
    points = np.vstack([np.zeros(3), np.eye(3)])
    ghosts = tuple(
        BodyDescription(name, 0.0, tuple(point.tolist()), tool, len(arm.links))
        for name, point in zip(AXES, points, strict=True)
    )
    schedule = Schedule(np.arange(1.0, len(path) + 1.0), np.ones(len(path)), path[0])
    seen = true_state(replace(arm, bodies=(*arm.bodies, *ghosts)), truth, path, 0.0, schedule)
    origin, *ends = seen.posture.centres[:, len(arm.bodies) :].transpose(1, 0, 2)
    axes = np.stack([end - origin for end in ends], axis=2)
    return np.array([homogeneous(R, t) for R, t in zip(axes, origin, strict=True)])
