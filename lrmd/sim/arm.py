"""The simulated arm behind the simulated board: servos that follow pulses, and the TCP of an arm that gives way.

What is wrong with the arm is its *truth*: a model (`lrm/model/1`) whose effects nobody has told the daemon of, on an
arm file with the servos' true level-1 tables. Servos move in their own coordinate, the angle that they believe to
stand at; the model turns that into the TCP, at rest under gravity, only when somebody asks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lrm_math.arm.servo_table import ServoTable
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import trig
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.servo import BIG, SMALL, Servo, ServoKind

BIG_SERVOS = 3
"""The first joints of the arm have the big servos (Conenna 2024, section 1)."""
END_STOP = math.radians(5.0)
"""How far behind its limit a joint meets its end stop."""
STEP = 20_000_000
"""ns, the longest step while something moves."""
HEAT_STEP = 1_000_000_000
"""ns, the longest time for which nobody looks whether a servo melts."""
LOAD_STEP = math.radians(2.0)
"""The load on the servos is worked out anew when they have turned this far, and when they come to rest."""
MOST_SESSIONS = 64


class SimulatedArm:
    """An arm on servos on the channels of one chip. Times are ns of the same clock as the board's.

    Args:
        truth: what the arm is really like; its arm file holds the servos' true tables.
        channels: channel by servo: joint1 … jointN, all of them, and any of the arm's auxiliary servos.
        start: rad, the joints' angles at the beginning; all zero if None.
        room: °C.
        dead_band: s of pulse, instead of that of the servos' kinds.

    Raises:
        LrmError: a joint without servo table or channel, a channel given twice, or a truth that rounds pulses, which
            the chip does already.
        UnknownName: a servo that the arm does not have.
    """

    def __init__(
        self,
        truth: Model,
        channels: Mapping[str, int],
        start: Sequence[float] | None = None,
        room: float = 25.0,
        dead_band: float | None = None,
    ) -> None:
        if any(effect.id == "quantisation" for effect in truth.effects):
            raise LrmError("truth: leave out the effect quantisation; the simulated chip rounds the pulses itself")
        self.truth, self.room = truth, room
        self.payload = 0.0
        self.session = 1
        self.servos = _servos(truth, channels, start, dead_band)
        self.joints = self.servos[: truth.arm.dof]
        self._now = self._warm_until = 0
        self._count_s = 0.0
        self._changes = -1
        self._turned = math.inf
        self._moving = True

    def advance(self, chip: Pca9685Chip, now: int) -> None:
        """Lets the servos follow, until `now`, the pulses that they have; then shows them the chip's outputs."""
        while self._moving and self._now < now:
            step = min(now - self._now, STEP)
            self._now += step
            self._step(step * 1e-9)
        self._now = max(now, self._now)
        if self._now - self._warm_until >= HEAT_STEP:
            self._warm()
        if chip.changes != self._changes:
            self._changes = chip.changes
            self._look_at(chip)

    def power_cycle(self) -> None:
        """A new power-on session begins."""
        self.session += 1

    @property
    def moving(self) -> bool:
        """Whether some servo turned in the last step, or is about to."""
        return self._moving

    @property
    def q(self) -> list[float]:
        """rad, where the servos of the joints believe to stand."""
        return [servo.angle for servo in self.joints]

    def temperature(self, servo: Servo) -> float:
        """°C, of its winding."""
        self._warm()
        return self.room + servo.rise

    def load(self, payload: float) -> None:
        """Puts `payload` kg, and nothing else, into the gripper. Raises `LrmError` unless it is 0 to 10."""
        if not 0.0 <= payload <= 10.0:
            raise LrmError(f"payload {payload * 1e3:g} g; should be 0 to 10000")
        self.payload = payload
        self._turned = math.inf
        self._moving = True

    def rest(self) -> Equilibrium:
        """Where the true arm rests as its servos stand now, as one pose: the last of its poses.

        Effects of a session compare with the first pose of a batch, hence the ones of earlier sessions before it.
        Raises `NotSettled`.
        """
        n = min(self.session, MOST_SESSIONS)
        seconds = np.zeros(n)
        seconds[-1] = self._now * 1e-9
        poses = Poses(
            q=np.tile(self.q, (n, 1)),
            payload=np.full(n, self.payload),
            direction=np.tile([float(servo.way) for servo in self.joints], (n, 1)),
            t=seconds,
            session=np.arange(1.0, n + 1.0),
        )
        return equilibrium(self.truth, poses)

    def _step(self, dt: float) -> None:
        furthest = 0.0
        for servo in self.servos:
            furthest = max(furthest, abs(servo.move(dt)))
        self._turned += furthest
        self._moving = furthest > 0.0
        if self._turned > (LOAD_STEP if self._moving else 0.0):
            self._feel()
            self._moving = True

    def _look_at(self, chip: Pca9685Chip) -> None:
        if chip.count_s != self._count_s:
            self._count_s = chip.count_s
            for servo in self.servos:
                servo.clock(self._count_s)
        for servo in self.servos:
            width = chip.width(servo.channel)
            target = None if width is None else servo.angle_of_width[width]
            if target == servo.target:
                continue
            if (target is None) != (servo.target is None):
                self._warm()
            servo.target = target
            self._moving = True

    def _feel(self) -> None:
        """Gravity's torque on every joint of the nominal arm as it stands (N·m); what gives way hardly changes it."""
        self._warm()
        chain = self.truth.chain
        values = chain.values(self.q)
        loads = statics.loads(
            chain, values, trig(chain, values), statics.weights(chain, self.payload), chain.joint_slots
        )
        for servo, load in zip(self.joints, loads, strict=True):
            servo.torque = float(load)
        self._turned = 0.0

    def _warm(self) -> None:
        elapsed = (self._now - self._warm_until) * 1e-9
        self._warm_until = self._now
        for servo in self.servos if elapsed > 0.0 else ():
            servo.warm(elapsed)
            if self.room + servo.rise > servo.kind.melts and not servo.burnt:
                servo.burnt = self._moving = True


def _servos(
    truth: Model, channels: Mapping[str, int], start: Sequence[float] | None, dead_band: float | None
) -> list[Servo]:
    arm = truth.arm
    start = [0.0] * arm.dof if start is None else start
    if len(start) != arm.dof:
        raise LrmError(f"start: {len(start)} angles; {arm.name} has {arm.dof} joints")
    taken = list(channels.values())
    twice = [channel for channel in taken if taken.count(channel) > 1]
    if twice:
        raise LrmError(
            f"channel {twice[0]} is given to {' and '.join(n for n, c in channels.items() if c == twice[0])}"
        )
    auxiliary = dict(arm.auxiliary_servos)
    for name in channels:
        if name not in arm.joint_names and name not in auxiliary:
            raise UnknownName(f"servo of {arm.name}", name, (*arm.joint_names, *auxiliary))
    out = []
    for i, (name, joint) in enumerate(zip(arm.joint_names, arm.joints, strict=True)):
        if name not in channels or joint.servo is None:
            what = "has no servo table in the arm file" if name in channels else "needs a channel"
            raise LrmError(f"{name} of {arm.name} {what}")
        kind = BIG if i < BIG_SERVOS else SMALL
        limits = joint.lower - END_STOP, joint.upper + END_STOP
        out.append(_servo(name, channels[name], kind, joint.servo, limits, start[i], dead_band))
    for name in channels:
        if name in auxiliary:
            table = auxiliary[name]
            limits = table.angle[0] - END_STOP, table.angle[-1] + END_STOP
            out.append(_servo(name, channels[name], SMALL, table, limits, 0.0, dead_band))
    return out


def _servo(
    name: str,
    channel: int,
    kind: ServoKind,
    table: ServoTable,
    limits: tuple[float, float],
    angle: float,
    dead_band: float | None,
) -> Servo:
    slope = abs((table.angle[-1] - table.angle[0]) / (table.pulse[-1] - table.pulse[0]))
    band = (kind.dead_band if dead_band is None else dead_band) * slope
    lower, upper = limits
    return Servo(name, channel, kind, table, lower, upper, band, min(max(angle, lower), upper))
