"""The daemon's mind, without zenoh, clock or processes: requests and reports in; replies, orders and events out.

Everything that moves a servo begins with a request, with two exceptions that DESIGN asks for and an event announces:
a servo that gets too hot sends the arm to its rest pose, and then stops the pulses.
"""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from lrm_math.errors import LrmError
from lrmd import lease as leases
from lrmd.config import Config
from lrmd.guard import Guard, TooClose
from lrmd.heat_watch import HeatWatch
from lrmd.mailbox import HERE, LinkState, Order, Report, Trip
from lrmd.messages import (
    ArmRequest,
    DisarmRequest,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    Message,
    MoveRequest,
    RelaxRequest,
    ResetRequest,
)
from lrmd.pulses import Pulses, armed, corners, duration, overlaid, pulses_of, turning
from lrmd.ramp import Pace, move
from lrmd.refusal import Refused
from lrmd.standing import standing
from lrmd.states import LIVE, STANDING, Mode, NotAllowed, Trigger, follow
from lrmd.store import Saved
from lrmd.thermal import Heat

SECOND = 1_000_000_000
LOOK_AHEAD = SECOND // 4
"""ns: how far ahead of a jog nothing may be in the way."""
Torques = Callable[[Sequence[float], float], Sequence[float]]
"""Gravity's torque (N m) on every joint for a pose (rad) and a payload (kg)."""


@dataclass(frozen=True)
class Happening:
    """Something worth telling: an event on zenoh and a line in the log."""

    code: str
    level: Literal["info", "warning", "error"]
    text: str
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """A fault that was not reset yet; `since`, monotonic ns."""

    code: str
    text: str
    since: int


@dataclass(frozen=True)
class Done:
    """What a request led to: seconds until it is done, where that is known; the lease it gave."""

    seconds: float | None = None
    lease: leases.Lease | None = None


_TRIPS: dict[Trip, tuple[Trigger, str, str]] = {
    Trip.STARTED: (Trigger.STOPPED, "ramp_restarted", "the ramp process was started anew; the arm stands still"),
    Trip.LINK_LOST: (Trigger.FAILED, "link_lost", "the board does not answer"),
    Trip.BOARD_RESTARTED: (Trigger.OUTPUTS_LOST, "board_restarted", "the board lost its power; the arm is limp"),
    Trip.BOARD_SILENCED: (Trigger.OUTPUTS_LOST, "board_silenced", "the board stopped its pulses; the arm is limp"),
    Trip.API_SILENT: (Trigger.STOPPED, "api_silent", "the ramp had no sign of life of the daemon and stopped"),
    Trip.REFUSED: (Trigger.FAILED, "order_refused", "the ramp refused an order outside the limits: a software fault"),
}  # fmt: skip


class Core:
    """The daemon between two moments. Not thread-safe: its owner keeps a lock.

    Attributes: `mode`, `why`, `since` (monotonic ns), `faults` by code, `lease`, `order` for the ramp, `report` of the
    ramp, `heat` of the servos, `payload` (kg), `happenings` not told yet.
    """

    def __init__(
        self, config: Config, torques: Torques, stored: Saved | None, guard: Guard, now: int, wall: int
    ) -> None:
        self.config = config
        self.mode, self.why, self.since = Mode.DISARMED, "started", now
        self.faults: dict[str, Fault] = {}
        self.lease: leases.Lease | None = None
        self.order = Order(stride=(config.step,) * len(config.servos), target=(HERE,) * 16)
        self.report = Report()
        self.payload = 0.0
        self.happenings: list[Happening] = []
        self.stored = stored
        self._left_still = stored is None or stored.still
        self.boots = (stored.boots if stored else 0) + 1
        self._torques = torques
        self.guard = guard
        self._waypoints: deque[tuple[int, ...]] = deque()
        self._goal = [HERE] * len(config.servos)
        self._arming: deque[int] = deque()
        self._next_on = now
        self._jog_until: int | None = None
        self._looked_at = now
        self._link_was = LinkState.CLOSED
        self._port_error = 0
        self.heat = HeatWatch(config, stored, now, wall)

    # ---- what it knows

    def angles(self, pulses: Sequence[int]) -> list[float]:
        """Angle (rad) of every servo for these pulses (ns); 0 where none was ever sent."""
        return [s.angle(p) if p else 0.0 for s, p in zip(self.config.servos, pulses, strict=False)]

    @property
    def position(self) -> tuple[int, ...]:
        """Pulses (ns) that the servos were last told."""
        return self.report.position[: len(self.config.servos)]

    @property
    def targets(self) -> tuple[int, ...]:
        """Pulses (ns) that the servos are on their way to."""
        return overlaid(self.position, self._goal)

    @property
    def limp(self) -> bool:
        """Whether no servo has pulses."""
        return not self.report.outputs

    def saved(self, wall: int) -> Saved:
        """What must survive a crash. Servos that had no pulses yet keep what was stored before, and its doubts."""
        before = dict(self.stored.pulse_ns) if self.stored else {}
        known = {n: p for n, p in zip(self.config.names, self.position, strict=True) if p}
        still = not self.report.moving and (self._left_still or before.keys() <= known.keys())
        return Saved(
            saved_wall_ns=wall, boots=self.boots, mode=self.mode, still=still, pulse_ns=before | known,
            temperature_c=dict(zip(self.config.names, self.heat.temperature, strict=True)),
        )  # fmt: skip

    # ---- what clients ask

    def handle(self, request: Message, now: int) -> Done:
        """Carries out a request. Raises an `LrmError` if it cannot; then nothing has changed."""
        match request:
            case LeaseRequest():
                return self._lease(request, now)
            case HoldRequest():
                self._hold(now, "hold")
                return Done()
            case ArmRequest():
                leases.checked(self.lease, request.lease, now)
                return self._arm(request, now)
            case MoveRequest():
                leases.checked(self.lease, request.lease, now)
                return self._move(request, now)
            case JogRequest():
                leases.checked(self.lease, request.lease, now)
                return self._jog(request, now)
            case RelaxRequest():
                leases.checked(self.lease, request.lease, now)
                return self._relax(request, now)
            case DisarmRequest():
                leases.checked(self.lease, request.lease, now)
                self._go(Trigger.DISARM, "disarmed", now)
                self._issue(now, outputs=0)
                return Done()
            case ResetRequest():
                leases.checked(self.lease, request.lease, now)
                return self._reset(now)
            case _:
                raise Refused("unknown_request", f"no such request: {type(request).__name__}")

    def estop(self, now: int, why: str) -> None:
        """Stops all pulses. The ramp has been told already; this is the daemon's own memory of it."""
        self._go(Trigger.ESTOP, why or "estop", now)
        self._fault("estop", f"emergency stop: {why or 'no reason given'}", now)
        self._drop_plans()
        self._issue(now, outputs=0)

    def _lease(self, request: LeaseRequest, now: int) -> Done:
        config = self.config
        if request.action == "acquire":
            if not request.holder:
                raise Refused("no_holder", "holder is missing: say who asks, for others to read")
            before = self.lease
            self.lease = leases.acquire(before, request.holder, now, config.lease, request.take)
            if before is not None and now < before.until:
                self._tell("lease_taken", "warning", f"{request.holder} took the lease from {before.holder}")
                self._stop_motion(now, f"{request.holder} took the lease")
            return Done(lease=self.lease)
        if request.action == "renew":
            self.lease = leases.renew(self.lease, request.lease, now, config.lease)
            return Done(lease=self.lease)
        leases.checked(self.lease, request.lease, now)
        self.lease = None
        self._stop_motion(now, "lease released")
        return Done()

    def _arm(self, request: ArmRequest, now: int) -> Done:
        follow(self.mode, Trigger.ARM)
        if self.report.link is not LinkState.READY:
            why = self._port_trouble() or f"link {self.report.link.name.lower()}"
            raise Refused("link", f"the board is not there yet ({why})", retryable=True)
        fresh = standing(request, self.config, self.report, self.stored)
        self._go(Trigger.ARM, "arm", now)
        pulses = list(self.position)
        for i, pulse in fresh.items():
            pulses[i] = pulse
        self._drop_plans()
        self.order = replace(self.order, pose=tuple(pulses))
        board = self.report.board_outputs & sum(1 << i for i in fresh)
        at_once = request.where == "board" and board
        self._arming = deque(() if at_once else sorted(fresh))
        self._issue(now, outputs=self.report.outputs | (board if at_once else 0))
        self._next_on = now
        return Done(seconds=len(self._arming) * self.config.stagger / SECOND)

    def _move(self, request: MoveRequest, now: int) -> Done:
        follow(self.mode, Trigger.MOVE)
        payload = self.payload if request.payload_kg is None else request.payload_kg
        waypoints = [pulses_of(self.config, w, self.report.outputs) for w in request.waypoints]
        stride = max(1, int(self.config.step * request.speed))
        pace = Pace[request.pace.upper()]
        self._check_way(waypoints, stride, pace, payload)
        self._go(Trigger.MOVE, "move", now)
        self.payload, self._jog_until = payload, None
        self._waypoints = deque(waypoints)
        self.order = replace(self.order, stride=(stride,) * len(self.config.servos), pace=pace)
        seconds = duration(self.config, self.position, waypoints, stride)
        self._next_waypoint(now)
        return Done(seconds=seconds)

    def _check_way(self, waypoints: Sequence[Pulses], stride: int, pace: Pace, payload: float) -> None:
        """Refuses a way that collides, or that ends where a hot servo is loaded more than it is now.

        Each stretch between two corners is straight in joint space, as the guard wants it.
        """
        here = self.position
        loads_now = self._loads(self._joints(here), payload)
        goal: Sequence[int] = self.targets
        for number, waypoint in enumerate(waypoints, start=1):
            goal = overlaid(goal, waypoint)
            going = move(here, goal, (stride,) * len(here), pace)
            for stop in (going.at(k) for k in corners(self.config, going)):
                self._check_stretch(here, stop, number)
                here = stop
            self.heat.check(loads_now, self._loads(self._joints(goal), payload))

    def _check_stretch(self, here: Pulses, there: Pulses, number: int) -> None:
        if self._joints(here) == self._joints(there):
            return
        try:
            self.guard(self._joints(here), self._joints(there))
        except TooClose as error:
            raise Refused(
                "collision", f"waypoint {number}: {error}", waypoint=number, bodies=[error.first, error.second],
                distance_m=error.distance, fraction=error.fraction,
            ) from None  # fmt: skip

    def _joints(self, pulses: Sequence[int]) -> list[float]:
        return self.angles(pulses)[: self.config.dof]

    def _loads(self, q: Sequence[float], payload: float) -> tuple[float, ...]:
        tau = tuple(float(t) for t in self._torques(q, payload))
        return tau + (0.0,) * (len(self.config.servos) - len(tau))

    def _jog(self, request: JogRequest, now: int) -> Done:
        follow(self.mode, Trigger.MOVE)
        stride, target = list(self.order.stride), [HERE] * len(self.config.servos)
        for name, rate in request.rate_rad_per_s.items():
            i = armed(self.config, name, self.report.outputs)
            if rate:
                target[i], stride[i] = turning(self.config, i, self.position[i], rate)
        self._go(Trigger.MOVE, "jog", now)
        self._waypoints.clear()
        self._jog_until = now + self.config.command
        if target != self._goal or tuple(stride) != self.order.stride[: len(stride)]:
            self._goal = target
            self.order = replace(self.order, stride=tuple(stride), pace=Pace.EACH)
            self._issue(now)
        return Done()

    def _relax(self, request: RelaxRequest, now: int) -> Done:
        chosen = self.config.names if request.servos is None else request.servos
        off = sum({1 << self.config.index(name) for name in chosen})
        left = self.report.outputs & ~off
        trigger = Trigger.HOLD if left and self.mode in LIVE else Trigger.RELAX
        if left and self.mode not in LIVE:
            raise NotAllowed(self.mode, Trigger.HOLD)
        self._go(trigger, "relax", now)
        self._drop_plans()
        self._issue(now, outputs=left)
        return Done()

    def _reset(self, now: int) -> Done:
        if self.mode is Mode.FAULT and self.report.link is not LinkState.READY:
            raise Refused("link", "the board still does not answer", retryable=True)
        if self.mode is Mode.ESTOP and not self.limp:
            raise Refused("busy", "the pulses are still being stopped", retryable=True)
        self._go(Trigger.RESET_LIMP if self.limp else Trigger.RESET_STANDING, "reset_fault", now)
        self.faults.clear()
        self._drop_plans()
        self._issue(now, outputs=self.report.outputs)
        return Done()

    # ---- what comes by itself

    def observe(self, report: Report, now: int) -> None:
        """Takes in what the ramp says."""
        self.report = report
        if report.link is not self._link_was:
            self._link_changed(report)
        if report.port_error != self._port_error:
            self._port_error = report.port_error
            if report.port_error:
                self._tell("port_refused", "warning", self._port_trouble())
        if report.trips != self.order.trips:
            self._tripped(report, now)
        elif report.order == self.order.number:
            self._followed(report, now)

    def tick(self, now: int) -> None:
        """What happens because time passes. Leaves a fresh heartbeat in the order."""
        if self.lease is not None and now >= self.lease.until:
            holder, self.lease = self.lease.holder, None
            self._tell("lease_lost", "warning", f"{holder} gave no sign of life; its lease is over")
            self._stop_motion(now, "lease lost")
        if self._jog_until is not None and now >= self._jog_until:
            self._tell("command_watchdog", "warning", "the jog was not renewed; holding")
            self._stop_motion(now, "jog not renewed")
        elif self._jog_until is not None and now >= self._looked_at + LOOK_AHEAD // 3:
            self._look_ahead(now)
        if self._arming and now >= self._next_on and self.report.order == self.order.number:
            self._next_on = now + self.config.stagger
            self._issue(now, outputs=self.order.outputs | 1 << self._arming.popleft())
        if self.heat.due(now):
            self._warm_up(now)
        self.order = replace(self.order, heartbeat=now)

    def _look_ahead(self, now: int) -> None:
        """Stops a jog before it comes too close to anything."""
        self._looked_at = now
        ticks = LOOK_AHEAD // self.config.tick
        reach = [ticks * stride for stride in self.order.stride]
        ahead = tuple(min(max(g, p - r), p + r) for g, p, r in zip(self.targets, self.position, reach, strict=False))
        try:
            self._check_stretch(self.position, ahead, 1)
        except Refused as error:
            self._tell("jog_stopped", "warning", str(error), **error.detail)
            self._stop_motion(now, "a collision ahead")

    def _port_trouble(self) -> str:
        """Why the port cannot be opened, empty if it could."""
        number = self.report.port_error
        why = "another program has it open" if number == errno.EAGAIN else os.strerror(number).lower()
        return f"{self.config.link.port}: {why}" if number else ""

    def _link_changed(self, report: Report) -> None:
        was, self._link_was = self._link_was, report.link
        if report.link is LinkState.READY:
            self._tell("link_up", "info", "the board answers")
        elif was is LinkState.READY:
            self._tell("link_down", "warning", "the board does not answer, or its port is gone")

    def _tripped(self, report: Report, now: int) -> None:
        """The ramp froze. What it was told before is void; from here on orders know of it."""
        self.order = replace(self.order, trips=report.trips)
        self._drop_plans()
        if report.trip is Trip.ESTOP:
            if self.mode is not Mode.ESTOP:
                self.estop(now, "at the ramp")
            return
        trigger, code, text = _TRIPS[report.trip]
        if trigger is Trigger.STOPPED and not report.outputs and self.order.outputs:
            trigger = Trigger.OUTPUTS_LOST
        starting = report.trip is Trip.STARTED and report.starts <= 1
        if not starting:
            level: Literal["info", "error"] = "error" if self.mode in LIVE else "info"
            self._tell(code, level, text, trip=report.trip.name.lower())
        self.order = replace(self.order, outputs=report.outputs)
        if self.mode in (*LIVE, Mode.FAULT):
            self._go(trigger, text, now)
            if self.mode is Mode.FAULT:
                self._fault(code, text, now)

    def _followed(self, report: Report, now: int) -> None:
        """The ramp has read the newest order."""
        if report.outputs != self.order.outputs and report.taken:
            self.order = replace(self.order, outputs=report.outputs)
        if not report.taken and self.mode in (Mode.MOVING, Mode.ARMING):
            self._drop_plans()
            self.order = replace(self.order, outputs=report.outputs)
            self._tell("order_dropped", "warning", "the ramp could not take the order: the link was not up")
            self._go(Trigger.STOPPED if report.outputs else Trigger.OUTPUTS_LOST, "order dropped", now)
        elif self.mode is Mode.ARMING and not self._arming:
            self._go(Trigger.ALL_ON, "all servos are on", now)
        elif self.mode is Mode.MOVING and not report.moving and self._jog_until is None:
            if self._waypoints:
                self._next_waypoint(now)
            else:
                self._go(Trigger.ARRIVED, "arrived", now)

    def _next_waypoint(self, now: int) -> None:
        waypoint = self._waypoints.popleft()
        self._goal = list(overlaid(self._goal, waypoint))
        self._issue(now)

    def _hold(self, now: int, why: str) -> None:
        self._go(Trigger.HOLD, why, now)
        self._drop_plans()
        self._issue(now)

    def _stop_motion(self, now: int, why: str) -> None:
        """Holds if something is under way; an arm that stands is left alone."""
        if self.mode in (Mode.MOVING, Mode.ARMING):
            self._hold(now, why)

    # ---- heat

    def _warm_up(self, now: int) -> None:
        loads = self._loads(self._joints(self.position), self.payload)
        tau = [load if self.report.outputs >> i & 1 else 0.0 for i, load in enumerate(loads)]
        for change in self.heat.update(now, tau):
            if change.after > change.before:
                self._hotter(change.servo, change.after, now)
            elif change.after is Heat.COOL:
                self._tell("servo_cool", "info", f"{self.config.names[change.servo]} has cooled down")

    def _hotter(self, i: int, heat: Heat, now: int) -> None:
        name, T = self.config.names[i], self.heat.temperature[i]
        text = f"{name} is at {T:.0f} degC (modelled)"
        if heat is Heat.WARM:
            self._tell("servo_warm", "warning", f"{text}: no pose that loads it more is taken", servo=name)
        elif heat is Heat.HOT:
            self._tell("servo_hot", "error", f"{text}: the arm goes to rest", servo=name)
            self._rest(now)
        elif self.mode in LIVE:
            self._tell("servo_too_hot", "error", f"{text}: the pulses stop", servo=name)
            self._go(Trigger.FAILED, text, now)
            self._fault("too_hot", text, now)
            self._drop_plans()
            self._issue(now, outputs=0)

    def _rest(self, now: int) -> None:
        """Brings the joints that are on to the rest pose: the one motion that nobody asked for."""
        rest = self.config.rest
        if rest is None or self.mode not in (*STANDING, Mode.MOVING):
            return
        pulses = [HERE] * len(self.config.servos)
        for joint, angle in enumerate(rest):
            if self.report.outputs >> joint & 1:
                pulses[joint] = self.config.servos[joint].pulse_ns(angle)
        there = overlaid(self.position, pulses)
        try:
            self.guard(self._joints(self.position), self._joints(there))
        except LrmError as error:
            self._tell("rest_blocked", "error", f"the straight way to rest is not free: {error}; the arm stays")
            return
        self._go(Trigger.MOVE, "a hot servo goes to rest", now)
        self._drop_plans()
        self._waypoints.append(tuple(pulses))
        self.order = replace(self.order, stride=(self.config.step,) * len(pulses), pace=Pace.TOGETHER)
        self._next_waypoint(now)

    # ---- small things

    def _go(self, trigger: Trigger, why: str, now: int) -> None:
        mode = follow(self.mode, trigger)
        if mode is not self.mode or why != self.why:
            if mode is not self.mode:
                self._tell("mode", "info", f"{self.mode} -> {mode}: {why}", mode=mode.value, before=self.mode.value)
            self.mode, self.why, self.since = mode, why, now

    def _drop_plans(self) -> None:
        self._waypoints.clear()
        self._arming.clear()
        self._jog_until = None
        self._goal = [HERE] * len(self.config.servos)

    def _issue(self, now: int, outputs: int | None = None) -> None:
        self.order = replace(
            self.order, number=(self.order.number + 1) & 0xFFFFFFFF, heartbeat=now, target=tuple(self._goal),
            outputs=self.order.outputs if outputs is None else outputs,
        )  # fmt: skip

    def _fault(self, code: str, text: str, now: int) -> None:
        if code not in self.faults:
            self.faults[code] = Fault(code, text, now)

    def _tell(self, code: str, level: Literal["info", "warning", "error"], text: str, **detail: Any) -> None:
        self.happenings.append(Happening(code, level, text, detail))
