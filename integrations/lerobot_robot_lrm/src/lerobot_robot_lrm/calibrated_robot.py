"""A LeRobot robot that commands a calibrated arm: wished angles in, true angles out, everything else passed through."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lerobot.robots.robot import Robot

from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction, places_of
from lerobot_robot_lrm.servo_check import require_servos_of
from lerobot_robot_lrm.units import radians_per_unit
from lerobot_robot_lrm.wrapped_robot import WrappedRobot
from lrm_math.arm.lerobot_late_replies import drop_late_replies
from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand
from lrm_math.errors import LrmError


class CalibratedRobot(WrappedRobot):
    """Another robot with its commands and observations corrected by a model; the gripper and cameras are left alone.

    Its angles are those of the arm as drawn whose tool is where the real one is: what is sent, what is observed and
    what a data set records mean the same on every arm. Raises `LrmError`: the model is not of this robot.
    """

    def __init__(self, config: Any, robot: Robot, correction: Correction | None = None) -> None:
        super().__init__(config, robot)
        found = correction or Correction.of_file(
            config.model, 1e-3 * config.payload_g, places_of(config.keep), config.motion, config.lead
        )
        self.arm = CorrectedArm(config.model, found)
        self.arm.check_names(robot.action_features, robot.name)
        drop_late_replies(robot)
        torque_on_where_they_stand(robot)

    @property
    def correction(self) -> Correction:
        """The correction of its joints."""
        return self.arm.correction

    def connect(self, calibrate: bool = True) -> None:
        """Connects the wrapped robot.

        Raises `LrmError`: a motor stands beyond its own limits, its units are neither degrees nor −100 … 100, or its
        servos are set otherwise than those that the model was measured with.
        """
        try:
            self.robot.connect(calibrate)
            if not self.config.accept_settings:
                accept = "--robot.accept_settings=true"
                require_servos_of(self.config.model, self.config.motion, self.robot, self.correction.names, accept)
        except LrmError:
            self.robot.disconnect()
            raise
        self._begin()

    def calibrate(self) -> None:
        """Calibrates the wrapped robot's motors."""
        self.robot.calibrate()
        self._begin()

    def get_observation(self) -> dict[str, Any]:
        """The wrapped robot's, its joints where the model says that they really are."""
        return self.arm.observed(self.robot.get_observation())

    def send_action(self, action: Mapping[str, Any]) -> dict[str, Any]:
        """Sends the command whose tool is where the wished angles would have it on the arm as drawn.

        Returns the action that was really sent, as true angles. Raises `LrmError`: a joint is missing or no number.
        """
        corrected = self.arm.corrected(action, self.robot.get_observation)
        return self.arm.follow(corrected, self.robot.send_action(corrected.action))

    def _begin(self) -> None:
        self.arm.forget()
        self.arm.scale = radians_per_unit(self.robot, self.correction.names)
