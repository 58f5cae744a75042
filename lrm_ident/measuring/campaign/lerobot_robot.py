"""Robots of LeRobot by name, as `--robot lerobot:TYPE,port=…,id=…` takes them, connected and in degrees."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from lrm_math.errors import LrmError, UnknownName

KIND = "lerobot:"
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
    known = RobotConfig.get_known_choices()
    if kind not in known:
        raise UnknownName("robot of LeRobot", kind, known)
    has = {field.name for field in fields(known[kind])}
    options: dict[str, Any] = {name: value for name, value in SET.items() if name in has}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or name not in has - SET.keys():
            raise UnknownName(f"option of {kind}", word, sorted(has - SET.keys()))
        options[name] = Path(value) if name == "calibration_dir" else value
    try:
        return make_robot_from_config(known[kind](**options))
    except (TypeError, ValueError) as error:
        raise LrmError(f"--robot {text}: {_one_line(error)}") from None


@contextmanager
def connected_robot(text: str) -> Iterator[Any]:
    """The robot, connected; it holds where it is left. Raises `LrmError`: no answer, not calibrated."""
    robot = robot_of(text)
    for left in reversed(range(CONNECTS)):
        try:
            robot.connect(calibrate=False)
            break
        except (ConnectionError, RuntimeError, OSError) as error:
            if robot.is_connected:
                robot.disconnect()
            if not left:
                raise LrmError(f"--robot {text}: {_one_line(error)}") from None
    try:
        if not robot.is_calibrated:
            raise LrmError(f"--robot {text}: its motors are not calibrated as its file says; run lerobot-calibrate")
        yield robot
    finally:
        robot.disconnect()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
