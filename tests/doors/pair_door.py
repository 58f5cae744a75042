"""Door of LeRobot's calibrated robot with two arms: one base for both, a model for each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from tests.doors.door import DoorKind
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import NAMES, CalibratedRobotDoor, ServosDoor, by_model
from tests.doors.simulated_follower import SIDES, SimulatedFollower, SimulatedPair


class CalibratedPairDoor(CalibratedRobotDoor):
    """See `CalibratedRobotDoor`, of two arms."""

    joints: Sequence[str] = tuple(f"{side}{name}" for side in SIDES for name in NAMES)

    def __init__(self, servos: Sequence[FeetechServo], model: Path) -> None:
        ServosDoor.__init__(self, servos, FeetechBus(servos))
        count = len(NAMES)
        robot = SimulatedPair(*(SimulatedFollower(NAMES, part) for part in (servos[:count], servos[count:])))
        config = SimpleNamespace(
            left_model=str(model), right_model=str(model), left_payload_g=0.0, right_payload_g=0.0, base="left",
            keep="base,tool", accept_settings=False, left_motion="", right_motion="", lead=False,
        )  # fmt: skip
        self.robot = plug_in("calibrated_pair").CalibratedPair(config, robot)


PAIR = partial(by_model, CalibratedPairDoor)
DOORS = (DoorKind("LeRobot pair", ("lerobot_robot_lrm.wrapped_robot",), PAIR, 0.0, 0.0),)
