"""State of the arm controller, what it gives beside its orders (events, latched faults, results), and the elementary
operations on it."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any, Literal

from lrm_math.arrays import ORIGIN, Vector3
from lrmd.config import Config
from lrmd.control.fallen_servos import FallenServos
from lrmd.control.gravity import KnownGravity
from lrmd.control.known_obstacles import KnownObstacles
from lrmd.control.lease import Lease
from lrmd.control.motion_check import MotionCheck
from lrmd.control.motion_predictor import FinalLeg, MotionPredictor
from lrmd.control.motion_record import MotionRecord
from lrmd.control.ramp_orders import Departure, OrderScheduler, Pulses, angles, overlaid
from lrmd.control.state_machine import Mode, Trigger, next_mode
from lrmd.errors import RequestError
from lrmd.link.protocol import VERSION as PROTOCOL
from lrmd.messages.control import FaultEntry
from lrmd.persistence.state_file import HOTTEST, StoredState, arm_identity
from lrmd.ramp.shared_memory import NONE, RampOrder, RampReport
from lrmd.safety.collision_guard import CollisionGuard, Guard
from lrmd.safety.thermal_model import ThermalMonitor, Torques

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class ControllerEvent:
    """An event: published on zenoh and logged."""

    code: str
    level: Level
    text: str
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RequestResult:
    """Result of a request: expected duration (s) where it is known, the lease it granted, and why the motion that it
    began was not checked for collisions. `final_leg`: the last leg of that motion. `skill`: number of one it began."""

    seconds: float | None = None
    lease: Lease | None = None
    unchecked: str = ""
    final_leg: FinalLeg | None = None
    skill: int | None = None


LEAD = 12
"""Ticks, 78 ms: how far ahead on the present motion another one begins; in the meantime it is checked and read."""


class ControllerState:
    """Everything that the controller knows.

    Attributes: `mode`, `why`, `since` (monotonic ns), `faults` by code, the lease as `leasehold`, `orders` for the
    ramp, its `report`, `thermal` monitor, `motion_check`, `motion_record`, `payload` (kg), the known `gravity`,
    `obstacles`, told of at `obstacles_told_at` (monotonic ns), `guard` without them,
    unpublished `events`, the model of `motion` or None, and the state file as `stored`.
    `fallen`: servos without pulses whose position is not known.
    `stops`: number of holds, emergency stops, disarmings and faults so far. `came`: when the request came that is
    carried out (monotonic ns). Of the thermal protection: `held_at`,
    `rest_tried_at` (monotonic ns) of the last hold and attempt to go to rest, `rest_goal` (pulses, ns) of the last
    motion to rest, `rest_blocked` while its path is not free, and `reset_at`: motions that had begun at a reset after
    which none was asked for yet; None otherwise.
    """

    def __init__(
        self,
        config: Config,
        torques: Torques,
        stored: StoredState | None,
        guard: Guard | None,
        now: int,
        wall: int,
    ) -> None:
        self.config = config
        self.mode, self.why, self.since = Mode.DISARMED, "started", now
        self.faults: dict[str, FaultEntry] = {}
        self.events: list[ControllerEvent] = []
        self.leasehold = Lease()
        self.report = RampReport()
        self.other_daemons: frozenset[str] = frozenset()
        self.stops, self.came = 0, now
        self.payload = stored.payload_kg if stored else 0.0
        self.stored = stored
        self._identity = arm_identity(config)
        self._stored_at_rest = stored is None or stored.still
        self.boots = (stored.boots if stored else 0) + 1
        self.thermal = ThermalMonitor(config, stored, now, wall)
        self.motion_record = MotionRecord(config, stored, now, wall)
        self.motion_check = MotionCheck(config, torques, guard, self.thermal)
        self.guard = guard
        self.obstacles = KnownObstacles()
        if stored and config.arm.carries_on_tool:
            self.carry(self.payload, stored.payload_centre_m)
        self.obstacles_told_at: int | None = None
        self.fallen = FallenServos(config, self.motion_check, stored)
        self.orders = OrderScheduler(config, now)
        self.motion: MotionPredictor | None = None
        self.gravity = KnownGravity(config)
        self.held_at: int | None = None
        self.rest_goal: Pulses | None = None
        self.reset_at: int | None = None
        self.rest_tried_at, self.rest_blocked = now, False

    def angles(self, pulses: Sequence[int]) -> list[float]:
        """Angle (rad) of every servo for these pulses (ns); 0 where none was ever sent."""
        return angles(self.config, pulses)

    def guard_with(self, obstacles: KnownObstacles, centre: Vector3) -> Guard | None:
        """The guard that knows obstacles, and the centre of the load (m). Raises `LrmError`: the arm can have none."""
        guard = obstacles.added_to(self.guard, self.config.arm)
        return guard.with_load_at(centre) if any(centre) and isinstance(guard, CollisionGuard) else guard

    def carry(self, payload: float, centre: Sequence[float]) -> None:
        """Takes a payload (kg) and its centre (m) for what the gripper carries. Raises `LrmError`: see `guard_with`."""
        x, y, z = centre if payload else ORIGIN
        if (x, y, z) != self.load_at:
            self.motion_check.guard = self.guard_with(self.obstacles, (x, y, z))
            self.motion_check.load_at = x, y, z
        self.payload = payload

    @property
    def load_at(self) -> Vector3:
        """Centre of the load (m), see `Arm.with_load_at`."""
        return self.motion_check.load_at

    @property
    def lease(self) -> Lease | None:
        """The lease that somebody holds."""
        return self.leasehold if self.leasehold.held else None

    @property
    def order(self) -> RampOrder:
        """The newest order for the ramp."""
        return self.orders.newest

    @property
    def position(self) -> Pulses:
        """Last commanded pulses (ns) of the servos."""
        return self.report.position[: len(self.config.servos)]

    @property
    def targets(self) -> Pulses:
        """Target pulses (ns) of the servos."""
        return overlaid(self.position, self.orders.goal)

    @property
    def settled(self) -> bool:
        """Whether the ramp has read the newest order, so that it is known where the servos are, or will be."""
        return self.report.order == self.order.number

    @property
    def outputs(self) -> int:
        """Servos (bits) that have pulses, or will have them once the ramp has read the newest order."""
        return self.report.outputs if self.settled else self.order.outputs

    def check_settled(self) -> None:
        """Raises `RequestError` while the ramp has not read the newest order."""
        if not self.settled:
            raise RequestError("busy", "the ramp has not read the last order yet; ask again", retryable=True)

    def departure(self) -> Departure:
        """Departure of the next motion. Raises `RequestError` while the ramp has not read the newest order."""
        self.check_settled()
        remaining = self.report.remaining if self.orders.way.parts else 0
        return self.orders.departure(remaining, LEAD, self.position)

    @property
    def unchecked(self) -> str:
        """Reason why no motion is checked for collisions; empty if motions are."""
        return "" if self.motion_check.guard else f"{self.config.arm.name} has no collision shapes"

    @property
    def going_to_rest(self) -> bool:
        """Whether the motion under way is that of the thermal protection."""
        return self.mode is Mode.MOVING and self.orders.destination == self.rest_goal

    @property
    def port_trouble(self) -> str:
        """Reason why the port cannot be opened; empty if it is open."""
        number = self.report.port_error
        why = "another program has it open" if number in (errno.EAGAIN, errno.EBUSY) else os.strerror(number).lower()
        return f"{self.config.link.port}: {why}" if number else ""

    @property
    def board_trouble(self) -> str:
        """Fault of the board's firmware; empty if nothing is."""
        if not self.report.other_version:
            return ""
        return (
            f"the board speaks protocol {self.report.other_version}, this daemon needs {PROTOCOL}: "
            f"flash the firmware/ of lrm-arm {version('lrm-arm')} onto it"
        )

    @property
    def name_trouble(self) -> str:
        """Fault of the robot's name on the network; empty if this daemon has it alone."""
        if not self.other_daemons:
            return ""
        others = ", ".join(sorted(self.other_daemons)[:3])
        return f"another daemon on the network is named {self.config.robot}, too (boot_id {others}): rename one of them"

    @property
    def troubles(self) -> list[str]:
        """Obstacles to arming, besides the mode."""
        return [trouble for trouble in (self.port_trouble, self.board_trouble, self.name_trouble) if trouble]

    def saved(self, wall: int) -> StoredState:
        """The state to store. Servos without a pulse since the start keep their stored one, and its `still`."""
        before = dict(self.stored.pulse_ns) if self.stored else {}
        known = {n: p for n, p in zip(self.config.names, self.position, strict=True) if p}
        at_rest = not self.report.moving and self.mode is not Mode.MOVING
        still = at_rest and (self._stored_at_rest or before.keys() <= known.keys())
        heat = {n: min(T, HOTTEST) for n, T in zip(self.config.names, self.thermal.temperature, strict=True)}
        state = StoredState(
            saved_wall_ns=wall, boots=self.boots, arm=self.config.arm.name, identity=self._identity, mode=self.mode,
            still=still, pulse_ns=before | known, payload_kg=self.payload,
            payload_centre_m=list(self.load_at), temperature_c=heat,
            fallen=self.fallen.names_if_all_ended(self.report, self.payload),
        )  # fmt: skip
        return self.motion_record.added_to(state)

    def transition(self, trigger: Trigger, why: str, now: int) -> None:
        """Changes the mode by the transition table. Raises `InvalidTransition`; then nothing has changed."""
        mode = next_mode(self.mode, trigger, self.why)
        if mode is not self.mode:
            self.emit("mode", "info", f"{self.mode} -> {mode}: {why}", mode=mode.value, before=self.mode.value)
        if mode is not self.mode or why != self.why:
            self.mode, self.why, self.since = mode, why, now

    def hold(self, now: int, why: str) -> None:
        """Stops the motion with the pulses on. Raises `InvalidTransition`."""
        self.transition(Trigger.HOLD, why, now)
        self.stand(now, self.outputs)

    def stand(self, now: int, outputs: int) -> None:
        """Orders the servos to stay where they are, with pulses for `outputs` (bits) of those that have them.

        One that the ramp was ordered to switch on, and may not have read it yet, is switched on at its pose.
        """
        self.orders.stop(now, outputs, NONE if self.settled else self.order.pose)

    def stop_motion(self, now: int, why: str) -> None:
        """Holds if a client's motion is under way; a stationary arm keeps its mode, a hot one goes on to rest."""
        if self.mode in (Mode.MOVING, Mode.ARMING) and not self.going_to_rest:
            self.hold(now, why)

    def estop(self, now: int, why: str) -> None:
        """Records an emergency stop; the ramp was notified directly, before."""
        self.stops += 1
        self.transition(Trigger.ESTOP, why or "estop", now)
        self.add_fault("estop", f"emergency stop: {why or 'no reason given'}", now)
        self.orders.stop(now, 0)

    def add_fault(self, code: str, text: str, now: int) -> None:
        """Latches a fault until it is reset."""
        self.faults.setdefault(code, FaultEntry(code=code, text=text, since_mono_ns=now))

    def emit(self, code: str, level: Level, text: str, **detail: Any) -> None:
        """Queues an event for publication."""
        self.events.append(ControllerEvent(code, level, text, detail))
