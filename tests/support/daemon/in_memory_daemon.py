"""A daemon's controller, its ramp and a simulated board in one process, on a simulated clock."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from lrmd.api.children import board_settings
from lrmd.config import Config, load_config
from lrmd.control.requests import Controller
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.core import RampCore
from lrmd.ramp.shared_memory import LinkState, RampOrder, RampReport
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.pca9685_chip import Pca9685Chip

CONFIG = Path(__file__).resolve().parents[3] / "config" / "lrmd.toml"
WALL = 1_700_000_000_000_000_000
"""ns: the wall clock at its start."""
CYCLE = 3
"""Ticks between two cycles of the API, about 20 ms."""


def config_at(pwm_hz: float, folder: Path, shaping: str = "off") -> Config:
    """The shipped configuration with another PWM frequency and shaping: at 330 Hz a count is shorter than a step."""
    text = CONFIG.read_text(encoding="utf-8").replace("pwm_hz = 50.0", f"pwm_hz = {pwm_hz}")
    text += f'\n[motion]\nshaping = "{shaping}"\n'
    path = folder / "lrmd.toml"
    path.write_text(text, encoding="utf-8")
    return load_config(path)


@dataclass
class SimulatedDaemon:
    """Time passes in `run`, and every tick is checked.

    Faults: `lost_in`, `lost_out`: the next frames lost on the way to and from the board; `stall`: ticks for which the
    line holds frames back; `unplugged`: ticks without a device; `api_stopped`: the API neither reads nor writes.
    """

    config: Config
    seed: int = 0
    now: int = 1_000_000_000
    lost_in: int = 0
    lost_out: int = 0
    stall: int = 0
    unplugged: int = 0
    api_stopped: bool = False
    torque: tuple[float, ...] = (0.0,) * 6
    stored: StoredState | None = None
    starts: int = 1
    ticks: int = 0
    held_in: bytes = b""
    held_out: bytes = b""
    estop_requested: bool = False
    order: RampOrder | None = None
    outputs: dict[int, float | None] = field(default_factory=dict)
    largest_step: float = 0.0

    def __post_init__(self) -> None:
        self.random = Random(self.seed)
        self.board = SimulatedBoard(Pca9685Chip(self.config.clock.oscillator_hz), self.random, self.now)
        self.ramp = RampCore(board_settings(self.config))
        self.core = Controller(self.config, lambda *_: self.torque, self.stored, lambda *_: None, self.now, WALL)
        self.report = self._report()
        self.allowed: dict[int, int] = {}
        self.outputs = self._pulses()

    def _report(self) -> RampReport:
        return self.ramp.report(self.ticks, self.now, 0, 0, self.starts, False)

    def _pulses(self) -> dict[int, float | None]:
        return {i: self.board.chip.pulse(s.channel) for i, s in enumerate(self.config.servos)}

    def run(self, ticks: int) -> None:
        """Lets so many ticks pass."""
        for _ in range(ticks):
            self.tick()

    def tick(self) -> None:
        """One tick of the ramp, and every `CYCLE` ticks a cycle of the API."""
        self.now += self.config.tick
        self.ticks += 1
        self.board.tick(self.now)
        if not self.api_stopped and self.ticks % CYCLE == 0:
            self.cycle()
        received = self._arrived()
        before = self.ramp.outputs
        out = self.ramp.tick(self.now, self.now, self.order, received, self.estop_requested)
        self.estop_requested = False
        if self.order is not None and self.ramp.order_accepted and self.ramp.order == self.order.number:
            fresh = self.ramp.outputs & ~before
            self.allowed |= {i: self.order.pose[i] for i in range(len(self.config.servos)) if fresh >> i & 1}
        if self.ramp.link is LinkState.CLOSED and not self.unplugged:
            self.ramp.opened(self.now)
        self._send(out)
        self.report = self._report()
        self._check()

    def settle(self) -> None:
        """Lets time pass until the ramp has read the newest order, as the API does before it begins a motion."""
        for _ in range(15):
            self.core.observe(self.report, self.now)
            if self.core.settled:
                return
            self.tick()

    def cycle(self) -> None:
        """One cycle of the API, every 20 ms."""
        self.core.observe(self.report, self.now)
        self.core.tick(self.now)
        self.order = self.core.order_at(self.now)

    def _arrived(self) -> bytes | None:
        if self.unplugged:
            self.unplugged -= 1
            self.held_in = self.held_out = b""
            return None
        if self.ramp.link is LinkState.CLOSED:
            return None
        data, self.held_out = self.held_out, b""
        if data and self.lost_out:
            self.lost_out -= 1
            return b""
        return data

    def _send(self, out: bytes) -> None:
        if self.stall:
            self.stall -= 1
            self.held_in += out
            return
        if out and self.lost_in:
            self.lost_in -= 1
            return
        data, self.held_in = self.held_in + out, b""
        if data:
            self.held_out += self.board.feed(data, self.now)

    def estop(self, later: int = 0) -> None:
        """By the router's process; the API process is told some ticks later."""
        self.estop_requested = True
        self.run(later)
        self.core.estop(self.now, "x")

    def brown_out(self) -> None:
        """The board loses its power for a moment: the pulses are off."""
        self.board.power_cycle(self.now)
        self.outputs = self._pulses()

    @property
    def limp(self) -> bool:
        """Whether no servo has pulses, as of the last tick."""
        return not any(self.outputs.values())

    def restart_ramp(self) -> None:
        """kill -9 of the ramp process: a new one finds the last report."""
        self.starts += 1
        self.ramp = RampCore(board_settings(self.config), self.report)
        self.held_out = b""

    def stop_ramp(self, ns: int) -> None:
        """SIGSTOP for a while: the board goes on alone."""
        for _ in range(ns // self.config.tick):
            self.now += self.config.tick
            self.board.tick(self.now)
        self._check()

    def _check(self) -> None:
        """Invariants: no pulse outside its limits, at most one step per tick, no pulse switched on but as ordered."""
        after, count = self._pulses(), self.config.clock.count_s
        for i, servo in enumerate(self.config.servos):
            was, now = self.outputs[i], after[i]
            if now is None:
                continue
            assert servo.lowest * 1e-9 - count <= now <= servo.highest * 1e-9 + count, servo.name
            if was is None:
                assert i in self.allowed, f"{servo.name} was switched on without a request"
                assert abs(now - self.allowed.pop(i) * 1e-9) <= self.config.step * 1e-9 + count
            else:
                self.largest_step = max(self.largest_step, abs(now - was))
                assert abs(now - was) <= self.config.step * 1e-9 + count, f"{servo.name} jumped by {now - was} s"
        self.outputs = after
