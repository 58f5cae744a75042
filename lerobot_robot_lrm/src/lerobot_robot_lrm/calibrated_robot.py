"""A LeRobot robot that commands a calibrated arm: wished angles in, true angles out, everything else passed through."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot

from lerobot_robot_lrm.bounded import FARTHEST, BoundedCommand, bounded_command
from lerobot_robot_lrm.correction import Correction
from lerobot_robot_lrm.units import radians_per_unit
from lrm_math.arm.lerobot_registers import settings_of
from lrm_math.arm.servo_settings import require_same_settings
from lrm_math.arrays import Array
from lrm_math.effects import marked
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model_file import settings_of_model

SUFFIX = ".pos"
NOTABLE_M = 0.002
"""m, that the tip stays beside its goal, from which on it is said."""
logger = logging.getLogger(__name__)


class CalibratedRobot(Robot):
    """Another robot with its commands and observations corrected by a model; the gripper and cameras are left alone.

    Its angles are those of the arm as drawn whose tool is where the real one is: what is sent, what is observed and
    what a data set records mean the same on every arm. Raises `LrmError`: the model is not of this robot.
    """

    config_class = RobotConfig
    name = "calibrated"

    def __init__(self, config: Any, robot: Robot) -> None:
        # Not Robot.__init__: the calibration, its file and its folder are those of the wrapped robot.
        self.robot = robot
        self.config, self.id = config, robot.id
        self.name = self.robot_type = f"{robot.name}_{CalibratedRobot.name}"
        keep = [word.strip() for word in config.keep.split(",") if word.strip()]
        self.correction = Correction.of_file(config.model, 1e-3 * config.payload_g, keep)
        self._measured_with = settings_of_model(config.model)
        self.keys = tuple(f"{name}{SUFFIX}" for name in self.correction.names)
        self._check_names()
        _ = self.correction.arm, self.correction.drawn  # packed before the first command
        self._scale: Array = np.empty(0)
        self._motion: Motion | None = None
        self._before: BoundedCommand | None = None
        self._told: set[str] = set()
        self._tell_what_is_left()

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
        """Connects the wrapped robot.

        Raises `LrmError`: its units are neither degrees nor −100 … 100, or its servos are set otherwise than those that
        the model was measured with.
        """
        self.robot.connect(calibrate)
        try:
            self._check_settings()
        except LrmError:
            self.robot.disconnect()
            raise
        self._forget()

    def calibrate(self) -> None:
        """Calibrates the wrapped robot's motors."""
        self.robot.calibrate()
        self._forget()

    def configure(self) -> None:
        """Configures the wrapped robot."""
        self.robot.configure()

    def disconnect(self) -> None:
        """Disconnects the wrapped robot."""
        self.robot.disconnect()

    def get_observation(self) -> dict[str, Any]:
        """The wrapped robot's, its joints where the model says that they really are."""
        seen = self.robot.get_observation()
        encoders = self._angles(seen, "observation")
        return self._with(seen, self._true_angles(encoders, self._motion or Motion.at(encoders)))

    def send_action(self, action: Mapping[str, Any]) -> dict[str, Any]:
        """Sends the command whose tool is where the wished angles would have it on the arm as drawn.

        How far it may be from the wish, and from the command before: `lerobot_robot_lrm.bounded`. Returns the action
        that was really sent, as true angles. Raises `LrmError`: a joint is missing or no number.
        """
        wish = self._angles(action, "action")
        motion = self._motion or Motion.at(self._angles(self.robot.get_observation(), "observation"))
        answer = bounded_command(self.correction, wish, motion, self._before)
        self._tell_of(wish, answer)
        sent = self.robot.send_action(self._with(action, answer.command))
        angles = self._angles(sent, "action sent")
        self._motion, self._before = motion.to(angles), answer
        as_wished = not (answer.lost or answer.bounded.any()) and np.allclose(
            angles, answer.command, rtol=0.0, atol=1e-9
        )
        held = np.array_equal(answer.command, motion.q)
        return self._with(sent, wish if as_wished and not held else self._true_angles(angles, self._motion))

    def _check_settings(self) -> None:
        """Raises `LrmError`: the servos' gains, torque limits or firmware are not those of the model's measurement."""
        if self.config.accept_settings or self._measured_with is None:
            return
        bus = getattr(self.robot, "bus", None)
        now = None if bus is None else settings_of(bus, self.correction.names)
        require_same_settings(now, self._measured_with, self.config.model, "--robot.accept_settings=true")

    def _tell_of(self, wish: Array, answer: BoundedCommand) -> None:
        low, high = self.correction.limits
        beyond, names = (wish < low) | (wish > high), self.correction.names
        for name in (name for name, far in zip(names, beyond, strict=True) if far):
            self._tell(f"{name} is wished beyond the limits of the arm file; it goes as far as they allow")
        for name in (name for name, bit in zip(names, answer.bounded, strict=True) if bit):
            most = f"{np.degrees(FARTHEST):.0f} deg in all, and a bounded step"
            self._tell(f"the correction of {name} is held at its bound ({most}); the tip is less accurate there")
        if answer.lost:
            self._tell(f"no command is found for some wishes ({answer.lost}); they go with the correction before")
        elif answer.left > NOTABLE_M and not beyond.any():
            where = "near a singular pose the correction is held back, so that no joint swings out"
            self._tell(f"{where}; there the tip stays more than {1e3 * NOTABLE_M:.0f} mm beside its goal")

    def _true_angles(self, encoders: Array, motion: Motion) -> Array:
        try:
            return self.correction.true_angles(encoders, motion)
        except NoEquilibrium as error:
            self._tell(f"some observations are as the encoders read them ({error})")
            return encoders

    def _forget(self) -> None:
        self._motion = self._before = None
        self._scale = radians_per_unit(self.robot, self.correction.names)

    def _angles(self, values: Mapping[str, Any], what: str) -> Array:
        """(n,), rad, of the joints in an action or an observation."""
        if not len(self._scale):
            raise LrmError("the robot is not connected; call connect() first")
        missing = [key for key in self.keys if key not in values]
        if missing:
            raise LrmError(f"the {what} has no '{missing[0]}'; it has {', '.join(sorted(map(str, values)))}")
        angles = np.array([float(values[key]) for key in self.keys]) * self._scale
        if not np.isfinite(angles).all():
            key = self.keys[int(np.flatnonzero(~np.isfinite(angles))[0])]
            raise LrmError(f"the {what} has '{key}' = {values[key]}; should be a finite number")
        return angles

    def _with(self, values: Mapping[str, Any], angles: Array) -> dict[str, Any]:
        """The same with the joints at angles (n,), rad."""
        return {**values, **dict(zip(self.keys, (angles / self._scale).tolist(), strict=True))}

    def _check_names(self) -> None:
        known = self.robot.action_features
        missing = [key for key in self.keys if key not in known]
        if missing:
            arm = self.correction.model.arm.name
            have = ", ".join(key.removesuffix(SUFFIX) for key in known if key.endswith(SUFFIX))
            what = f"a model of the arm '{arm}', whose '{missing[0].removesuffix(SUFFIX)}'"
            raise LrmError(f"{self.config.model}: {what} {self.robot.name} does not have; it has {have}")

    def _tell_what_is_left(self) -> None:
        correction = self.correction
        if correction.left_out:
            self._tell(
                f"not corrected, since no command can know it beforehand: {', '.join(map(marked, correction.left_out))}"
            )
        if not correction.arm.complete:
            self._tell("some effect has no formula in the compiled kernel; a command takes some milliseconds")

    def _tell(self, what: str) -> None:
        """Says something once."""
        if what not in self._told:
            self._told.add(what)
            logger.warning("%s: %s", self.config.model, what)
