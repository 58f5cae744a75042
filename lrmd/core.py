"""The daemon's mind, without zenoh, clock or processes: requests and reports in; replies, orders and events out.

Everything that moves a servo begins with a request, with two exceptions that DESIGN asks for and an event announces:
a servo that gets too hot sends the arm to its rest pose, and then stops the pulses.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from lrm_math.errors import LrmError, nearest
from lrmd import lease as leases
from lrmd.config import Config
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
from lrmd.ramp import Pace
from lrmd.states import LIVE, STANDING, Mode, NotAllowed, Trigger, follow
from lrmd.store import Saved
from lrmd.thermal import Heat, Thermal

SECOND = 1_000_000_000
Guard = Callable[[Sequence[float], Sequence[float]], None]
"""Raises an `LrmError` if the straight way between two poses (rad, one angle per joint) is not safe."""
Torques = Callable[[Sequence[float], float], Sequence[float]]
"""Gravity's torque (N m) on every joint for a pose (rad) and a payload (kg)."""


class Refused(LrmError):
    """A request that cannot be carried out now; carries `code`, `retryable` and `detail` for the reply."""

    def __init__(self, code: str, text: str, retryable: bool = False, **detail: Any) -> None:
        self.code, self.retryable, self.detail = code, retryable, detail
        super().__init__(text)


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
    ramp, `temperature` and `tau` (degC and N m per servo), `payload` (kg), `happenings` not told yet.
    """

    def __init__(
        self, config: Config, torques: Torques, stored: Saved | None, guard: Guard, now: int, wall: int
    ) -> None:
        self.config = config
        self.thermal = Thermal.of(config)
        self.mode, self.why, self.since = Mode.DISARMED, "started", now
        self.faults: dict[str, Fault] = {}
        self.lease: leases.Lease | None = None
        self.order = Order(stride=(config.step,) * len(config.servos), target=(HERE,) * 16)
        self.report = Report()
        self.payload = 0.0
        self.happenings: list[Happening] = []
        self.stored = stored
        self.boots = (stored.boots if stored else 0) + 1
        self._torques, self._guard = torques, guard
        self._index = {name: i for i, name in enumerate(config.names)}
        self._waypoints: deque[tuple[int, ...]] = deque()
        self._goal = [HERE] * len(config.servos)
        self._arming: deque[int] = deque()
        self._next_on = now
        self._jog_until: int | None = None
        self._resting: set[int] = set()
        self._link_was = LinkState.CLOSED
        self.tau: tuple[float, ...] = (0.0,) * len(config.servos)
        self._heated_at = now
        self.temperature = self._cooled(stored, wall)

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
        return tuple(p if g == HERE else g for g, p in zip(self._goal, self.position, strict=True))

    @property
    def limp(self) -> bool:
        """Whether no servo has pulses."""
        return not self.report.outputs

    def saved(self, wall: int) -> Saved:
        """What must survive a crash. Servos that never had pulses keep what was stored before."""
        known = dict(self.stored.pulse_ns) if self.stored else {}
        known |= {n: p for n, p in zip(self.config.names, self.position, strict=True) if p}
        return Saved(
            saved_wall_ns=wall, boots=self.boots, mode=self.mode, still=not self.report.moving, pulse_ns=known,
            temperature_c=dict(zip(self.config.names, self.temperature, strict=True)),
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
            self.lease = leases.renew(self.lease, request.lease or "", now, config.lease)
            return Done(lease=self.lease)
        leases.checked(self.lease, request.lease, now)
        self.lease = None
        self._stop_motion(now, "lease released")
        return Done()

    def _arm(self, request: ArmRequest, now: int) -> Done:
        follow(self.mode, Trigger.ARM)
        if self.report.link is not LinkState.READY:
            raise Refused("link", f"the board is not there yet (link {self.report.link.name.lower()})", retryable=True)
        pose = self._standing(request)
        fresh = {i: p for i, p in pose.items() if not self.report.outputs >> i & 1}
        for i, pulse in fresh.items():
            self._check_pulse(i, pulse)
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

    def _standing(self, request: ArmRequest) -> dict[int, int]:
        """Pulse (ns) of every servo to arm, from what the request knows of where they stand."""
        pulsing, config = self.report.board_outputs, self.config
        if request.where == "board":
            if not pulsing:
                stored = self.stored_angles()
                raise Refused(
                    "pose_needed",
                    "the board has no pulses to take over. Say where the arm stands: where = 'given' with q_rad, or "
                    "'stored' if it has not been touched since the daemon left it",
                    stored_rad=stored, stored_still=bool(self.stored and self.stored.still),
                )  # fmt: skip
            return {i: self.report.register[i] for i in range(len(config.servos)) if pulsing >> i & 1}
        if pulsing & ~self.report.outputs:
            raise Refused("still_pulsing", "the board is still pulsing; take its pose over with where = 'board'")
        if request.where == "given":
            if not request.q_rad:
                raise Refused("pose_needed", "where = 'given' needs q_rad: the angles where the servos stand")
            return {self._servo(n): config.servos[self._servo(n)].pulse_ns(q) for n, q in request.q_rad.items()}
        return self._stored_pose(request.servos)

    def _stored_pose(self, names: Sequence[str] | None) -> dict[int, int]:
        stored = self.stored
        if stored is None or not stored.pulse_ns:
            raise Refused("pose_needed", "no pose was stored yet; say it with where = 'given' and q_rad")
        if not stored.still:
            raise Refused(
                "pose_needed", "the arm was moving when its pose was last stored; say it with where = 'given' and q_rad"
            )
        missing = [n for n in names or () if n not in stored.pulse_ns]
        if missing:
            self._servo(missing[0])
            raise Refused("pose_needed", f"no pose of {missing[0]} was stored; say it with where = 'given' and q_rad")
        wanted = names or [n for n in stored.pulse_ns if n in self._index]
        return {self._servo(n): stored.pulse_ns[n] for n in wanted}

    def stored_angles(self) -> dict[str, float]:
        """Angle (rad) of every servo as it was stored."""
        pulses = self.stored.pulse_ns if self.stored else {}
        return {n: self.config.servos[self._index[n]].angle(p) for n, p in pulses.items() if n in self._index}

    def _move(self, request: MoveRequest, now: int) -> Done:
        follow(self.mode, Trigger.MOVE)
        payload = self.payload if request.payload_kg is None else request.payload_kg
        waypoints = [self._pulses(w) for w in request.waypoints]
        self._check_way(waypoints, payload)
        self._go(Trigger.MOVE, "move", now)
        self.payload, self._jog_until = payload, None
        self._waypoints = deque(waypoints)
        stride = max(1, int(self.config.step * request.speed))
        self.order = replace(self.order, stride=(stride,) * len(self.config.servos), pace=Pace[request.pace.upper()])
        seconds = self._duration(waypoints, stride)
        self._next_waypoint(now)
        return Done(seconds=seconds)

    def _pulses(self, angles: Mapping[str, float]) -> tuple[int, ...]:
        """Pulse (ns) of every servo that is named, `HERE` for the others. Raises for what cannot be."""
        pulses = [HERE] * len(self.config.servos)
        if not angles:
            raise Refused("no_angles", f"a waypoint without angles; name servos: {', '.join(self.config.names)}")
        for name, angle in angles.items():
            i = self._servo(name)
            if not self.report.outputs >> i & 1:
                raise Refused("not_armed", f"{name} has no pulses; arm it first", servo=name)
            pulse = self.config.servos[i].pulse_ns(angle)
            self._check_pulse(i, pulse)
            pulses[i] = pulse
        return tuple(pulses)

    def _check_pulse(self, i: int, pulse: int) -> None:
        servo = self.config.servos[i]
        if not servo.lowest <= pulse <= servo.highest:
            low, high = sorted(math.degrees(servo.angle(p)) for p in (servo.lowest, servo.highest))
            angle = math.degrees(servo.angle(pulse))
            raise Refused(
                "limit", f"{servo.name}: {angle:.1f} deg is outside its limits {low:g} to {high:g} deg",
                servo=servo.name, q_rad=servo.angle(pulse), limits_rad=[math.radians(low), math.radians(high)],
            )  # fmt: skip

    def _check_way(self, waypoints: Sequence[tuple[int, ...]], payload: float) -> None:
        """Refuses a way that collides, or that ends where a hot servo is loaded more than it is now."""
        dof = self.config.dof
        here = self.angles(self.position)[:dof]
        loads_now = self._loads(here, payload)
        pulses = list(self.targets)
        for number, waypoint in enumerate(waypoints, start=1):
            pulses = [old if new == HERE else new for old, new in zip(pulses, waypoint, strict=True)]
            there = self.angles(pulses)[:dof]
            if there != here:
                self._check_heat(loads_now, self._loads(there, payload))
                try:
                    self._guard(here, there)
                except LrmError as error:
                    raise Refused("collision", f"waypoint {number}: {error}", waypoint=number) from None
            here = there

    def _check_heat(self, now: Sequence[float], then: Sequence[float]) -> None:
        for servo, before, after, T in zip(self.config.servos, now, then, self.temperature, strict=True):
            if self.thermal.heat(T) >= Heat.WARM and abs(after) > abs(before) + 1e-9:
                raise Refused(
                    "too_warm",
                    f"{servo.name} is at {T:.0f} degC and would hold {abs(after):.2f} instead of {abs(before):.2f} Nm; "
                    "go where it carries less, or let it cool",
                    retryable=True, servo=servo.name,
                )  # fmt: skip

    def _loads(self, q: Sequence[float], payload: float) -> tuple[float, ...]:
        tau = tuple(float(t) for t in self._torques(q, payload))
        return tau + (0.0,) * (len(self.config.servos) - len(tau))

    def _duration(self, waypoints: Sequence[tuple[int, ...]], stride: int) -> float:
        ticks, here = 0, list(self.position)
        for waypoint in waypoints:
            there = [old if new == HERE else new for old, new in zip(here, waypoint, strict=True)]
            ticks += max(-(-abs(b - a) // stride) for a, b in zip(here, there, strict=True))
            here = there
        return ticks * self.config.tick / SECOND

    def _jog(self, request: JogRequest, now: int) -> Done:
        follow(self.mode, Trigger.MOVE)
        stride, target = list(self.order.stride), [HERE] * len(self.config.servos)
        for name, rate in request.rate_rad_per_s.items():
            i = self._servo(name)
            if not self.report.outputs >> i & 1:
                raise Refused("not_armed", f"{name} has no pulses; arm it first", servo=name)
            if rate:
                target[i], stride[i] = self._run_to_limit(i, rate)
        self._go(Trigger.MOVE, "jog", now)
        self._waypoints.clear()
        self._jog_until = now + self.config.command
        if target != self._goal or tuple(stride) != self.order.stride[: len(stride)]:
            self._goal = target
            self.order = replace(self.order, stride=tuple(stride), pace=Pace.EACH)
            self._issue(now)
        return Done()

    def _run_to_limit(self, i: int, rate: float) -> tuple[int, int]:
        """Target (ns) and stride (ns per tick) of a servo that turns at `rate` (rad/s)."""
        servo, tick = self.config.servos[i], self.config.tick / SECOND
        here = self.position[i]
        angle = servo.angle(here)
        per_tick = abs(servo.pulse_ns(angle + math.copysign(0.01, rate)) - here) / 0.01 * abs(rate) * tick
        if per_tick > self.config.step:
            fastest = math.degrees(abs(rate) * self.config.step / per_tick)
            raise Refused("too_fast", f"{servo.name}: {math.degrees(rate):.1f} deg/s; at most {fastest:.1f} deg/s")
        rising = servo.pulse_ns(angle + math.copysign(0.01, rate)) > here
        return (servo.highest if rising else servo.lowest), max(1, round(per_tick))

    def _relax(self, request: RelaxRequest, now: int) -> Done:
        chosen = self.config.names if request.servos is None else request.servos
        off = sum({1 << self._servo(name) for name in chosen})
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
        if self._arming and now >= self._next_on and self.report.order == self.order.number:
            self._next_on = now + self.config.stagger
            self._issue(now, outputs=self.order.outputs | 1 << self._arming.popleft())
        if now - self._heated_at >= SECOND:
            self._heat(now)
        self.order = replace(self.order, heartbeat=now)

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
        self._goal = [old if new == HERE else new for old, new in zip(self._goal, waypoint, strict=True)]
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

    def _cooled(self, stored: Saved | None, wall: int) -> tuple[float, ...]:
        """Temperatures (degC) at the start: what they were when stored, cooled for the time since."""
        cold = self.thermal.cold()
        if stored is None:
            return cold
        was = tuple(stored.temperature_c.get(n, T) for n, T in zip(self.config.names, cold, strict=True))
        return self.thermal.after((wall - stored.saved_wall_ns) / SECOND, was, (0.0,) * len(cold))

    def _heat(self, now: int) -> None:
        seconds, self._heated_at = (now - self._heated_at) / SECOND, now
        loads = self._loads(self.angles(self.position)[: self.config.dof], self.payload)
        self.tau = tuple(t if self.report.outputs >> i & 1 else 0.0 for i, t in enumerate(loads))
        before = [self.thermal.heat(T) for T in self.temperature]
        self.temperature = self.thermal.after(seconds, self.temperature, self.tau)
        after = [self.thermal.heat(T) for T in self.temperature]
        for i, (old, new) in enumerate(zip(before, after, strict=True)):
            if new > old:
                self._hotter(i, new, now)
            elif new is Heat.COOL and old is not Heat.COOL:
                self._tell("servo_cool", "info", f"{self.config.names[i]} has cooled down")
            if new < Heat.HOT:
                self._resting.discard(i)

    def _hotter(self, i: int, heat: Heat, now: int) -> None:
        name, T = self.config.names[i], self.temperature[i]
        text = f"{name} is at {T:.0f} degC (modelled)"
        if heat is Heat.WARM:
            self._tell("servo_warm", "warning", f"{text}: no pose that loads it more is taken", servo=name)
        elif heat is Heat.HOT:
            self._tell("servo_hot", "error", f"{text}: the arm goes to rest", servo=name)
            self._rest(i, now)
        elif self.mode in LIVE:
            self._tell("servo_too_hot", "error", f"{text}: the pulses stop", servo=name)
            self._go(Trigger.FAILED, text, now)
            self._fault("too_hot", text, now)
            self._drop_plans()
            self._issue(now, outputs=0)

    def _rest(self, i: int, now: int) -> None:
        """Brings the joints that are on to the rest pose: the one motion that nobody asked for."""
        rest = self.config.rest
        if rest is None or self.mode not in (*STANDING, Mode.MOVING) or i in self._resting:
            return
        self._resting.add(i)
        pulses = [HERE] * len(self.config.servos)
        for joint, angle in enumerate(rest):
            if self.report.outputs >> joint & 1:
                pulses[joint] = self.config.servos[joint].pulse_ns(angle)
        there = [p if g == HERE else g for g, p in zip(pulses, self.position, strict=True)]
        try:
            self._guard(self.angles(self.position)[: self.config.dof], self.angles(there)[: self.config.dof])
        except LrmError as error:
            self._tell("rest_blocked", "error", f"the straight way to rest is not free: {error}; the arm stays")
            return
        self._go(Trigger.MOVE, "a hot servo goes to rest", now)
        self._drop_plans()
        self._waypoints.append(tuple(pulses))
        self.order = replace(self.order, stride=(self.config.step,) * len(pulses), pace=Pace.TOGETHER)
        self._next_waypoint(now)

    # ---- small things

    def _servo(self, name: str) -> int:
        if name not in self._index:
            raise Refused("unknown_servo", f"unknown servo '{name}'; {nearest(name, self.config.names)}")
        return self._index[name]

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
