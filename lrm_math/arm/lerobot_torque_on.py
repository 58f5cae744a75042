"""Torque for the motors of a LeRobot robot: where they stand, and not taken from an arm that holds.

LeRobot switches torque on with the goal that is in each motor: Feetech firmware that keeps an old one turns there at
full speed (Dynamixel's takes the present place). And while it connects it takes the torque from all motors for a
moment, in which an arm that holds would fall. A Feetech motor whose supply was off has fallen, and switches its torque
on by itself when it gets a goal (huggingface/lerobot issue 3585).
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

from lrm_math.arm.servo_goal import standing_goal
from lrm_math.errors import LrmError

LOGGER = logging.getLogger(__name__)
TORQUE, GOAL, MODE, TO_ANGLES = "Torque_Enable", "Goal_Position", "Operating_Mode", 0
PLACE = ("Present_Position", "Min_Position_Limit", "Max_Position_Limit")
FEETECH = {GOAL, "Lock", MODE, *PLACE}
"""Registers that a Feetech motor has; Dynamixel's have no lock."""
HOLDS = "%s holds already: its motors keep torque and settings; to have them set anew, switch their supply off and on"


def torque_on_where_they_stand(robot: Any) -> None:
    """Lets a robot's bus tell each motor its place as its goal before torque, leaves an arm that holds as it is, and
    sends goals to motors with torque only.

    `bus.enable_torque` then raises `LrmError`, before any motor has torque, where one stands beyond its own limits
    (`standing_goal`), and `bus.sync_write` of goals where one has lost its torque. Robots without a bus of motors with
    registers are left as they are.
    """
    bus = getattr(robot, "bus", None)
    tables = getattr(bus, "model_ctrl_table", None)
    if bus is None or tables is None:
        return
    enable, configure, begun = bus.enable_torque, robot.configure, False

    def enabled(motors: Any = None, num_retry: int = 0) -> None:
        names = [motors] if isinstance(motors, str) else list(bus.motors if motors is None else motors)
        bus_motors = _feetech(bus, names)
        to_angles = [name for name in bus_motors if bus.read(MODE, name, normalize=False) == TO_ANGLES]
        for name, goal in {name: _goal(bus, name) for name in to_angles}.items():
            bus.write(GOAL, name, goal, normalize=False, num_retry=num_retry)
        enable(motors, num_retry=num_retry)

    def configured() -> None:
        """Again after a failure, though motors that were switched on before it hold."""
        nonlocal begun
        if not begun and all(bus.read(TORQUE, name, normalize=False) for name in bus.motors):
            LOGGER.warning(HOLDS, robot.name)
        else:
            begun = True
            configure()

    bus.enable_torque, robot.configure = enabled, configured
    if getattr(bus, "protocol_version", 0) == 0:  # LeRobot reads motors of the other one after the other
        _goals_with_torque(bus)


def _goals_with_torque(bus: Any) -> None:
    write = bus.sync_write

    def written(data_name: str, values: Any, *arguments: Any, **named: Any) -> None:
        if data_name == GOAL and (bus_motors := _feetech(bus, bus.motors if not isinstance(values, dict) else values)):
            torques = bus.sync_read(TORQUE, bus_motors, normalize=False)
            if limp := [name for name in bus_motors if not torques[name]]:
                what = f"{', '.join(limp)} lost torque: was the supply off?"
                raise LrmError(f"{what} Nothing is sent. Look where the arm stands, and connect anew")
        write(data_name, values, *arguments, **named)

    bus.sync_write = written


def _feetech(bus: Any, names: Iterable[str]) -> list[str]:
    return [name for name in names if bus.model_ctrl_table[bus.motors[name].model].keys() >= FEETECH]


def _goal(bus: Any, name: str) -> int:
    at, least, greatest = (int(bus.read(word, name, normalize=False)) for word in PLACE)
    return standing_goal(name, at, least, greatest)
