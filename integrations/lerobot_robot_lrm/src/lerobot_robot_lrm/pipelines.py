"""The pipelines of a connected robot that LeRobot's loops take, with the correction by a model in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from lerobot.processor import RobotProcessorPipeline
from lerobot.processor.converters import (
    observation_to_transition,
    robot_action_observation_to_transition,
    transition_to_observation,
    transition_to_robot_action,
)

from lerobot_robot_lrm.processor import CalibratedAction, CalibratedObservation
from lerobot_robot_lrm.servo_check import require_servos_of
from lerobot_robot_lrm.units import radians_per_unit
from lerobot_robot_lrm.wrapped_robot import WrappedRobot
from lrm_math.arm.lerobot_late_replies import drop_late_replies
from lrm_math.errors import LrmError


def calibrated_processors(
    robot: Any,
    model: str,
    payload_g: float = 0.0,
    keep: str = "base,tool",
    accept_settings: bool = False,
    motion: str = "",
    lead: bool = False,
) -> tuple[Any, Any]:
    """`robot_action_processor` and `robot_observation_processor` of a connected robot, as `record_loop` takes them.

    Units are those of the robot, whose servos' late replies are dropped from now on. Raises `LrmError`: it corrects
    already, is not connected, or its servos are set otherwise than those that a model was measured with, see
    `accept_settings`.
    """
    if isinstance(robot, WrappedRobot):
        raise LrmError(f"{robot.name} corrects its commands already; take its pipelines or its calibrated form")
    if not robot.is_connected:
        raise LrmError(f"{robot.name} is not connected; its units and its servos' settings are read from it")
    drop_late_replies(robot)
    action = CalibratedAction(model, payload_g, keep, motion=motion, lead=lead)
    action.arm.check_names(robot.action_features, robot.name)
    if not accept_settings:
        require_servos_of(model, motion, robot, action.arm.correction.names, "accept_settings=True")
    halves = np.degrees(100.0 * radians_per_unit(robot, action.arm.correction.names))
    names = action.arm.correction.names
    ranges = {name: float(half) for name, half in zip(names, halves, strict=True) if abs(half - 100.0) > 1e-9}
    options = (model, payload_g, keep, "", ranges, motion, lead)
    before = RobotProcessorPipeline(
        steps=[CalibratedAction(*options)],
        to_transition=robot_action_observation_to_transition,
        to_output=transition_to_robot_action,
    )
    after = RobotProcessorPipeline(
        steps=[CalibratedObservation(*options)],
        to_transition=observation_to_transition,
        to_output=transition_to_observation,
    )
    return before, after
