"""Simulated RC servo: slew-rate-limited tracking with dead band, back-driving without pulses, first-order heating.

A servo with a pulse turns at full speed, then approaches the target exponentially, and stops within its dead band. All
phases have closed forms, so the result does not depend on the step size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arm.servo_table import ServoTable

SHORTEST_PULSE, LONGEST_PULSE = 400e-6, 2800e-6
"""s: pulses outside this range are ignored; the servo stays unpowered."""
ARRIVED = 1e-9
"""rad to the target below which a servo without a dead band has arrived."""
STICTION_SPEED = 1e-3
"""rad/s below which an unpowered servo sticks."""


@dataclass(frozen=True)
class ServoKind:
    """Parameters of a servo type: estimates, none measured on the arm's own servos.

    Attributes:
        speed: rad/s, maximum; 0.15 s for 60°, in the middle of what catalogues give for metal-geared
            servos of 1 to 3 N·m (0.11 to 0.19 s).
        lag: s, time constant of the exponential approach.
        dead_band: s of pulse: 0.5 to 2 us for digital servos, 5 us for analogue ones.
        friction: N·m, Coulomb friction of the unpowered gears; assumed a tenth of the stall torque.
        drag: N·m s/rad, viscous friction of the back-driven gears.
        rise: K/(N·m)², steady winding temperature rise over ambient per squared torque.
        warm_up: s, thermal time constant.
        failure_c: °C, permanent failure.
    """

    speed: float = math.radians(60.0) / 0.15
    lag: float = 0.03
    dead_band: float = 1e-6
    friction: float = 0.3
    drag: float = 1.0
    rise: float = 100.0
    warm_up: float = 900.0
    failure_c: float = 150.0


LARGE_SERVO = ServoKind()
"""Joints 1 to 3; in 100 minutes of measuring, loaded or not, none failed (Conenna 2024, section 5.2)."""
SMALL_SERVO = ServoKind(friction=0.1, rise=1300.0)
"""Wrist joints. `rise` makes joint 4 of the lab arm, whose torque is 0.34 N·m RMS over random poses with
66 g at the tip, reach 150 °C within the half hour after which it melted (Conenna 2024, Figure 5.8)."""


def remaining_travel(left: float, dt: float, kind: ServoKind, band: float) -> float:
    """Remaining travel (rad, signed) after `dt` s under a constant pulse, from `left`.

    At `kind.speed` until speed · lag remains, then exponential with `kind.lag`; no motion within `band` (rad).
    """
    distance = abs(left)
    if distance <= band:
        return left
    knee = kind.speed * kind.lag
    if distance > knee:
        full = min(dt, (distance - knee) / kind.speed)
        distance -= kind.speed * full
        dt -= full
    if dt > 0.0:
        distance *= math.exp(-dt / kind.lag)
    return math.copysign(max(distance if distance > ARRIVED else 0.0, band), left)


def backdrive_speed(torque: float, kind: ServoKind) -> float:
    """Speed (rad/s, signed) of an unpowered servo under `torque` (N·m): Coulomb and viscous friction, saturated."""
    speed = (abs(torque) - kind.friction) / kind.drag
    return math.copysign(min(speed, kind.speed), torque) if speed > STICTION_SPEED else 0.0


def winding_rise(rise: float, torque: float, dt: float, kind: ServoKind) -> float:
    """Winding temperature over ambient (K) after `dt` s of constant torque (N·m), from `rise`.

    First-order thermal model with copper losses proportional to the squared torque.
    """
    end = kind.rise * torque * torque
    return end + (rise - end) * math.exp(-dt / kind.warm_up)


@dataclass(slots=True)
class SimulatedServo:
    """State of one servo on its channel.

    `angle`: rad, by its own sensor. `target`: rad, None without a pulse. `torque`: load, N·m. `rise`: winding over
    ambient, K. `direction`: sign of its last move. `burnt`: failed for good, without force.
    """

    name: str
    channel: int
    kind: ServoKind
    table: ServoTable
    lower: float
    upper: float
    band: float
    angle: float
    target: float | None = None
    torque: float = 0.0
    rise: float = 0.0
    direction: int = 0
    burnt: bool = False
    angle_of_width: list[float | None] = field(default_factory=list, repr=False)

    @property
    def unpowered(self) -> bool:
        """Whether it exerts no torque."""
        return self.target is None or self.burnt

    def move(self, dt: float) -> float:
        """Moves for `dt` s; returns the travel (rad)."""
        if self.unpowered:
            wanted = self.angle + backdrive_speed(self.torque, self.kind) * dt
        else:
            assert self.target is not None
            travel = self.target - self.angle
            if -self.band <= travel <= self.band:
                return 0.0
            wanted = self.target - remaining_travel(travel, dt, self.kind, self.band)
        wanted = min(max(wanted, self.lower), self.upper)
        turn = wanted - self.angle
        if turn:
            self.angle = wanted
            self.direction = 1 if turn > 0 else -1
        return turn

    def update_temperature(self, dt: float) -> None:
        """Advances the thermal model by `dt` s at the present load."""
        self.rise = winding_rise(self.rise, 0.0 if self.unpowered else self.torque, dt, self.kind)

    def set_count_duration(self, count_s: float) -> None:
        """Tabulates the angle of every pulse width (counts of `count_s` each)."""
        pulses = np.arange(COUNTS_PER_PERIOD) * count_s
        angles = self.table.angle_of(pulses).tolist()
        valid = (pulses >= SHORTEST_PULSE) & (pulses <= LONGEST_PULSE)
        self.angle_of_width = [angle if ok else None for angle, ok in zip(angles, valid.tolist(), strict=True)]
