"""Simulated arm: servos that follow the board's pulses, and the TCP of the compliant arm.

Its true errors are a model (`lrm/model/1`, the *truth*) unknown to the daemon, on an arm file with the servos' true
servo tables. Servos move in their own coordinate, the angle by their own sensor; the model gives the TCP in static
equilibrium under gravity, computed on request only. With `springs` the links swing behind the servos (`swing.py`), with
`creeps` they yield slowly (`creep.py`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lrm_math.arrays import ORIGIN, Vector3
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.statics import joint_torques
from lrm_math.model.deployed_model import clock_of, with_load_at
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model
from lrmd.sim.creep import CreepingJoints, JointCreep
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.servo import LARGE_SERVO, SMALL_SERVO, SimulatedServo
from lrmd.sim.swing import JointSpring, SwingingLinks

LARGE_SERVOS = 3
"""The first joints of the arm have the big servos (Conenna 2024, section 1)."""
END_STOP = math.radians(5.0)
"""rad from a joint's limit to its end stop."""
STEP = 20_000_000
"""ns, the longest integration step in motion."""
SWING_STEP = 2_000_000
"""ns: the same of servos behind which links swing, whose speed it takes as constant."""
HEAT_STEP = 1_000_000_000
"""ns, the longest step of the thermal model."""
CREEP_STEP = 0.02
"""s, the shortest step of creep."""
LOAD_STEP = math.radians(2.0)
"""rad of travel after which the gravity torques are updated; they are also updated at rest."""
MOST_SESSIONS = 64
AMBIENT = 25.0
"""°C."""


class SimulatedArm:
    """An arm on servos on the channels of one chip. Times are ns of the same clock as the board's.

    Args:
        truth: the arm's true model; its arm file holds the true servo tables.
        channels: channel by servo name: all of joint1 … jointN, and any auxiliary servos.
        start: initial joint angles, rad; zero if None.
        dead_band: s of pulse, overrides that of the servo kinds.
        speed: ratio of the board's clock to the one by which the servos warm up. The daemon's model of their
            temperatures runs on the computer's clock, so a board whose clock is faster must not heat them faster.
        springs: by joint, those on which its links swing; none: they stand as their servos do.
        creeps: of joints that yield slowly under a load that is held.

    Raises:
        LrmError: a joint without servo table or channel, a channel given twice, or a truth with the effect
            `quantisation`, which the chip simulates.
        UnknownName: a servo that the arm does not have.
    """

    def __init__(
        self,
        truth: Model,
        channels: Mapping[str, int],
        start: Sequence[float] | None = None,
        dead_band: float | None = None,
        speed: float = 1.0,
        springs: Mapping[str, JointSpring] | None = None,
        creeps: Mapping[str, JointCreep] | None = None,
    ) -> None:
        if clock_of(truth) is not None:
            raise LrmError("truth: leave out the effect quantisation; the simulated chip rounds the pulses itself")
        self.truth, self._speed = truth, speed
        self.payload, self.load_at = 0.0, ORIGIN
        self.session = 1
        self.servos = _servos(truth, channels, start, dead_band)
        self.joints = self.servos[: truth.arm.dof]
        self._swing = SwingingLinks(truth, springs) if springs else None
        self._creep = CreepingJoints(truth.arm.joint_names, creeps) if creeps else None
        self._now = self._warm_until = self._crept_until = 0
        self._count_s = 0.0
        self._changes = -1
        self._travel = math.inf
        self._moving = True

    def advance(self, chip: Pca9685Chip, now: int) -> None:
        """Integrates the servos until `now` under their present pulses, then applies the chip's outputs to them."""
        longest = STEP if self._swing is None else SWING_STEP
        while self._moving and self._now < now:
            step = min(now - self._now, longest)
            self._now += step
            self._step(step * 1e-9)
        self._now = max(now, self._now)
        self._creep_on()
        if self._now - self._warm_until >= HEAT_STEP:
            self._update_temperatures()
        if chip.changes != self._changes:
            self._changes = chip.changes
            self._read_outputs(chip)

    def power_cycle(self) -> None:
        """Starts a new power-on session."""
        self.session += 1

    @property
    def moving(self) -> bool:
        """Whether a servo turned in the last step or has a new target, or a link swings."""
        return self._moving

    @property
    def q(self) -> list[float]:
        """Joint angles (rad) in the servos' own coordinate."""
        return [servo.angle for servo in self.joints]

    @property
    def link_angles(self) -> list[float]:
        """Joint angles (rad) of the links, which may swing and creep behind the servos."""
        q = self.q
        if self._swing is not None:
            q = [angle + z for angle, z in zip(q, self._swing.deflection.tolist(), strict=True)]
        return q if self._creep is None else [a + z for a, z in zip(q, self._creep.deflection, strict=True)]

    def temperature(self, servo: SimulatedServo) -> float:
        """Winding temperature, °C."""
        self._update_temperatures()
        return AMBIENT + servo.rise

    def set_payload(self, payload: float, centre: Vector3 = ORIGIN) -> None:
        """Sets the payload in the gripper, kg, and its centre (m), see `Arm.with_load_at`. Raises `LrmError` unless the
        payload is 0 to 10."""
        if not 0.0 <= payload <= 10.0:
            raise LrmError(f"payload {payload * 1e3:g} g; should be 0 to 10000")
        if centre != self.load_at:
            self.truth = with_load_at(self.truth, centre)
        self.payload, self.load_at = payload, centre
        self._travel = math.inf
        self._moving = True

    def equilibrium(self) -> Equilibrium:
        """Static equilibrium of the true arm at the present angles of servos and springs: the last pose of the result.

        Session effects are relative to the first pose of a batch, so a pose of each earlier session precedes it.
        Raises `NoEquilibrium`.
        """
        n = min(self.session, MOST_SESSIONS)
        seconds = np.zeros(n)
        seconds[-1] = self._now * 1e-9
        poses = Poses(
            q=np.tile(self.link_angles, (n, 1)),
            payload=np.full(n, self.payload),
            direction=np.tile([float(servo.direction) for servo in self.joints], (n, 1)),
            t=seconds,
            session=np.arange(1.0, n + 1.0),
        )
        return solve_equilibrium(self.truth, poses)

    def _creep_on(self) -> None:
        """Takes creep up to now, under the torques at the present angles of the links."""
        elapsed = (self._now - self._crept_until) * 1e-9 / self._speed
        if self._creep is not None and elapsed >= CREEP_STEP:
            self._crept_until = self._now
            self._creep.yield_to(self._torques(self.link_angles), elapsed)

    def _step(self, dt: float) -> None:
        before = self.q
        furthest = max(abs(servo.move(dt)) for servo in self.servos)
        self._travel += furthest
        self._moving = furthest > 0.0
        if self._swing is not None:
            self._swing.follow(np.array(before), np.array(self.q), dt)
            self._moving = self._moving or not self._swing.still
        if self._travel > (LOAD_STEP if self._moving else 0.0):
            self._update_loads()
            self._moving = True

    def _read_outputs(self, chip: Pca9685Chip) -> None:
        if chip.count_s != self._count_s:
            self._count_s = chip.count_s
            for servo in self.servos:
                servo.set_count_duration(self._count_s)
        for servo in self.servos:
            width = chip.width(servo.channel)
            target = None if width is None else servo.angle_of_width[width]
            if target == servo.target:
                continue
            if (target is None) != (servo.target is None):
                self._update_temperatures()
            servo.target = target
            self._moving = True

    def _update_loads(self) -> None:
        """Gravity torque (N·m) on every joint of the nominal arm; its compliance hardly changes it."""
        self._update_temperatures()
        for servo, torque in zip(self.joints, self._torques(self.q), strict=True):
            servo.torque = torque
        if self._swing is not None:
            self._swing.weigh(self.truth.chain, np.array(self.q), self.payload)
        self._travel = 0.0

    def _torques(self, q: list[float]) -> list[float]:
        return joint_torques(self.truth.chain, self.truth.constant_gravity, q, self.payload)

    def _update_temperatures(self) -> None:
        elapsed = (self._now - self._warm_until) * 1e-9 / self._speed
        self._warm_until = self._now
        for servo in self.servos if elapsed > 0.0 else ():
            servo.update_temperature(elapsed)
            if AMBIENT + servo.rise > servo.kind.failure_c and not servo.burnt:
                servo.burnt = self._moving = True


def _servos(
    truth: Model, channels: Mapping[str, int], start: Sequence[float] | None, dead_band: float | None
) -> list[SimulatedServo]:
    arm = truth.arm
    start = [0.0] * arm.dof if start is None else start
    if len(start) != arm.dof:
        raise LrmError(f"start: {len(start)} angles; {arm.name} has {arm.dof} joints")
    for channel in channels.values():
        names = [name for name, other in channels.items() if other == channel]
        if len(names) > 1:
            raise LrmError(f"channel {channel} is given to {' and '.join(names)}")
    auxiliary = dict(arm.auxiliary_servos)
    for name in channels:
        if name not in arm.joint_names and name not in auxiliary:
            raise UnknownName(f"servo of {arm.name}", name, (*arm.joint_names, *auxiliary))
    rows = []
    for i, (name, joint) in enumerate(zip(arm.joint_names, arm.joints, strict=True)):
        if name not in channels or joint.servo is None:
            what = "has no servo table in the arm file" if name in channels else "needs a channel"
            raise LrmError(f"{name} of {arm.name} {what}")
        kind = LARGE_SERVO if i < LARGE_SERVOS else SMALL_SERVO
        rows.append((name, kind, joint.servo, joint.lower, joint.upper, start[i]))
    tables = [(name, auxiliary[name]) for name in channels if name in auxiliary]
    rows += [(name, SMALL_SERVO, table, table.angle[0], table.angle[-1], 0.0) for name, table in tables]
    servos = []
    for name, kind, table, lowest, highest, angle in rows:
        slope = abs((table.angle[-1] - table.angle[0]) / (table.pulse[-1] - table.pulse[0]))
        band = (kind.dead_band if dead_band is None else dead_band) * slope
        lower, upper = lowest - END_STOP, highest + END_STOP
        angle = min(max(angle, lower), upper)
        servos.append(SimulatedServo(name, channels[name], kind, table, lower, upper, band, angle))
    return servos
