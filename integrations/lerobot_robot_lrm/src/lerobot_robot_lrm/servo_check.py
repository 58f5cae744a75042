"""Whether a connected robot's servos are set as those that its models were measured with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lrm_math.arm.lerobot_registers import settings_of
from lrm_math.arm.servo_settings import require_same_settings
from lrm_math.model.model_file import settings_of_model
from lrm_math.motion.motion_model import load_motion


def require_servos_of(model: str, motion: str, robot: Any, joints: Sequence[str], accept: str) -> None:
    """Raises `LrmError`: gains, torque limits or firmware are not those of a model's measurement.

    Args:
        motion: file of a model of motion; empty: none.
        accept: how a person says that it shall be so. A model without settings, or a robot without a bus, passes.
    """
    measured = {model: settings_of_model(model)} | ({motion: load_motion(Path(motion))[0].servos} if motion else {})
    bus = getattr(robot, "bus", None)
    if bus is None or not any(measured.values()):
        return
    now = settings_of(bus, joints)
    for of, then in measured.items():
        require_same_settings(now, then, of, accept)
