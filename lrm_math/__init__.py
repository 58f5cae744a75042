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
    from lrm_math.model.equilibrium import Equilibrium, equilibrium
    from lrm_math.model.model import Model, model_of
    from lrm_math.model.model_file import load_model

_HOME = {
    "Arm": "arm.arm",
    "load_arm": "arm.arm_file",
    "CATALOGUE": "effects",
    "Description": "effects",
    "Effect": "effects",
    "LinearEffect": "effects",
    "Parameter": "effects",
    "effects_at": "effects",
    "LrmError": "errors",
    "CalibratedSolver": "ik.calibrated",
    "Goal": "ik.goal",
    "point": "ik.goal",
    "point_along": "ik.goal",
    "pose": "ik.goal",
    "pose_rpy": "ik.goal",
    "Poses": "kinematics.poses",
    "poses_of": "kinematics.poses",
    "joint_jacobian": "model.derivatives",
    "parameter_jacobian": "model.derivatives",
    "Equilibrium": "model.equilibrium",
    "equilibrium": "model.equilibrium",
    "Model": "model.model",
    "model_of": "model.model",
    "load_model": "model.model_file",
}
"""Module of each name."""

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
    "equilibrium",
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
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'lrm_math' has no attribute '{name}'")
    return getattr(import_module(f"lrm_math.{_HOME[name]}"), name)
