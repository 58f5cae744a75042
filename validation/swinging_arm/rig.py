"""Daemon, ramp, board and a swinging arm in one process on a simulated clock."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, ParameterRef
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.model.model import model_of
from lrm_math.motion.modes import POSTURES
from lrm_math.motion.motion_model import MotionModel, effect_of
from lrmd.config import Config
from lrmd.control.motion_predictor import FinalLeg, MotionPredictor
from lrmd.control.state_machine import Mode
from lrmd.messages.control import ArmRequest, LeaseRequest, MoveRequest
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.swing import JointSpring, inertia
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at

SPRINGS = {
    "joint1": JointSpring(6.0, 0.024),
    "joint2": JointSpring(20.0, 0.07),
    "joint4": JointSpring(8.0, 0.022),
}
"""4 to 6 Hz, 5 % of critical damping."""
SERVO_HZ, SERVO_RATIO = 14.0, 1.32
"""Second-order response like the simulated servos' exponential approach with 0.03 s."""
RENEW_TICKS = 15


def known_model(arm: Arm) -> MotionModel:
    """A motion model that knows the springs: their frequencies are right at the mean of the postures that it counts."""
    chain, rng = chain_of(arm), np.random.default_rng(0)
    lower, upper = (np.array([getattr(joint, side) for joint in arm.joints]) for side in ("lower", "upper"))
    M = np.mean([np.diag(inertia(chain, rng.uniform(lower, upper), 0.0)) for _ in range(POSTURES)], axis=0)
    model = MotionModel.nominal(arm)
    servo = {"frequency_Hz": SERVO_HZ, "damping_ratio": SERVO_RATIO, "b_rad": 0.0}
    model = replace(model, values={key: servo[ParameterRef.parse(key).name] for key in model.values})
    for place, spring in SPRINGS.items():
        effect = effect_of(arm, str(EffectRef("swing", place)))
        omega, J = np.sqrt(spring.stiffness / M[effect.joint]), M[effect.joint]
        own = dict(zip(effect.keys, (omega / 2.0 / np.pi, spring.damping / (2.0 * omega * J), 0.0), strict=True))
        kept = {key: v for key, v in model.values.items() if ParameterRef.parse(key).place == place}
        model = model.with_joint((*model.of_joint(effect.joint), effect), {**kept, **own}, {})
    return model


class FramesOf(Pca9685Chip):
    """What servos see of a chip: counts as they were when the present frame began; the first begins at `phase` (s)."""

    def __init__(self, chip: Pca9685Chip, phase: float) -> None:
        super().__init__(chip.oscillator_hz)
        self._chip, self._seen, self._next = chip, bytes(chip._registers), round(phase * 1e9)

    def advance(self, links: SimulatedArm, now: int) -> None:
        """Lets time pass for an arm until now (ns), when the chip's registers may just have been written."""
        while self._next <= now:
            self._registers[:], self.enabled = self._seen, self._chip.enabled
            self.changes += 1
            links.advance(self, self._next)
            self._next += round(COUNTS_PER_PERIOD * self._chip.count_s * 1e9)
        links.advance(self, now)
        self._seen = bytes(self._chip._registers)


@dataclass
class SwingingRover:
    """A daemon with a motion model and an arm that swings.

    `in_frames`: servos see new pulses when a frame begins, at a phase by `seed`; else with the tick that sends them.
    """

    pwm_hz: float
    shaping: str = "off"
    within_mm: float = 0.5
    seed: int = 0
    in_frames: bool = False
    config: Config = field(init=False)

    def __post_init__(self) -> None:
        config = config_at(self.pwm_hz, Path(mkdtemp()), self.shaping)
        motion = config.motion.model_copy(update={"within_mm": self.within_mm})
        self.config = replace(config, motion=motion)
        self.arm, self.rng = self.config.arm, np.random.default_rng(self.seed)
        self.daemon = SimulatedDaemon(self.config)
        self.known = MotionPredictor(self.config, known_model(self.arm))
        self.daemon.core.motion = self.known
        channels = {s.name: s.channel for s in self.config.servos if s.name in self.arm.joint_names}
        self.links = SimulatedArm(model_of(self.arm, ()), channels, springs=SPRINGS)
        chip = self.daemon.board.chip
        self.shown = FramesOf(chip, self.daemon.now * 1e-9 + self.rng.uniform(0.0, 1.0 / self.pwm_hz))
        self.daemon.run(30)
        lease = self.daemon.core.handle(LeaseRequest(action="acquire", holder="x", take=True), self.daemon.now).lease
        assert lease is not None
        self.token = lease.token
        zero = dict.fromkeys(self.arm.joint_names, 0.0)
        self.daemon.core.handle(ArmRequest(lease=self.token, where="given", q_rad=zero), self.daemon.now)
        self.pass_ticks(2000)

    @property
    def tick_s(self) -> float:
        """s."""
        return self.config.tick * 1e-9

    def pass_ticks(self, count: int) -> None:
        """Time passes, the lease is kept."""
        daemon = self.daemon
        for _ in range(count):
            if daemon.ticks % RENEW_TICKS == 0:
                daemon.core.handle(LeaseRequest(action="renew", lease=self.token), daemon.now)
            daemon.tick()
            if self.in_frames:
                self.shown.advance(self.links, daemon.now)
            else:
                self.links.advance(daemon.board.chip, daemon.now)

    def tips(self, ticks: int) -> Array:
        """(ticks, 3), m: where the tip is after each of the next ticks."""
        angles = []
        for _ in range(ticks):
            self.pass_ticks(1)
            angles.append(self.links.link_angles)
        return tip_of(self.arm, np.array(angles))

    def move(self, q: Array) -> tuple[float, FinalLeg]:
        """Moves there; how long that should take (s), and the last leg of the way."""
        goal = dict(zip(self.arm.joint_names, q.tolist(), strict=True))
        core = self.daemon.core
        self.daemon.settle()
        shaping = self.config.motion.shaping
        told = core.handle(MoveRequest(lease=self.token, waypoints=[goal], shaping=shaping), self.daemon.now)
        assert told.final_leg is not None
        assert told.seconds is not None
        while core.mode is not Mode.MOVING or not self.daemon.ramp.moving:
            self.pass_ticks(1)
        while self.daemon.ramp.moving:
            self.pass_ticks(1)
        return told.seconds, told.final_leg


def tip_of(arm: Arm, q: Array) -> Array:
    """(N, 3), m, of rigid links at angles (N, n), rad."""
    chain = chain_of(arm)
    return np.asarray(chain_geometry(chain, chain.values(list(q.T)), len(q)).tcp.T)
