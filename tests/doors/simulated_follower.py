"""A stand-in for LeRobot's follower over simulated servos."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from examples.so101.feetech_servo import STEP, FeetechServo
from lrm_ident.measuring.servo_bus import feetech as table

MIDDLE = 2048
SIDES = ("left_", "right_")


class SimulatedBus:
    """Registers of the motors by name, as LeRobot's bus reads and writes them. `lost`: how many reads fail next."""

    def __init__(self, names: Sequence[str], servos: Sequence[FeetechServo]) -> None:
        self.servos = dict(zip(names, servos, strict=True))
        self.lost = 0
        self.motors = {name: SimpleNamespace(model="sts3215", norm_mode="degrees") for name in names}
        self.model_ctrl_table: dict[str, Any] = {"sts3215": {"Torque_Limit": (48, 2)}}
        self.model_resolution_table = {"sts3215": 4096}
        self.calibration = {name: SimpleNamespace(range_min=0, range_max=4095) for name in names}

    def sync_read(self, register: str, motors: Sequence[str]) -> dict[str, float]:
        """Values by motor. Raises `ConnectionError`."""
        if self.lost:
            self.lost -= 1
            raise ConnectionError("no status packet")
        read = {
            "Torque_Enable": lambda servo: float(servo.powered),
            "Present_Temperature": lambda _: 30.0,
            "Torque_Limit": lambda servo: float(table.TORQUE_LIMIT.read(servo.memory)),
        }[register]
        return {name: read(self.servos[name]) for name in motors}

    def write(self, register: str, motor: str, value: int) -> None:
        """Writes the torque limit."""
        assert register == "Torque_Limit"
        table.TORQUE_LIMIT.write(self.servos[motor].memory, value)


class SimulatedFollower:
    """A robot of LeRobot in degrees: a goal is taken at once, the servos turn there as fast as they can."""

    name, id = "so_follower", "simulated"
    is_calibrated = True

    def __init__(self, names: Sequence[str], servos: Sequence[FeetechServo]) -> None:
        self.bus = SimulatedBus(names, servos)
        self.action_features = self.observation_features = {f"{name}.pos": float for name in names}
        self.is_connected = False

    def connect(self, calibrate: bool = True) -> None:
        """Switches the torque on where the servos stand, as LeRobot's `configure` does."""
        self.is_connected = True
        for servo in self.bus.servos.values():
            servo.write(table.TORQUE_ENABLE.address, b"\1")

    def disconnect(self) -> None:
        """Switches the torque off."""
        self.is_connected = False
        for servo in self.bus.servos.values():
            servo.write(table.TORQUE_ENABLE.address, b"\0")

    def get_observation(self) -> dict[str, Any]:
        """Angles of the encoders (deg)."""
        if self.bus.lost:
            self.bus.lost -= 1
            raise ConnectionError("no status packet")
        return {f"{name}.pos": math.degrees((s.count - MIDDLE) * STEP) for name, s in self.bus.servos.items()}

    def send_action(self, action: Mapping[str, float]) -> dict[str, float]:
        """Goals (deg)."""
        for name, servo in self.bus.servos.items():
            count = MIDDLE + round(math.radians(action[f"{name}.pos"]) / STEP)
            servo.write(table.GOAL_POSITION.address, table.GOAL_POSITION.encoded(count))
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
