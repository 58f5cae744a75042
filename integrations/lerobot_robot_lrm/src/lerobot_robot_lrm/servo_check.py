"""Whether a connected robot's servos are set as those that a model was measured with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lrm_math.arm.lerobot_registers import settings_of
from lrm_math.arm.servo_settings import require_same_settings
from lrm_math.model.model_file import settings_of_model


def require_servos_of(model: str, robot: Any, joints: Sequence[str], accept: str) -> None:
    """Raises `LrmError`: gains, torque limits or firmware are not those of the model's measurement.

    `accept`: how a person says that it shall be so. A model without settings, or a robot without a bus, passes.
    """
    then, bus = settings_of_model(model), getattr(robot, "bus", None)
    if then is not None and bus is not None:
        require_same_settings(settings_of(bus, joints), then, model, accept)
