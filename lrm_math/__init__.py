"""The mathematics that the daemon and the offline tool share: SI units, float64, batches first `(N, ...)`.

What a notebook needs is here by name, imported when it is first used: the ramp, which needs none of it, stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lrm_math.arm.arm import Arm
    from lrm_math.arm.arm_file import load_arm
    from lrm_math.effects import CATALOGUE, Description, Effect, LinearEffect, Parameter, effects_at
    from lrm_math.errors import LrmError
    from lrm_math.ik.calibrated import CalibratedSolver
    from lrm_math.ik.goal import Goal, point, point_along, pose, pose_rpy
    from lrm_math.kinematics.poses import Poses, poses_of
    from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
    from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
    from lrm_math.model.model import Model, model_of
    from lrm_math.model.model_file import load_model

_NAMES = {
    "arm.arm": ("Arm",),
    "arm.arm_file": ("load_arm",),
    "effects": ("CATALOGUE", "Description", "Effect", "LinearEffect", "Parameter", "effects_at"),
    "errors": ("LrmError",),
    "ik.calibrated": ("CalibratedSolver",),
    "ik.goal": ("Goal", "point", "point_along", "pose", "pose_rpy"),
    "kinematics.poses": ("Poses", "poses_of"),
    "model.derivatives": ("joint_jacobian", "parameter_jacobian"),
    "model.equilibrium": ("Equilibrium", "solve_equilibrium"),
    "model.model": ("Model", "model_of"),
    "model.model_file": ("load_model",),
}
"""Names of each module."""

__all__ = [
    "CATALOGUE",
    "Arm",
    "CalibratedSolver",
    "Description",
    "Effect",
    "Equilibrium",
    "Goal",
    "LinearEffect",
    "LrmError",
    "Model",
    "Parameter",
    "Poses",
    "effects_at",
    "joint_jacobian",
    "load_arm",
    "load_model",
    "model_of",
    "parameter_jacobian",
    "point",
    "point_along",
    "pose",
    "pose_rpy",
    "poses_of",
    "solve_equilibrium",
]


def __getattr__(name: str) -> Any:
    for module, names in _NAMES.items():
        if name in names:
            return getattr(import_module(f"lrm_math.{module}"), name)
    raise AttributeError(f"module 'lrm_math' has no attribute '{name}'")
