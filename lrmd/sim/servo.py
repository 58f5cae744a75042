"""One simulated RC servo: how fast it follows its pulse, how it sinks without one, how it warms.

A servo with a pulse turns at its full speed, then slows down exponentially, and rests as soon as it is within its dead
band. All three have closed forms, so a long step and many short ones end at the same angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lrm_math.arm.servo_table import COUNTS_PER_PERIOD, ServoTable

SHORTEST_PULSE, LONGEST_PULSE = 400e-6, 2800e-6
"""s: a servo takes pulses outside of these for noise and stays without force."""
STANDS = 1e-9
"""rad, closer than which a servo without a dead band has arrived."""
STICKS = 1e-3
"""rad/s, slower than which a sinking servo stands."""


@dataclass(frozen=True)
class ServoKind:
    """What one type of servo does. Nothing here was measured on the arm's own servos, whose maker publishes little.

    Attributes:
        speed: rad/s, the fastest that it turns; 0.15 s for 60°, in the middle of what catalogues give for metal-geared
            servos of 1 to 3 N·m (0.11 to 0.19 s).
        lag: s, time constant of the last part of a move.
        dead_band: s of pulse, within which it does not react: 0.5 to 2 us for digital servos, 5 us for analogue ones.
        friction: N·m that the gears hold without a pulse; a guess, a tenth of what such servos hold with one.
        drag: N·m s/rad of the gears turned backwards.
        rise: K/(N·m)², winding temperature over the room's that a steady torque ends at.
        warm_up: s, time constant of that.
        melts: °C, where it fails for good.
    """

    speed: float = math.radians(60.0) / 0.15
    lag: float = 0.03
    dead_band: float = 1e-6
    friction: float = 0.3
    drag: float = 1.0
    rise: float = 100.0
    warm_up: float = 900.0
    melts: float = 150.0


BIG = ServoKind()
"""Carries the arm's root; in 100 minutes of measuring, loaded or not, none failed (Conenna 2024, section 5.2)."""
SMALL = ServoKind(friction=0.1, rise=1300.0)
"""Carries the wrist. `rise` is what makes joint 4 of the lab arm, whose torque is 0.34 N·m RMS over random poses with
66 g at the tip, reach 150 °C within the half hour after which it melted (Conenna 2024, Figure 5.8)."""


def approach(left: float, dt: float, kind: ServoKind, band: float) -> float:
    """Way still to go (rad, signed) after `dt` s under a steady pulse, from `left`.

    `kind.speed` until the rest is speed · lag, then exponential with `kind.lag`, and no motion within `band` (rad).
    """
    way = abs(left)
    if way <= band:
        return left
    knee = kind.speed * kind.lag
    if way > knee:
        full = min(dt, (way - knee) / kind.speed)
        way -= kind.speed * full
        dt -= full
    if dt > 0.0:
        way *= math.exp(-dt / kind.lag)
    return math.copysign(max(way if way > STANDS else 0.0, band), left)


def sinking(torque: float, kind: ServoKind) -> float:
    """Speed (rad/s, signed) of a servo without a pulse under a load (N·m): friction, then drag, at most its speed."""
    speed = (abs(torque) - kind.friction) / kind.drag
    return math.copysign(min(speed, kind.speed), torque) if speed > STICKS else 0.0


def warmed(rise: float, torque: float, dt: float, kind: ServoKind) -> float:
    """Winding temperature over the room's (K) after `dt` s of a steady torque (N·m), from `rise`.

    First order in the heat of the current, which goes with the square of the torque.
    """
    end = kind.rise * torque * torque
    return end + (rise - end) * math.exp(-dt / kind.warm_up)


@dataclass(slots=True)
class Servo:
    """One servo on its channel.

    `angle`: rad, where it believes to stand. `target`: rad, None without a pulse. `torque`: load, N·m. `rise`: winding
    over the room's temperature, K. `way`: sign of its last move. `burnt`: it has melted and stays without force.
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
    way: int = 0
    burnt: bool = False
    angle_of_width: list[float | None] = field(default_factory=list, repr=False)

    @property
    def limp(self) -> bool:
        """Whether it exerts no force."""
        return self.target is None or self.burnt

    def move(self, dt: float) -> float:
        """Turns for `dt` s; returns how far (rad)."""
        if self.limp:
            turn = sinking(self.torque, self.kind) * dt
            wanted = self.angle + turn
        else:
            assert self.target is not None
            left = self.target - self.angle
            if -self.band <= left <= self.band:
                return 0.0
            wanted = self.target - approach(left, dt, self.kind, self.band)
        wanted = min(max(wanted, self.lower), self.upper)
        turn = wanted - self.angle
        if turn:
            self.angle = wanted
            self.way = 1 if turn > 0 else -1
        return turn

    def warm(self, dt: float) -> None:
        """Lets `dt` s of the present load heat or cool it."""
        self.rise = warmed(self.rise, 0.0 if self.limp else self.torque, dt, self.kind)

    def clock(self, count_s: float) -> None:
        """Tabulates the angle of every pulse width (counts) for a chip whose counts last `count_s`."""
        pulses = np.arange(COUNTS_PER_PERIOD) * count_s
        angles = self.table.angle_of(pulses).tolist()
        heard = (pulses >= SHORTEST_PULSE) & (pulses <= LONGEST_PULSE)
        self.angle_of_width = [angle if ok else None for angle, ok in zip(angles, heard.tolist(), strict=True)]
