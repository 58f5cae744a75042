"""A stand-in for LeRobot's follower over simulated servos."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from examples.so101.feetech_servo import STEP, FeetechServo
from lrm_ident.measuring.servo_bus import feetech as table

MIDDLE = 2048


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
        read = {"Torque_Enable": lambda servo: float(servo.powered), "Present_Temperature": lambda _: 30.0}[register]
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
