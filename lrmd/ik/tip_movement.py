"""Movement of the tip when one model takes the place of another: where the same commands then lead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.plausible_arm import reach
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of, roberts_sequence
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrmd.errors import RequestError

POSES = 64
LARGE = 0.2
"""Share of the reach: 11.5 deg of a stretched arm. A horn that is one of 25 teeth off turns its joint by 14.4 deg."""


@dataclass(frozen=True)
class TipMovement:
    """Distance of the tip (m) between two models at the same commands: the `largest`, and its `rms`."""

    largest: float
    rms: float


def tip_movement(before: Model, after: Model, arm: Arm) -> TipMovement:
    """Movement over poses spread over the joint limits of the unloaded arm. Raises `NoEquilibrium`."""
    lower, upper = (np.array([getattr(joint, side) for joint in arm.joints]) for side in ("lower", "upper"))
    q = lower + (upper - lower) * roberts_sequence(POSES, arm.dof)
    tips = [solve_equilibrium(model, poses_of(q)).true_tcp for model in (before, after)]
    apart = np.linalg.norm(tips[1] - tips[0], axis=1)
    return TipMovement(float(apart.max()), float(np.sqrt(np.mean(apart**2))))


def check_movement(moved: TipMovement, arm: Arm, accept: bool) -> None:
    """Raises `LrmError` for a tip that moves by more than the arm is long, `RequestError` for a large movement that
    was not accepted."""
    length, much = reach(arm), f"the tip moves by up to {moved.largest * 1e3:.0f} mm against the model in use"
    if moved.largest > length:
        raise LrmError(f"no model of this arm: {much}; the arm's whole reach is {length * 1e3:.0f} mm")
    if moved.largest > LARGE * length and not accept:
        text = f"{much}; more than {LARGE * length * 1e3:.0f} mm (a fifth of the reach) has to be accepted"
        raise RequestError("needs_accept", text, tip_moves_m=moved.largest, tip_moves_rms_m=moved.rms)
