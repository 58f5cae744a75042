"""The arm in motion: what its joints do between a command and a reading, and the effects that shape it."""

from __future__ import annotations

from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.effects import MOTION_EFFECTS, ServoResponse

__all__ = ["MOTION_EFFECTS", "JointDrive", "MotionEffect", "ServoResponse"]
