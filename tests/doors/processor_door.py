"""Door of LeRobot's processor pipelines: a loop like `lerobot-record`'s over a robot that knows no model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand
from lrm_math.errors import LrmError
from tests.doors.door import DoorKind
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import NAMES, ServosDoor, by_model, in_degrees
from tests.doors.simulated_follower import SimulatedFollower


class ProcessorDoor(ServosDoor):
    """One turn of LeRobot's loop for each wish: observe, process, send. Who stops resets the pipelines."""

    def __init__(self, servos: Sequence[FeetechServo], model: Path) -> None:
        super().__init__(servos, FeetechBus(servos))
        self.follower = SimulatedFollower(NAMES, servos)
        self.model = str(model)
        self.pipelines: tuple[Any, Any] | None = None

    def torque_on(self) -> None:
        torque_on_where_they_stand(self.follower)
        self.follower.connect()
        self.pipelines = plug_in("pipelines").calibrated_processors(self.follower, self.model)

    def ask(self, wish: Sequence[float]) -> None:
        if self.pipelines is None:
            raise LrmError("torque is off")
        action, observation = self.pipelines
        seen = self.follower.get_observation()
        observation(seen)
        self.follower.send_action(action((in_degrees(NAMES, wish), seen)))

    def stop(self) -> None:
        if self.pipelines is not None:
            self.pipelines[0].reset()


PROCESSOR = partial(by_model, ProcessorDoor)
DOORS = (DoorKind("LeRobot processor", ("lerobot_robot_lrm.processor",), PROCESSOR, 0.0, 0.0),)
