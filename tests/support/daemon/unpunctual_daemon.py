"""A simulated daemon whose API process may be stopped between a decision and its order, with laws of its own.

It looks at the chip, and at the requests that were carried out: whatever controller and ramp believe of each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lrmd.api.children import board_settings
from lrmd.control.requests import Controller
from lrmd.control.state import RequestResult
from lrmd.messages.codec import Message
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    JogRequest,
    MotionRequest,
    MoveRequest,
    PayloadRequest,
    RelaxRequest,
)
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.core import API_TIMEOUT, RampCore
from lrmd.ramp.shared_memory import HOLD_PULSE
from tests.support.daemon.in_memory_daemon import CYCLE, WALL, SimulatedDaemon


@dataclass
class UnpunctualDaemon(SimulatedDaemon):
    """Laws, in every tick:

    - a servo gets its first pulse where a request to arm named it, after the last fault and after the last request that
      ended its pulses; where the pose was the stored one, it is the last pulse that the chip had;
    - a pulse changes only by an order of a motion that was asked for, made after the last fault of the ramp;
    - no pulse changes when no lease was valid for as long as the ramp goes on without its parent.

    `named`: pulses (s) by servo; `motions`: numbers of the orders; `last`: pulses (s) that the chip had last. `kept`:
    the state file, as of the last cycle; its pose is taken back before a request that may leave it.
    """

    named: dict[int, float] = field(default_factory=dict)
    motions: set[int] = field(default_factory=set)
    last: dict[int, float] = field(default_factory=dict)
    barred: int = -1
    faults: int = 0
    leased_at: int = 0
    kept: StoredState | None = None

    def ask(self, request: Message, undecided: int = 0, unwritten: int = 0) -> RequestResult:
        """Carries out a request by the newest report, as the API process does it; it is stopped for some ticks after
        the decision, and for some before its order is written. Raises `LrmError`."""
        if self.kept is not None and isinstance(request, MotionRequest | PayloadRequest):
            self.kept = self.kept.model_copy(update={"still": False})
        self.core.observe(self.report, self.now)
        result = self.core.handle(request, self.now)
        self._note(request)
        self.suspend(undecided)
        order = self.core.order_at(self.now)
        self.suspend(unwritten)
        self.order = order
        return result

    def suspend(self, ticks: int) -> None:
        """SIGSTOP of the API process, and SIGCONT."""
        before, self.api_stopped = self.api_stopped, True
        self.run(ticks)
        self.api_stopped = before

    def restart(self, ns: int) -> None:
        """kill -9 of the daemon; the next one begins after a while, with the state file and the same board."""
        self.stop_ramp(ns)
        self.core = Controller(self.config, lambda *_: self.torque, self.kept, lambda *_: None, self.now, WALL)
        self.ramp, self.order, self.held_out = RampCore(board_settings(self.config)), None, b""
        self.report = self._report()
        self.motions.clear()
        self.named.clear()
        self.faults, self.barred = self.ramp.fault_count, -1

    def _note(self, request: Message) -> None:
        servos = self.config.servos
        match request:
            case MoveRequest() | JogRequest():
                self.motions.add(self.core.order.number)
            case ArmRequest(where="given"):
                angles = {self.config.index(name): q for name, q in request.q_rad.items()}
                self.named |= {i: servos[i].pulse_ns(q) * 1e-9 for i, q in angles.items()}
            case ArmRequest(where="stored"):
                self.named |= self.last
            case RelaxRequest() | DisarmRequest():
                names = getattr(request, "servos", None)
                for name in self.config.names if names is None else names:
                    self.named.pop(self.config.index(name), None)

    def estop(self, later: int = 0) -> None:
        self.estop_requested = True
        self.named.clear()
        self.suspend(later)
        self.core.estop(self.now, "x")

    def cycle(self) -> None:
        before = self.core.order
        super().cycle()
        self.kept = self.core.stored = self.core.saved(WALL)
        goes_on = before.number in self.motions and any(p != HOLD_PULSE for p in self.core.order.target)
        if goes_on and self.core.order.outputs:
            self.motions.add(self.core.order.number)

    def _check(self) -> None:
        before, faults = self.outputs, self.ramp.fault_count
        super()._check()
        if faults != self.faults:
            self.faults, self.barred = faults, self.ramp.order
            self.named.clear()
        if self.core.leasehold.held and self.now < self.core.leasehold.until:
            self.leased_at = self.now
        for i, now in self.outputs.items():
            if now is not None and now != before[i]:
                self._changed(i, before[i], now)
                self.last[i] = now

    def _changed(self, servo: int, was: float | None, now: float) -> None:
        """Checks a new pulse (s) of a servo, `was` before."""
        name, patience = self.config.names[servo], API_TIMEOUT + (CYCLE + 2) * self.config.tick
        assert self.now - self.leased_at <= patience, f"{name} gets a pulse of nobody who has a lease"
        if was is None:
            assert servo in self.named, f"{name} is switched on, and no request named a pose"
            off = abs(now - self.named.pop(servo))
            assert off <= 2 * self.config.clock.count_s, f"{name} is switched on {off * 1e6:.0f} us beside its pose"
        else:
            assert self.ramp.order in self.motions, f"{name} moves by an order of no motion"
            assert self.ramp.order != self.barred, f"{name} moves on after a fault"
