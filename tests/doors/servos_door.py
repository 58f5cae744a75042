"""Doors to bare servos: LeRobot's calibrated robot, a campaign over LeRobot's robot, and one over a servo bus."""

from __future__ import annotations

import math
import random
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from examples.so101.dynamixel_bus import DynamixelBus, DynamixelServo
from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import MIDDLE, STEP, FeetechServo
from lrm_ident.measuring.campaign.lerobot_robot import LeRobotServos
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.servo_arm import ServoArm, Servos
from lrm_ident.measuring.campaign.session import torque_named
from lrm_ident.measuring.servo_bus import bus as servo_bus
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.kind import BusServoKind
from lrm_ident.measuring.servo_bus.servos import held_servos
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand
from tests.doors.door import Angles, DoorKind
from tests.doors.lerobot_classes import calibrated_robot_class, robot_config
from tests.doors.lockstep import Lockstep
from tests.doors.simulated_follower import GoalKeepingServo, SimulatedFollower

ARM = load_arm("so101")
NAMES = tuple(str(joint.name) for joint in ARM.joints)
MODEL = """\
schema = "lrm/model/1"
arm = "so101"
effects = ["offsets", "compliance", "hysteresis@joint2", "drift@joint1"]
[parameters]
"offsets.joint2.theta_rad" = 0.03
"offsets.joint3.alpha_rad" = 0.006
"compliance.joint2.k_rad_per_Nm" = 0.05
"hysteresis.joint2.h_rad" = -0.03
"""


class ServosDoor:
    """Common part of the doors below: servos and their time. LeRobot has no stop: who stops sends nothing more."""

    joints: Sequence[str] = NAMES

    def __init__(self, servos: Sequence[FeetechServo], bus: FeetechBus) -> None:
        self.servos, self.bus = servos, bus
        self.time = Lockstep(bus.advance)

    def stop(self) -> None: ...

    def lose_contact(self) -> None: ...

    def disturb(self) -> None: ...

    def pass_time(self, seconds: float) -> None:
        self.time.passes(seconds)

    def commanded(self) -> Angles:
        return tuple(servo.target for servo in self.servos)

    def standing(self) -> Angles:
        return tuple(servo.angle for servo in self.servos)

    def powered(self) -> frozenset[str]:
        return frozenset(name for name, servo in zip(self.joints, self.servos, strict=True) if servo.powered)


def in_degrees(joints: Sequence[str], wish: Sequence[float]) -> dict[str, float]:
    """The action of LeRobot for a wish (rad)."""
    return {f"{name}.pos": math.degrees(q) for name, q in zip(joints, wish, strict=True)}


class CalibratedRobotDoor(ServosDoor):
    """LeRobot's calibrated robot."""

    robot: Any

    def __init__(self, servos: Sequence[FeetechServo], model: Path) -> None:
        super().__init__(servos, FeetechBus(servos))
        self.follower = SimulatedFollower(NAMES, servos)
        config = robot_config(model)
        self.robot = calibrated_robot_class()(config, self.follower)

    def torque_on(self) -> None:
        self.robot.connect()

    def ask(self, wish: Sequence[float]) -> None:
        self.robot.send_action(in_degrees(self.joints, wish))


class CampaignDoor(ServosDoor):
    """A campaign that drives servos: `connect` gives them torque. Who asks is interrupted, as by Ctrl-C."""

    follower: SimulatedFollower

    def __init__(
        self, servos: Sequence[FeetechServo], bus: FeetechBus, connect: Callable[[], Servos],
        break_off: Callable[[], None], lose_answer: Callable[[], None],
    ) -> None:  # fmt: skip
        super().__init__(servos, bus)
        self.connect, self.break_off, self.lose_answer = connect, break_off, lose_answer
        self.arm: ServoArm | None = None

    def torque_on(self) -> None:
        """As `by_servos` does it, with errors that name the joints that have torque."""
        servos = self.connect()
        with torque_named(servos):
            self.arm = ServoArm(servos, ARM, self.time, lambda _: None)

    def ask(self, wish: Sequence[float]) -> None:
        """One pose after the other, so what is on its way is interrupted first."""
        self.stop()
        if self.arm is not None:
            self.time.starts(partial(self.goes, self.arm, wish))

    def goes(self, arm: ServoArm, wish: Sequence[float]) -> None:
        """What is done for a wish: the next pose."""
        arm.go(PlannedPose(1, tuple(wish), 0.0, (1,) * ARM.dof, 1))

    def stop(self) -> None:
        self.time.interrupts()

    def lose_contact(self) -> None:
        """The adapter is unplugged while a pose is approached."""
        self.break_off()

    def disturb(self) -> None:
        self.lose_answer()


class DoorLine:
    """A serial line to a simulated bus, which loses questions, or answers, or both for a while; `gone`: unplugged."""

    def __init__(self, bus: FeetechBus, rng: random.Random) -> None:
        self.bus, self.waiting, self.gone, self._rng = bus, b"", False, rng
        self._asked = 0
        self._losses: set[int] = set()

    def write(self, data: bytes) -> int:
        """Sends bytes to the bus."""
        self._there()
        lost = self._asked in self._losses
        if not lost or self._rng.random() < 0.5:
            answer = self.bus.feed(data, self.bus.now)
            self.waiting += b"" if lost else answer
        self._asked += 1
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Answers of the bus."""
        self._there()
        out, self.waiting = self.waiting[:size], self.waiting[size:]
        return out

    @property
    def in_waiting(self) -> int:
        """Number of bytes that have come."""
        self._there()
        return len(self.waiting)

    def unplug(self) -> None:
        """Ends it."""
        self.gone = True

    def lose(self) -> None:
        """Loses one of the next questions, or some in a row."""
        first = self._asked + self._rng.randrange(60)
        self._losses |= set(range(first, first + self._rng.choice([1, 1, 2, 9])))

    def _there(self) -> None:
        if self.gone:
            raise OSError("device disconnected")


def placed(servos: Sequence[FeetechServo], rng: random.Random, anywhere: bool) -> None:
    """Lets servos stand somewhere, with goals that they had before; `anywhere`: some have limits that they stand
    beyond, some count turns."""
    for servo in servos:
        table.GOAL_POSITION.write(servo.memory, rng.randrange(4096))
        servo.angle = round(rng.uniform(-0.8, 0.8) / STEP) * STEP
        if anywhere and rng.random() < 0.3:
            servo.angle, servo.counts_turns = (rng.randrange(-4096, 8192) - MIDDLE) * STEP, rng.random() < 0.5
            table.MIN_POSITION.write(servo.memory, rng.randrange(0, 1500))


@contextmanager
def by_model(door_class: Any, seed: int) -> Iterator[Any]:
    """A door of LeRobot that takes a model file, with a servo for each of its joints."""
    servos = [GoalKeepingServo(number) for number in range(1, 1 + len(door_class.joints))]
    placed(servos, random.Random(seed), False)
    with tempfile.TemporaryDirectory() as folder:
        (model := Path(folder, "model.toml")).write_text(MODEL)
        yield door_class(servos, model)


@contextmanager
def campaign_over_lerobot(door_class: type[CampaignDoor], seed: int) -> Iterator[CampaignDoor]:
    """A campaign that drives a robot of LeRobot."""
    servos = [GoalKeepingServo(number) for number in range(1, 6)]
    placed(servos, random.Random(seed), False)
    robot = SimulatedFollower(NAMES, servos)

    torque_on_where_they_stand(robot)  # as `connected_robot` does

    def connect() -> LeRobotServos:
        robot.connect()
        return LeRobotServos.of(robot, ARM)

    def unplug() -> None:
        robot.bus.lost = 10**9

    def lose() -> None:
        robot.bus.lost += 1

    door = door_class(servos, FeetechBus(servos), connect, unplug, lose)
    door.follower = robot
    with door.time.ended():
        yield door


@contextmanager
def campaign_over_bus(
    kind: BusServoKind, make: type[FeetechServo], wire: type[FeetechBus], door_class: type[CampaignDoor], seed: int
) -> Iterator[CampaignDoor]:
    """A campaign that drives servos on a bus; nobody waits for answers that do not come."""
    servos = [make(number) for number in range(1, 6)]
    placed(servos, random.Random(seed), make is FeetechServo)
    line = DoorLine(wire(servos), random.Random(seed + 1))
    looks = count()
    connect = partial(held_servos, "x", ServoHost(line, kind), ARM, (1, 2, 3, 4, 5))
    door = door_class(servos, line.bus, connect, line.unplug, line.lose)
    with patch.object(servo_bus, "time", SimpleNamespace(monotonic=lambda: 0.2 * next(looks))), door.time.ended():
        yield door


BUS = (
    "lrm_ident.measuring.servo_bus.bus",
    "lrm_ident.measuring.servo_bus.servos",
    "lrm_ident.measuring.servo_bus.torque_on",
)
FEETECH_BUS = partial(campaign_over_bus, FEETECH, FeetechServo, FeetechBus)
DYNAMIXEL_BUS = partial(campaign_over_bus, DYNAMIXEL, DynamixelServo, DynamixelBus)
LEROBOT_CAMPAIGN = ("lrm_ident.measuring.campaign.lerobot_robot",)
LEROBOT = (
    "lerobot_robot_lrm.calibrated_robot", "lerobot_robot_lrm.wrapped_robot", "lrm_math.arm.lerobot_torque_on",
)  # fmt: skip
DOORS = (
    DoorKind("LeRobot robot", LEROBOT, partial(by_model, CalibratedRobotDoor), 0.0, 0.0),
    DoorKind("campaign over LeRobot", LEROBOT_CAMPAIGN, partial(campaign_over_lerobot, CampaignDoor), 0.0, 0.2),
    DoorKind("Feetech bus", BUS, partial(FEETECH_BUS, CampaignDoor), 0.0, 0.2),
    DoorKind("Dynamixel bus", BUS, partial(DYNAMIXEL_BUS, CampaignDoor), 0.0, 0.2),
)
