"""A stand-in for LeRobot's follower over simulated servos."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from examples.so101.feetech_servo import LOCK, STEP, FeetechServo
from lrm_ident.measuring.servo_bus import feetech as table

MIDDLE = 2048
SIDES = ("left_", "right_")


REGISTERS = {
    "Torque_Enable": table.TORQUE_ENABLE, "Lock": LOCK, "Operating_Mode": table.MODE,
    "Torque_Limit": table.TORQUE_LIMIT, "Goal_Position": table.GOAL_POSITION, "Present_Position": table.POSITION,
    "Min_Position_Limit": table.MIN_POSITION, "Max_Position_Limit": table.MAX_POSITION,
    "Present_Temperature": table.TEMPERATURE,
}  # fmt: skip
"""Registers by LeRobot's names."""


class GoalKeepingServo(FeetechServo):
    """One whose firmware goes on to its last goal when torque comes on."""

    def write(self, address: int, data: bytes) -> None:
        goal = table.GOAL_POSITION.read(self.memory)
        super().write(address, data)
        if not address <= table.GOAL_POSITION.address < address + len(data):
            table.GOAL_POSITION.write(self.memory, goal)


class SimulatedBus:
    """Registers of the motors by name, as LeRobot's bus reads and writes them. `lost`: how many reads of all motors
    fail next."""

    def __init__(self, names: Sequence[str], servos: Sequence[FeetechServo]) -> None:
        self.servos = dict(zip(names, servos, strict=True))
        self.lost = 0
        self.motors = {name: SimpleNamespace(model="sts3215", norm_mode="degrees") for name in names}
        self.model_ctrl_table = {"sts3215": {name: (at.address, at.length) for name, at in REGISTERS.items()}}
        self.model_resolution_table = {"sts3215": 4096}
        self.calibration = {name: SimpleNamespace(range_min=0, range_max=4095) for name in names}

    def sync_read(self, register: str, motors: Sequence[str], *, normalize: bool = True) -> dict[str, float]:
        """Values by motor. Raises `ConnectionError`."""
        if self.lost:
            self.lost -= 1
            raise ConnectionError("no status packet")
        return {name: float(self.read(register, name)) for name in motors}

    def read(self, register: str, motor: str, *, normalize: bool = True) -> int:
        """Value of a motor."""
        own = REGISTERS[register]
        return own.decoded(self.servos[motor].read(own.address, own.length))

    def write(self, register: str, motor: str, value: int, *, normalize: bool = True, num_retry: int = 0) -> None:
        """Writes a register of a motor."""
        own = REGISTERS[register]
        self.servos[motor].write(own.address, own.encoded(value))

    def sync_write(self, register: str, values: Mapping[str, float]) -> None:
        """Goals (deg) of motors."""
        for name, value in values.items():
            self.write(register, name, MIDDLE + round(math.radians(value) / STEP))

    def disable_torque(self) -> None:
        """Takes the torque from all motors."""
        for name in self.motors:
            self.write("Torque_Enable", name, 0)

    def enable_torque(self, motors: None = None, num_retry: int = 0) -> None:
        """Gives torque to all motors."""
        for name in self.motors:
            self.write("Torque_Enable", name, 1)


class SimulatedFollower:
    """A robot of LeRobot in degrees: a goal is taken at once, the servos turn there as fast as they can."""

    name, id = "so_follower", "simulated"
    is_calibrated = True

    def __init__(self, names: Sequence[str], servos: Sequence[FeetechServo]) -> None:
        self.bus = SimulatedBus(names, servos)
        self.action_features = self.observation_features = {f"{name}.pos": float for name in names}
        self.is_connected = False

    def connect(self, calibrate: bool = True) -> None:
        """Configures the motors, as LeRobot does."""
        self.is_connected = True
        self.configure()

    def configure(self) -> None:
        """Takes the torque from the motors and gives it back; what it would write meanwhile is as it should be."""
        self.bus.disable_torque()
        self.bus.enable_torque()

    def disconnect(self) -> None:
        """Switches the torque off."""
        self.is_connected = False
        self.bus.disable_torque()

    def get_observation(self) -> dict[str, Any]:
        """Angles of the encoders (deg)."""
        if self.bus.lost:
            self.bus.lost -= 1
            raise ConnectionError("no status packet")
        return {f"{name}.pos": math.degrees((s.count - MIDDLE) * STEP) for name, s in self.bus.servos.items()}

    def send_action(self, action: Mapping[str, float]) -> dict[str, float]:
        """Goals (deg)."""
        self.bus.sync_write("Goal_Position", {name: action[f"{name}.pos"] for name in self.bus.servos})
        return dict(action)


class SimulatedPair:
    """A robot of LeRobot with two arms, whose joints' names begin with `left_` and `right_`."""

    name, id = "bi_so_follower", "simulated"
    is_calibrated = True

    def __init__(self, left: SimulatedFollower, right: SimulatedFollower) -> None:
        self.left_arm, self.right_arm = left, right

    @property
    def action_features(self) -> dict[str, Any]:
        """Of both arms."""
        return self._named(lambda arm: arm.action_features)

    @property
    def is_connected(self) -> bool:
        """Whether both arms are."""
        return bool(self.left_arm.is_connected and self.right_arm.is_connected)

    def connect(self, calibrate: bool = True) -> None:
        """Switches the torque on, first of the left arm."""
        self.left_arm.connect(calibrate)
        self.right_arm.connect(calibrate)

    def get_observation(self) -> dict[str, Any]:
        """Angles of the encoders of both (deg)."""
        return self._named(lambda arm: arm.get_observation())

    def send_action(self, action: Mapping[str, float]) -> dict[str, Any]:
        """Goals of both (deg)."""
        own = ({key.removeprefix(side): x for key, x in action.items() if key.startswith(side)} for side in SIDES)
        sent = [arm.send_action(part) for arm, part in zip((self.left_arm, self.right_arm), own, strict=True)]
        return {f"{side}{key}": x for side, part in zip(SIDES, sent, strict=True) for key, x in part.items()}

    def _named(self, of: Callable[[Any], Mapping[str, Any]]) -> dict[str, Any]:
        arms = zip(SIDES, (self.left_arm, self.right_arm), strict=True)
        return {f"{side}{key}": value for side, arm in arms for key, value in of(arm).items()}
