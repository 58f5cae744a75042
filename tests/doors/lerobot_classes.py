"""Classes of the plug-in; where LeRobot is not installed, over stand-ins for what they take from it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import patch


class ProcessorStandIn:
    """As LeRobot's steps: `transition` is the last one."""

    transition: Mapping[str, Any]
    key: ClassVar[str]

    def __call__(self, transition: Mapping[str, Any]) -> dict[str, Any]:
        """A transition with this step's part processed."""
        self.transition = dict(transition)
        return {**transition, self.key: getattr(self, self.key)(dict(transition[self.key]))}


class ActionStandIn(ProcessorStandIn):
    """As `RobotActionProcessorStep`."""

    key = "action"


class ObservationStandIn(ProcessorStandIn):
    """As `ObservationProcessorStep`."""

    key = "observation"


class RegistryStandIn:
    """As `ProcessorStepRegistry`."""

    @staticmethod
    def register(_: str) -> Callable[[type], type]:
        """Leaves a class as it is."""
        return lambda step: step


class PipelineStandIn:
    """As `RobotProcessorPipeline`."""

    def __init__(self, steps: Any, to_transition: Callable[[Any], Any], to_output: Callable[[Any], Any]) -> None:
        self.steps, self.to_transition, self.to_output = steps, to_transition, to_output

    def __call__(self, data: Any) -> Any:
        """Data through all steps."""
        transition = self.to_transition(data)
        for step in self.steps:
            transition = step(transition)
        return self.to_output(transition)

    def reset(self) -> None:
        """Resets the steps."""
        for step in self.steps:
            step.reset()


STAND_INS: dict[str, dict[str, Any]] = {
    "lerobot": {},
    "lerobot.robots": {},
    "lerobot.robots.config": {"RobotConfig": type("RobotConfig", (), {})},
    "lerobot.robots.robot": {"Robot": type("Robot", (), {})},
    "lerobot.processor": {
        "RobotActionProcessorStep": ActionStandIn,
        "ObservationProcessorStep": ObservationStandIn,
        "ProcessorStepRegistry": RegistryStandIn,
        "RobotProcessorPipeline": PipelineStandIn,
    },
    "lerobot.processor.converters": {
        "observation_to_transition": lambda seen: {"observation": seen},
        "robot_action_observation_to_transition": lambda both: {"action": both[0], "observation": both[1]},
        "transition_to_observation": lambda transition: transition["observation"],
        "transition_to_robot_action": lambda transition: transition["action"],
    },
}


def plug_in(module: str) -> Any:
    """A module of the plug-in."""
    import_module("lerobot_robot_lrm")  # whether LeRobot is there is decided before there is a stand-in
    name = f"lerobot_robot_lrm.{module}"
    if find_spec("lerobot") is not None:
        return import_module(name)
    made = {}
    for stand_in, content in STAND_INS.items():
        made[stand_in] = ModuleType(stand_in)
        made[stand_in].__dict__.update(content)
    with patch.dict(sys.modules, made):
        found = import_module(name)
        own = {key: one for key, one in sys.modules.items() if key.startswith("lerobot_robot_lrm.")}
    sys.modules.update(own)
    return found


def calibrated_robot_class() -> Any:
    """`CalibratedRobot`."""
    return plug_in("calibrated_robot").CalibratedRobot


def robot_config(model: Path | str, **options: Any) -> SimpleNamespace:
    """Options of a `CalibratedRobot`: those given, the others as where none is."""
    usual = {"payload_g": 0.0, "keep": "base,tool", "accept_settings": False, "motion": "", "lead": False}
    return SimpleNamespace(**{"model": str(model), **usual, **options})
