"""The step for LeRobot's robot action pipelines, registered as `lrm_calibrated_action`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from lerobot.processor import ProcessorStepRegistry, RobotActionProcessorStep

from lerobot_processor_lrm.compensation import Compensation

SUFFIX = ".pos"


@ProcessorStepRegistry.register("lrm_calibrated_action")
@dataclass
class CalibratedActionStep(RobotActionProcessorStep):
    """Desired joint angles (deg, `NAME.pos`) to commanded ones by a model; other keys pass through.

    Attributes:
        model: path of a model file. payload_g: what the tool carries.
    """

    model: str
    payload_g: float = 0.0
    _compensation: Compensation = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._compensation = Compensation.of_file(self.model, self.payload_g)

    def action(self, action: dict[str, Any]) -> dict[str, Any]:
        """The action with the joints' angles corrected. Raises `ValueError`: a joint is not in it."""
        keys = [f"{name}{SUFFIX}" for name in self._compensation.names]
        missing = [key for key in keys if key not in action]
        if missing:
            raise ValueError(f"the action has no '{missing[0]}'; it has {', '.join(sorted(map(str, action)))}")
        command = np.degrees(self._compensation.command(np.radians([float(action[key]) for key in keys])))
        return {**action, **dict(zip(keys, command.tolist(), strict=True))}

    def transform_features(self, features: Any) -> Any:
        """The features stay as they are."""
        return features

    def get_config(self) -> dict[str, Any]:
        """What the step is saved with."""
        return {"model": self.model, "payload_g": self.payload_g}
