"""Plausibility of an identified model: its arm comes to rest, and within its limits, over a sample of its range."""

from __future__ import annotations

import math

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model

SAMPLES = 256
OVERSHOOT = 0.1
"""Share of a joint's range by which the arm may rest outside: it sags at the ends of its range, too."""


def check_comes_to_rest(arm: Arm, model: Model) -> None:
    """Raises `LrmError` if the unloaded arm, at a pose of the sample, rests far outside its limits or not at all."""
    lower, upper = (np.array([getattr(joint, side) for joint in arm.joints]) for side in ("lower", "upper"))
    q = lower + (upper - lower) * np.random.default_rng(0).random((SAMPLES, arm.dof))
    try:
        at_rest = equilibrium(model, poses_of(q))
    except NoEquilibrium as error:
        why = str(error).partition(": ")[2]
        raise LrmError(f"no model of this arm: commanded to {_pose(q[error.poses[0] - 1])} deg, {why}") from None
    slots = [np.broadcast_to(at_rest.slots[k], SAMPLES) for k in model.chain.joint_slots]
    angles = np.stack(slots, axis=1) - [joint.theta for joint in arm.joints]
    outside = np.maximum(lower - angles, angles - upper) - OVERSHOOT * (upper - lower)
    row, joint = np.unravel_index(int(outside.argmax()), outside.shape)
    if not outside[row, joint] <= 0.0:
        low, high = math.degrees(lower[joint]), math.degrees(upper[joint])
        raise LrmError(
            f"no model of this arm: commanded to {_pose(q[row])} deg, {arm.joint_names[joint]} would rest at "
            f"{math.degrees(angles[row, joint]):.0f} deg; its limits are {low:g} to {high:g} deg"
        )


def _pose(q: Array) -> str:
    return " ".join(f"{angle:.0f}" for angle in np.degrees(q))
