"""LeRobot's robots over the simulated bus, made by LeRobot from a command line's words as its own commands do."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import draccus
import numpy as np
from lerobot.robots.config import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.import_utils import register_third_party_plugins

from lrm_math.arrays import Array
from lrmd.sim.control_socket import query_board

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
ROBOT_ID = "simulated"
TRIES = 20
Answer = TypeVar("Answer")


@dataclass
class Parsed:
    """Arguments that LeRobot's commands parse, as far as needed."""

    robot: RobotConfig


def write_calibration(path: Path) -> None:
    """LeRobot's calibration file of an arm whose motors were swept over their whole range."""
    swept = {
        name: {"id": number, "drive_mode": 0, "homing_offset": 0, "range_min": 1, "range_max": 4095}
        for number, name in enumerate(MOTORS, start=1)
    }
    path.write_text(json.dumps(swept))


@contextmanager
def follower(link: Path, kind: str, **options: str) -> Iterator[Any]:
    """A connected robot of a type that LeRobot knows or finds, with its motors' calibration file."""
    register_third_party_plugins()
    write_calibration(link.parent / f"{ROBOT_ID}.json")
    given = {"type": kind, "port": str(link), "id": ROBOT_ID, "calibration_dir": str(link.parent), **options}
    config = draccus.parse(Parsed, args=[f"--robot.{name}={value}" for name, value in given.items()]).robot
    robot = make_robot_from_config(config)
    with_retries(robot, lambda: _connect(robot))
    with_retries(robot, lambda: robot.bus.write_calibration(robot.calibration))
    try:
        yield robot
    finally:
        with_retries(robot, robot.disconnect)


def rest_at(robot: Any, link: Path, angles: Array) -> tuple[dict[str, Any], Array]:
    """Sends joint angles (n,), rad, waits until nothing moves; what was sent, and the true tip (3,), m."""
    goals = query_board(link, "joints")["goals"]
    action = {f"{name}.pos": float(q) for name, q in zip(MOTORS, np.degrees(angles), strict=False)}
    sent = with_retries(robot, lambda: robot.send_action({**action, "gripper.pos": 50.0}))
    while (joints := query_board(link, "joints"))["moving"] or joints["goals"] == goals:
        time.sleep(0.02)
    return sent, np.array(query_board(link, "tip")["tip_m"])


def with_retries(robot: Any, request: Callable[[], Answer]) -> Answer:
    """Repeats a request where a busy machine made LeRobot's 50 ms for an answer too short, without what came too late.

    The simulated bus answers one request after the other: once it has answered two at its other door, all that
    were sent on the wire before are answered.
    """
    for _ in range(TRIES - 1):
        try:
            return request()
        except (ConnectionError, RuntimeError):
            for _ in range(2):
                query_board(Path(robot.bus.port), "joints")
            if robot.bus.port_handler.is_open:
                robot.bus.port_handler.ser.reset_input_buffer()
    return request()


def _connect(robot: Any) -> None:
    if robot.is_connected:
        robot.bus.port_handler.closePort()
    robot.connect(calibrate=False)


def angles_of(values: Mapping[str, Any]) -> Array:
    """(n,), rad, of the joints in an action or an observation."""
    return np.radians([float(values[f"{name}.pos"]) for name in MOTORS[:-1]])
