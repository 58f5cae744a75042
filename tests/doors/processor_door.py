"""Door of LeRobot's processor pipelines: a loop like `lerobot-record`'s over a robot that knows no model."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from lrm_math.errors import LrmError
from tests.doors.door import DoorKind
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import MODEL, NAMES, ServosDoor, placed
from tests.doors.simulated_follower import SimulatedFollower


class ProcessorDoor(ServosDoor):
    """One turn of LeRobot's loop for each wish: observe, process, send. Who stops resets the pipelines."""

    def __init__(self, servos: Sequence[FeetechServo], model: Path) -> None:
        super().__init__(servos, FeetechBus(servos))
        self.follower = SimulatedFollower(NAMES, servos)
        self.model = str(model)
        self.pipelines: tuple[Any, Any] | None = None

    def torque_on(self) -> None:
        """See `MotionDoor`."""
        self.follower.connect()
        self.pipelines = plug_in("pipelines").calibrated_processors(self.follower, self.model)

    def ask(self, wish: Sequence[float]) -> None:
        """See `MotionDoor`."""
        if self.pipelines is None:
            raise LrmError("torque is off")
        action, observation = self.pipelines
        seen = self.follower.get_observation()
        observation(seen)
        degrees = {f"{name}.pos": 57.29577951308232 * q for name, q in zip(NAMES, wish, strict=True)}
        self.follower.send_action(action((degrees, seen)))

    def stop(self) -> None:
        """See `MotionDoor`."""
        if self.pipelines is not None:
            self.pipelines[0].reset()

    def lose_contact(self) -> None:
        """See `MotionDoor`."""

    def disturb(self) -> None:
        """See `MotionDoor`: nothing here waits for an answer."""


@contextmanager
def processor(seed: int) -> Iterator[ProcessorDoor]:
    """LeRobot's pipelines with the steps of the plug-in, by a model file."""
    servos = [FeetechServo(number) for number in range(1, 6)]
    placed(servos, random.Random(seed), False)
    with tempfile.TemporaryDirectory() as folder:
        (model := Path(folder, "model.toml")).write_text(MODEL)
        yield ProcessorDoor(servos, model)


DOORS = (DoorKind("LeRobot processor", ("lerobot_robot_lrm.processor",), processor, 0.0, 0.0),)
