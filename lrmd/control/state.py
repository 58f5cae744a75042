"""What the daemon's core knows and is at, and the small acts that every change of it is made of."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from typing import Any

from lrmd.config import Config
from lrmd.control.events import Fault, Happening, Level
from lrmd.control.lease import Lease
from lrmd.control.motion_check import Torques, WayCheck
from lrmd.control.pulses import Pulses, angles, overlaid
from lrmd.control.ramp_orders import Orders
from lrmd.control.state_machine import Mode, Trigger, follow
from lrmd.persistence.state_file import Saved
from lrmd.ramp.shared_memory import Order, Report
from lrmd.safety.collision_guard import Guard
from lrmd.thermal.monitor import HeatWatch


class Situation:
    """The daemon between two moments.

    Attributes: `mode`, `why`, `since` (monotonic ns), `faults` by code, `lease`, `orders` for the ramp, `report` of the
    ramp, `heat` of the servos, the `way` check, `payload` (kg), `happenings` not told yet, and what was `stored`.
    """

    def __init__(
        self, config: Config, torques: Torques, stored: Saved | None, guard: Guard, now: int, wall: int
    ) -> None:
        self.config = config
        self.mode, self.why, self.since = Mode.DISARMED, "started", now
        self.faults: dict[str, Fault] = {}
        self.happenings: list[Happening] = []
        self.lease: Lease | None = None
        self.report = Report()
        self.payload = 0.0
        self.stored = stored
        self._left_still = stored is None or stored.still
        self.boots = (stored.boots if stored else 0) + 1
        self.heat = HeatWatch(config, stored, now, wall)
        self.way = WayCheck(config, torques, guard, self.heat)
        self.orders = Orders(config, now)
        self.looked_ahead = now

    # ---- what it knows

    def angles(self, pulses: Sequence[int]) -> list[float]:
        """Angle (rad) of every servo for these pulses (ns); 0 where none was ever sent."""
        return angles(self.config, pulses)

    @property
    def order(self) -> Order:
        """The newest for the ramp."""
        return self.orders.newest

    @property
    def position(self) -> Pulses:
        """Pulses (ns) that the servos were last told."""
        return self.report.position[: len(self.config.servos)]

    @property
    def targets(self) -> Pulses:
        """Pulses (ns) that the servos are on their way to."""
        return overlaid(self.position, self.orders.goal)

    @property
    def limp(self) -> bool:
        """Whether no servo has pulses."""
        return not self.report.outputs

    @property
    def port_trouble(self) -> str:
        """Why the port cannot be opened, empty if it could."""
        number = self.report.port_error
        why = "another program has it open" if number == errno.EAGAIN else os.strerror(number).lower()
        return f"{self.config.link.port}: {why}" if number else ""

    def saved(self, wall: int) -> Saved:
        """What must survive a crash. Servos that had no pulses yet keep what was stored before, and its doubts."""
        before = dict(self.stored.pulse_ns) if self.stored else {}
        known = {n: p for n, p in zip(self.config.names, self.position, strict=True) if p}
        still = not self.report.moving and (self._left_still or before.keys() <= known.keys())
        return Saved(
            saved_wall_ns=wall, boots=self.boots, mode=self.mode, still=still, pulse_ns=before | known,
            temperature_c=dict(zip(self.config.names, self.heat.temperature, strict=True)),
        )  # fmt: skip

    # ---- small acts

    def go(self, trigger: Trigger, why: str, now: int) -> None:
        """Goes to the mode that the trigger leads to. Raises `NotAllowed`; then nothing has changed."""
        mode = follow(self.mode, trigger)
        if mode is not self.mode:
            self.happened("mode", "info", f"{self.mode} -> {mode}: {why}", mode=mode.value, before=self.mode.value)
        if mode is not self.mode or why != self.why:
            self.mode, self.why, self.since = mode, why, now

    def hold(self, now: int, why: str) -> None:
        """Stops with the pulses on. Raises `NotAllowed`."""
        self.go(Trigger.HOLD, why, now)
        self.orders.stop(now)

    def stop_motion(self, now: int, why: str) -> None:
        """Holds if something is under way; an arm that stands is left alone."""
        if self.mode in (Mode.MOVING, Mode.ARMING):
            self.hold(now, why)

    def estop(self, now: int, why: str) -> None:
        """Stops all pulses. The ramp has been told already; this is the daemon's own memory of it."""
        self.go(Trigger.ESTOP, why or "estop", now)
        self.add_fault("estop", f"emergency stop: {why or 'no reason given'}", now)
        self.orders.stop(now, 0)

    def add_fault(self, code: str, text: str, now: int) -> None:
        """Remembers a fault until it is reset."""
        if code not in self.faults:
            self.faults[code] = Fault(code, text, now)

    def happened(self, code: str, level: Level, text: str, **detail: Any) -> None:
        """Something worth telling."""
        self.happenings.append(Happening(code, level, text, detail))
