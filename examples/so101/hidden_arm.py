"""The arm behind the simulated bus: an SO-101 of the independent generator, with errors that no model knows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from examples.so101.dynamixel_bus import DynamixelBus, DynamixelServo
from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from examples.so101.true_tool import tools_after
from lrm_math.arrays import Array
from validation.synthetic import (
    ArmDescription,
    Deviations,
    FrictionLag,
    GroundTruth,
    HiddenEffect,
    OneSidedGain,
    Schedule,
    SoftPlay,
    load_arm,
    true_state,
)

ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / "so101.toml"
DEG = math.pi / 180.0
JOINTS = 5
GRIPPER = 6
"""Id of the gripper's servo, which no tip depends on; the joints' are 1 to 5."""
GEOMETRY_SD = {"theta_rad": 0.02, "d_m": 0.001, "a_m": 0.001, "alpha_rad": 0.01}
COMPLIANCE_RAD_PER_NM = (0.03, 0.06)
"""Of the joints: with them the stretched arm sags by the 2 to 3 degrees that owners report."""
BASE_COMPLIANCE_RAD_PER_NM = 0.005
LONGEST_HISTORY = 100
"""Turning points that friction may remember."""
HIDDEN: dict[str, Callable[[float], HiddenEffect]] = {
    "play": lambda size: SoftPlay(3, 1.6 * DEG * size, 0.05),
    "friction": lambda size: FrictionLag(2, 1.6 * DEG * size, 8.0 * DEG),
    "gain": lambda size: OneSidedGain(3, 1, 0.03 * size, 6.0 * DEG),
}
"""Effects by name, of a size about 1."""
NAMED = {
    "play": ("backlash@joint3", "play in the gear of the elbow"),
    "friction": ("friction_curve@joint2", "friction in the shoulder, which remembers where it came from"),
    "gain": ("servo_gain@joint3", "a wrong gain of the elbow's servo, on one side of zero"),
}
"""The same by the tool's names, and in words."""
SIMPLER = {"friction": "hysteresis@joint2"}
"""The same causes in the simplest form that the tool has for them: friction whose memory the data do not show."""


def hidden_truth(arm: ArmDescription, effect: str, seed: int) -> GroundTruth:
    """Random errors of the joints' geometry, springs of base and joints, one of `HIDDEN` within a fifth of its size.

    Base and tool are as drawn: where a tracker's targets sit on them is known.
    """
    rng = np.random.default_rng([seed, 34])
    hidden = HIDDEN[effect](round(float(rng.uniform(0.8, 1.2)), 3))
    errors = {
        f"joint{number}.{key}": round(float(rng.normal(scale=sd)), 6)
        for number in range(1, JOINTS + 1)
        for key, sd in GEOMETRY_SD.items()
    }
    springs = tuple(round(float(k), 5) for k in rng.uniform(*COMPLIANCE_RAD_PER_NM, size=JOINTS))
    return replace(
        GroundTruth.nominal(arm),
        deviations=Deviations.named(JOINTS, errors),
        base_compliance_rad_per_nm=BASE_COMPLIANCE_RAD_PER_NM,
        joint_compliance_rad_per_nm=springs,
        effects=(hidden,),
    )


def tip_after(arm: ArmDescription, truth: GroundTruth, path: Array) -> Array:
    """(3,), true tip (m) after straight moves along joint angles (P, n), rad."""
    schedule = Schedule(np.arange(1.0, len(path) + 1.0), np.ones(len(path)), path[0])
    return np.asarray(true_state(arm, truth, path, 0.0, schedule).tcp_m[-1])


BUSES: dict[str, tuple[type[FeetechServo], type[FeetechBus]]] = {
    "feetech": (FeetechServo, FeetechBus), "dynamixel": (DynamixelServo, DynamixelBus),
}  # fmt: skip
"""Servos that may move it, and what they speak."""


@dataclass(eq=False)
class HiddenSo101:
    """The true arm and the bus that moves it, with servos of a kind of `BUSES`.

    `history`: (n,) each, rad, where the joints stood whenever one may have turned round. `dead_time`: s, of the servos.
    """

    truth: GroundTruth
    arm: ArmDescription = field(default_factory=lambda: load_arm(ARM_FILE))
    history: list[Array] = field(default_factory=list)
    kind: str = "feetech"
    dead_time: float = 0.0

    def __post_init__(self) -> None:
        self._drawn = GroundTruth.nominal(self.arm)  # its torques: sag changes them by two percent, and takes long
        servo, bus = BUSES[self.kind]
        self.servos = tuple(servo(number) for number in range(1, GRIPPER + 1))
        self.bus = bus(self.servos, self._remember, self.dead_time)
        self.history.append(self.q)

    @property
    def q(self) -> Array:
        """(n,), rad, of the joints' shafts."""
        return np.array([servo.angle for servo in self.servos[:JOINTS]])

    def tip(self) -> Array:
        """(3,), true position (m), in the frame of the arm file."""
        return tip_after(self.arm, self.truth, np.array([*self.history, self.q]))

    def tool(self) -> Array:
        """(4, 4), true frame of the tool (m), in the frame of the arm file."""
        return np.asarray(tools_after(self.arm, self.truth, np.array([*self.history, self.q]))[-1])

    def _remember(self) -> None:
        if not np.array_equal(self.history[-1], self.q):
            self.history[:] = [*self.history[1 - LONGEST_HISTORY :], self.q]
            torques = true_state(self.arm, self._drawn, self.q[None]).tau_nm[0]
            for servo, torque in zip(self.servos, torques.tolist(), strict=False):
                servo.torque = torque
