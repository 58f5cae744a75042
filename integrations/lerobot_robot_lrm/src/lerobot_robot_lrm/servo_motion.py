"""What a model of motion says of each joint's servo: how late it follows, and how far it stops short of its goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.motion.effects import CoulombFriction, DeadTime, MotionPlay, ServoResponse, VelocityFeedforward
from lrm_math.motion.motion_model import MotionModel


@dataclass(frozen=True, eq=False)
class ServoMotion:
    """Of the joints of an arm, (n,) each.

    Attributes:
        delay: s, by which a joint follows a slowly moving command late: T + 2ζ/ω, less the velocity feedforward.
        short: rad, by which its encoder stays behind a slow command: Coulomb friction, and half of the play.
    """

    delay: Array
    short: Array

    @classmethod
    def of(cls, model: MotionModel) -> ServoMotion:
        """Of a model of motion."""

        def each(effect: str, parameter: str) -> Array:
            keys = (f"{effect}.{place}.{parameter}" for place in model.arm.joint_names)
            return np.array([model.values.get(key, 0.0) for key in keys])

        ratio, frequency = (each(ServoResponse.id, name) for name in ("damping_ratio", "frequency_Hz"))
        lag = ratio / (np.pi * frequency)
        late = each(DeadTime.id, "t_s") + lag - each(VelocityFeedforward.id, "t_s")
        short = each(CoulombFriction.id, "c_rad") + 0.5 * each(MotionPlay.id, "b_rad")
        return cls(np.maximum(late, 0.0), short)
