"""Door of LeRobot's calibrated robot with two arms: one base for both, a model for each."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from tests.doors.door import DoorKind
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import MODEL, NAMES, ServosDoor, placed
from tests.doors.simulated_follower import SIDES, SimulatedFollower, SimulatedPair

BOTH = tuple(f"{side}{name}" for side in SIDES for name in NAMES)


class CalibratedPairDoor(ServosDoor):
    """See `CalibratedRobotDoor`, of two arms."""

    joints: Sequence[str] = BOTH

    def __init__(self, servos: Sequence[FeetechServo], model: Path) -> None:
        super().__init__(servos, FeetechBus(servos))
        count = len(NAMES)
        robot = SimulatedPair(*(SimulatedFollower(NAMES, part) for part in (servos[:count], servos[count:])))
        config = SimpleNamespace(
            left_model=str(model), right_model=str(model), left_payload_g=0.0, right_payload_g=0.0, base="left",
            keep="base,tool", accept_settings=False,
        )  # fmt: skip
        self.robot = plug_in("calibrated_pair").CalibratedPair(config, robot)

    def torque_on(self) -> None:
        """See `MotionDoor`."""
        self.robot.connect()

    def ask(self, wish: Sequence[float]) -> None:
        """See `MotionDoor`."""
        self.robot.send_action({f"{name}.pos": 57.29577951308232 * q for name, q in zip(BOTH, wish, strict=True)})

    def stop(self) -> None:
        """See `MotionDoor`."""

    def lose_contact(self) -> None:
        """See `MotionDoor`."""

    def disturb(self) -> None:
        """See `MotionDoor`: nothing here waits for an answer."""

    def powered(self) -> frozenset[str]:
        """See `MotionDoor`."""
        return frozenset(name for name, servo in zip(BOTH, self.servos, strict=True) if servo.powered)


@contextmanager
def calibrated_pair(seed: int) -> Iterator[CalibratedPairDoor]:
    """LeRobot's calibrated robot with two arms, by a model file."""
    servos = [FeetechServo(number) for number in range(1, 11)]
    placed(servos, random.Random(seed), False)
    with tempfile.TemporaryDirectory() as folder:
        (model := Path(folder, "model.toml")).write_text(MODEL)
        yield CalibratedPairDoor(servos, model)


DOORS = (DoorKind("LeRobot pair", ("lerobot_robot_lrm.wrapped_robot",), calibrated_pair, 0.0, 0.0),)
