"""Torque for the motors of a LeRobot robot: where they stand, and not taken from an arm that holds.

LeRobot switches torque on with the goal that is in each motor: Feetech firmware that keeps an old one turns there at
full speed (Dynamixel's takes the present place). And while it connects it takes the torque from all motors for a
moment, in which an arm that holds would fall.
"""

from __future__ import annotations

import logging
from typing import Any

from lrm_math.arm.servo_goal import standing_goal

LOGGER = logging.getLogger(__name__)
TORQUE, MODE, TO_ANGLES = "Torque_Enable", "Operating_Mode", 0
PLACE = ("Present_Position", "Min_Position_Limit", "Max_Position_Limit")
FEETECH = {"Goal_Position", "Lock", MODE, *PLACE}
"""Registers that a Feetech motor has; Dynamixel's have no lock."""
HOLDS = "%s holds already: its motors keep torque and settings; to have them set anew, switch their supply off and on"


def torque_on_where_they_stand(robot: Any) -> None:
    """Lets a robot's bus tell each motor its place as its goal before torque, and leaves an arm that holds as it is.

    `bus.enable_torque` then raises `LrmError`, before any motor has torque, where one stands beyond its own limits
    (`standing_goal`). Robots without a bus of motors with registers are left as they are.
    """
    bus = getattr(robot, "bus", None)
    tables = getattr(bus, "model_ctrl_table", None)
    if bus is None or tables is None:
        return
    enable, configure, begun = bus.enable_torque, robot.configure, False

    def enabled(motors: Any = None, num_retry: int = 0) -> None:
        names = [motors] if isinstance(motors, str) else list(bus.motors if motors is None else motors)
        own = [name for name in names if tables[bus.motors[name].model].keys() >= FEETECH]
        to_angles = [name for name in own if bus.read(MODE, name, normalize=False) == TO_ANGLES]
        for name, goal in {name: _goal(bus, name) for name in to_angles}.items():
            bus.write("Goal_Position", name, goal, normalize=False, num_retry=num_retry)
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


def _goal(bus: Any, name: str) -> int:
    at, least, greatest = (int(bus.read(word, name, normalize=False)) for word in PLACE)
    return standing_goal(name, at, least, greatest)
