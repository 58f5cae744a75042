"""Robots of LeRobot by name, as `--robot lerobot:TYPE,port=…,id=…` takes them, connected and in degrees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from lrm_ident.data.wording import joint_labels
from lrm_math.arm.arm import Arm
from lrm_math.arm.lerobot_late_replies import drop_late_replies
from lrm_math.arm.lerobot_registers import settings_of
from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.errors import LrmError, UnknownName

KIND = "lerobot:"
SUFFIX, DEGREES, MOST_TORQUE = ".pos", "degrees", 1000
"""Ending of a joint's position; value of LeRobot's `MotorNormMode`; a Feetech servo's greatest torque, thousandths."""
CONNECTS = 3
"""Number of attempts: LeRobot asks each motor once, and a bus loses an answer now and then."""
SET = {"use_degrees": True, "disable_torque_on_disconnect": False}
"""Options that are not the user's to choose: what is measured is in degrees, and an arm that is let go of falls."""


def robot_of(text: str) -> Any:
    """The robot that `lerobot:so101_follower,port=/dev/ttyACM0,id=mine` names, not yet connected. Raises `LrmError`."""
    try:
        import lerobot.robots.so_follower  # noqa: F401  (registers its types)
        from lerobot.robots.config import RobotConfig
        from lerobot.robots.utils import make_robot_from_config
        from lerobot.utils.import_utils import register_third_party_plugins
    except ImportError as error:
        raise LrmError(f"--robot {text}: LeRobot is not installed here ({error}); pip install lerobot") from None
    register_third_party_plugins()
    kind, *words = text.removeprefix(KIND).split(",")
    choices = RobotConfig.get_known_choices()
    if kind not in choices:
        raise UnknownName("robot of LeRobot", kind, choices)
    has = {field.name for field in fields(choices[kind])}
    options: dict[str, Any] = {name: value for name, value in SET.items() if name in has}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or name not in has - SET.keys():
            raise UnknownName(f"option of {kind}", word, sorted(has - SET.keys()))
        options[name] = Path(value) if name == "calibration_dir" else value
    try:
        return make_robot_from_config(choices[kind](**options))
    except (TypeError, ValueError) as error:
        raise LrmError(f"--robot {text}: {_one_line(error)}") from None


@dataclass(frozen=True, eq=False)
class LeRobotServos:
    """See `Servos`. `robot`: a connected robot of LeRobot, in degrees."""

    robot: Any
    joints: tuple[str, ...]

    @classmethod
    def of(cls, robot: Any, arm: Arm) -> LeRobotServos:
        """The servos of an arm's joints.

        Raises `LrmError`: they are not the robot's, have no registers to read, or their angles are not in degrees.
        """
        names = joint_labels(arm)
        have = [key.removesuffix(SUFFIX) for key in robot.action_features if key.endswith(SUFFIX)]
        if missing := [name for name in names if name not in have]:
            raise LrmError(f"{robot.name} has no '{missing[0]}' of {arm.name}; it has {', '.join(have)}")
        if getattr(robot, "bus", None) is None:
            raise LrmError(f"{robot.name} has no motor bus whose temperature can be read; measuring needs it")
        for name in names:
            mode = getattr(robot.bus.motors[name], "norm_mode", DEGREES)
            if (unit := getattr(mode, "value", mode)) != DEGREES:
                raise LrmError(f"{robot.name} commands '{name}' in {unit}; should be {DEGREES} (use_degrees=true)")
        return cls(robot, names)

    @property
    def name(self) -> str:
        """See `Servos`."""
        return str(self.robot.name)

    def angles(self) -> tuple[float, ...]:
        """See `Servos`."""
        values = self.robot.get_observation()
        return tuple(math.radians(float(values[f"{name}{SUFFIX}"])) for name in self.joints)

    @property
    def step(self) -> float:
        """See `Servos`: LeRobot takes any angle, and rounds it by itself."""
        return 0.0

    def beyond_limits(self, q: Sequence[float]) -> str:
        """See `Servos`: by the ranges that the robot was calibrated with, about whose middle LeRobot counts angles."""
        bus = self.robot.bus
        for name, angle in zip(self.joints, q, strict=True):
            swept, turn = bus.calibration[name], bus.model_resolution_table[bus.motors[name].model] - 1
            most = 180.0 * (swept.range_max - swept.range_min) / turn
            if abs(at := math.degrees(angle)) > most:
                return f"{name}: {at:.1f} deg is beyond the {most:.0f} deg to either side of its calibration"
        return ""

    def command(self, q: Sequence[float]) -> None:
        """See `Servos`."""
        keys = (f"{name}{SUFFIX}" for name in self.joints)
        self.robot.send_action(dict(zip(keys, map(math.degrees, q), strict=True)))

    def powered(self) -> Mapping[str, bool]:
        """See `Servos`."""
        return {name: bool(value) for name, value in self._read("Torque_Enable").items()}

    def temperature(self) -> Mapping[str, float]:
        """See `Servos`."""
        return {name: float(value) for name, value in self._read("Present_Temperature").items()}

    def settings(self) -> ServoSettings:
        """See `Servos`."""
        return settings_of(self.robot.bus, self.joints)

    def bound_torque(self, share: float) -> None:
        """See `Servos`. That of a servo which holds is only lowered, as on a bus of ours (`torque_on.bound_torque`)."""
        bus, bound = self.robot.bus, round(share * MOST_TORQUE)
        bounded = [name for name in self.joints if "Torque_Limit" in bus.model_ctrl_table[bus.motors[name].model]]
        if not bounded:
            return
        powered, limits = self.powered(), bus.sync_read("Torque_Limit", bounded)
        for name in bounded:
            bus.write("Torque_Limit", name, min(bound, int(limits[name])) if powered[name] else bound)

    def forget_late_answers(self) -> None:
        """See `Servos`: LeRobot would take them for answers to what is asked next."""
        port = getattr(getattr(self.robot.bus, "port_handler", None), "ser", None)
        if port is not None:
            port.read(port.in_waiting)

    def _read(self, register: str) -> Mapping[str, Any]:
        values = dict(self.robot.bus.sync_read(register, list(self.joints)))
        return {name: values[name] for name in self.joints}


@contextmanager
def connected_robot(text: str) -> Iterator[Any]:
    """The robot, connected; it holds where it is left. Raises `LrmError`: no answer, not calibrated."""
    robot = robot_of(text)
    drop_late_replies(robot)
    torque_on_where_they_stand(robot)
    for attempts_left in reversed(range(CONNECTS)):
        try:
            robot.connect(calibrate=False)
            break
        except (ConnectionError, RuntimeError, OSError, LrmError) as error:
            if robot.is_connected:
                robot.disconnect()
            if not attempts_left or isinstance(error, LrmError):
                raise LrmError(f"--robot {text}: {_one_line(error)}") from None
    try:
        if not robot.is_calibrated:
            raise LrmError(f"--robot {text}: its motors are not calibrated as its file says; run lerobot-calibrate")
        yield robot
    finally:
        robot.disconnect()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
