"""A LeRobot robot that does what another one does, where its own class says nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot

CALIBRATED = "calibrated"


class WrappedRobot(Robot):
    """Another robot under a name of its own; calibration, its file and its folder are those of the other."""

    config_class = RobotConfig
    name = CALIBRATED

    def __init__(self, config: Any, robot: Robot) -> None:
        # Not Robot.__init__, which would read a calibration.
        self.robot = robot
        self.config, self.id = config, robot.id
        self.name = self.robot_type = f"{robot.name}_{CALIBRATED}"

    def __getattr__(self, name: str) -> Any:
        """Attributes that the wrapped robot has beside the contract: bus, cameras, calibration …"""
        if name == "robot":
            raise AttributeError(name)
        return getattr(self.robot, name)

    @property
    def observation_features(self) -> dict[str, Any]:
        """Observation features of the wrapped robot."""
        return dict(self.robot.observation_features)

    @property
    def action_features(self) -> dict[str, Any]:
        """Action features of the wrapped robot."""
        return dict(self.robot.action_features)

    @property
    def is_connected(self) -> bool:
        """Whether the wrapped robot is connected."""
        return bool(self.robot.is_connected)

    @property
    def is_calibrated(self) -> bool:
        """Whether the wrapped robot's motors are calibrated."""
        return bool(self.robot.is_calibrated)

    def connect(self, calibrate: bool = True) -> None:
        """Connects the wrapped robot."""
        self.robot.connect(calibrate)

    def calibrate(self) -> None:
        """Calibrates the wrapped robot's motors."""
        self.robot.calibrate()

    def configure(self) -> None:
        """Configures the wrapped robot."""
        self.robot.configure()

    def disconnect(self) -> None:
        """Disconnects the wrapped robot."""
        self.robot.disconnect()

    def get_observation(self) -> dict[str, Any]:
        """The wrapped robot's."""
        return dict(self.robot.get_observation())

    def send_action(self, action: Mapping[str, Any]) -> dict[str, Any]:
        """Sends an action to the wrapped robot."""
        return dict(self.robot.send_action(action))
