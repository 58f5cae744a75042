"""What the plug-in uses of a model of motion: each servo's dead time, and the dead band short of its goal."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.reference import ParameterRef
from lrm_math.motion.effects import CoulombFriction, DeadTime, MotionPlay
from lrm_math.motion.motion_model import MotionModel


def half_dead_band(model: MotionModel) -> Array:
    """(n,), rad, by which joints' encoders stay behind a slow command: Coulomb friction, and half of the play.

    Friction over the stiffness of the servo's position loop; see `CoulombFriction`.
    """
    return _of_joints(model, CoulombFriction.id, "c_rad") + 0.5 * _of_joints(model, MotionPlay.id, "b_rad")


def dead_times(model: MotionModel) -> Array:
    """(n,), s, after which joints' servos act on a command."""
    return _of_joints(model, DeadTime.id, "t_s")


def unused_effects(model: MotionModel) -> tuple[str, ...]:
    """What effects of the model `half_dead_band` leaves out, each once, by their ids."""
    return tuple(dict.fromkeys(e.id for e in model.effects if not isinstance(e, CoulombFriction | MotionPlay)))


def _of_joints(model: MotionModel, effect: str, parameter: str) -> Array:
    """(n,), SI, of a parameter that every joint may have; zero where it has none."""
    keys = (str(ParameterRef(effect, place, parameter)) for place in model.arm.joint_names)
    return np.array([model.values.get(key, 0.0) for key in keys])
