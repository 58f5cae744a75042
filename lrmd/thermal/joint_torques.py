"""Gravity's torques on the joints, for the thermal model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of


def torques_of(arm: Arm) -> Callable[[Sequence[float], float], Sequence[float]]:
    """A function: pose (rad) and payload (kg) -> gravity's torque (N m) on every joint of the rigid nominal arm."""
    model = model_of(arm, ())

    def torques(q: Sequence[float], payload: float) -> Sequence[float]:
        rest = equilibrium(model, poses_of(np.array([q], dtype=np.float64), payload))
        return [float(t) for t in rest.joint_torque[0]]

    return torques
