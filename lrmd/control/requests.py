"""Handlers of the clients' requests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np

from lrm_math.errors import LrmError
from lrmd.config import SECOND
from lrmd.control import thermal_protection, updates
from lrmd.control.arming_pose import arming_pulses
from lrmd.control.jogging import request_jog
from lrmd.control.motion_predictor import FinalLeg
from lrmd.control.ramp_orders import Departure, Leg, Pulses, overlaid, pulses_of
from lrmd.control.skill_run import SkillReport, SkillRun, begun
from lrmd.control.state import ControllerState, RequestResult
from lrmd.control.state_machine import LIVE, InvalidTransition, Mode, Trigger, next_mode
from lrmd.errors import RequestError
from lrmd.messages.codec import Header, Message
from lrmd.messages.control import (
    ArmRequest,
    CommandRequest,
    DisarmRequest,
    GravityCommand,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MotionRequest,
    MoveRequest,
    PayloadRequest,
    RelaxRequest,
    ResetRequest,
    SceneCommand,
)
from lrmd.messages.kinematics import KinematicsRequest
from lrmd.messages.skills import SenseCommand, SkillRequest
from lrmd.messages.surroundings import contacts_of
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.shared_memory import LinkState, RampOrder
from lrmd.ramp.stepping import Move, Pace
from lrmd.safety.collision_guard import CollisionGuard

SCENES_PER_S = 10
"""Each takes tens of milliseconds, and needs no lease: a flood of them must not keep the daemon from its work."""
PATIENCE = 2 * SECOND
"""ns after which who asked for a motion has given up (`lrmd.client`'s timeout): it is not begun any more."""
CONTACT_SPEED = 0.1
"""Share of the full rate at which an arm moves that may touch something."""


def _lease(s: ControllerState, request: LeaseRequest, now: int) -> RequestResult:
    if request.action == "acquire":
        return _acquire(s, request, now)
    if request.action == "renew":
        s.leasehold = s.leasehold.renewed(request.lease, now, s.config.lease)
        return RequestResult(lease=s.leasehold)
    s.leasehold = s.leasehold.released(request.lease)
    s.stop_motion(now, "lease released")
    return RequestResult()


def _acquire(s: ControllerState, request: LeaseRequest, now: int) -> RequestResult:
    if not request.holder:
        raise RequestError("no_holder", "holder is missing: name the client, for others to read")
    previous = s.leasehold
    s.leasehold = previous.acquired(request.holder, now, s.config.lease, request.take, request.lease)
    if previous.held:
        s.emit("lease_taken", "warning", f"{request.holder} took the lease from {previous.holder}")
        s.stop_motion(now, f"{request.holder} took the lease")
    return RequestResult(lease=s.leasehold)


def _hold(s: ControllerState, _: HoldRequest, now: int) -> RequestResult:
    s.stops += 1  # also where nothing moves: what was ordered before it is not carried out after it
    try:
        s.hold(now, "hold")
    except InvalidTransition as refused:
        refused.detail["stops"] = s.stops
        raise
    s.held_at = now
    return RequestResult()


def _arm(s: ControllerState, request: ArmRequest, now: int) -> RequestResult:
    next_mode(s.mode, Trigger.ARM, s.why)
    if s.report.link is not LinkState.READY:
        why = s.port_trouble or s.board_trouble or f"link {s.report.link.name.lower()}"
        raise RequestError("link", f"the board is not ready ({why})", retryable=True)
    s.check_settled()
    first_pulses = arming_pulses(request, s.config, s.report, s.saved(0), s.fallen.names(s.fallen.bits))
    thermal_protection.check_arming(s, sorted(first_pulses))
    s.transition(Trigger.ARM, "arm", now)
    if request.where == "given":
        s.motion_record.forget(first_pulses)
    pose = tuple(first_pulses.get(i, pulse) for i, pulse in enumerate(s.position))
    adopted = s.report.board_outputs & sum(1 << i for i in first_pulses) if request.where == "board" else 0
    one_by_one = [] if adopted else sorted(first_pulses)
    s.orders.arm(pose, s.report.outputs | adopted, one_by_one, now)
    return RequestResult(seconds=len(one_by_one) * s.config.stagger / SECOND)


def _move(s: ControllerState, request: MoveRequest, now: int) -> RequestResult:
    next_mode(s.mode, Trigger.MOVE, s.why)
    thermal_protection.check_motion(s)
    payload = s.payload if request.payload_kg is None else request.payload_kg
    legs, departure, contacts = _legs(s, request), s.departure(), contacts_of(request.may_touch)
    s.motion_check.check(departure.start, legs, payload, contacts)
    legs = _shaped(s, request, legs, departure.start, payload)
    s.transition(Trigger.MOVE, "move", now)
    s.carry(payload, s.load_at)
    s.rest_goal = None
    s.motion_check.touch(contacts)
    s.orders.start(legs, departure, now, contacts)
    final_leg = FinalLeg(_moves(legs, departure.start)[-1], payload, s.load_at)
    return RequestResult(seconds=_seconds(s, legs, departure), unchecked=s.unchecked, final_leg=final_leg)


def _shaped(s: ControllerState, request: MoveRequest, legs: list[Leg], start: Pulses, payload: float) -> list[Leg]:
    """Legs from pulses (ns), shaped as the request says, or the configuration where there is a model of motion.

    Only the last leg is timed; those before it are shaped by `zv` then.
    Raises `RequestError` for a request of a shape without a model.
    """
    kind = request.shaping or s.config.motion.shaping
    if kind == "off" or (request.may_touch and request.shaping is None):
        return legs
    if s.motion is None:
        if request.shaping is None:
            return legs
        text = f"shaping = '{kind}' needs a motion model: lrm deploy motion.toml, or [motion] model in lrmd.toml"
        raise RequestError("no_motion_model", text)
    if request.may_touch:
        raise RequestError("contact", "a motion that may touch something is not shaped; leave out shaping")
    out: list[Leg] = []
    for legs_left in range(len(legs), 0, -1):
        leg, leg_kind = legs[-legs_left], "zv" if kind == "timed" and legs_left > 1 else kind
        out.append(s.motion.shaped(start, leg, leg_kind, payload, s.load_at))
        start = overlaid(start, leg.target)
    return out


def _moves(legs: Sequence[Leg], start: Pulses) -> list[Move]:
    """The ramp's moves along legs from pulses (ns)."""
    out = []
    for leg in legs:
        out.append(leg.move(start))
        start = out[-1].at(out[-1].length)
    return out


def _legs(s: ControllerState, request: MoveRequest) -> list[Leg]:
    """One leg per waypoint; servos that none names go on to where they were going. Raises `LrmError`."""
    speed = min(request.speed, CONTACT_SPEED) if request.may_touch else request.speed
    stride, goal = max(1, int(s.config.step * speed)), s.orders.goal
    legs = []
    for waypoint in request.waypoints:
        goal = overlaid(goal, pulses_of(s.config, waypoint, s.report.outputs))
        legs.append(Leg(goal, (stride,) * len(goal), Pace[request.pace.upper()]))
    return legs


def _seconds(s: ControllerState, legs: Sequence[Leg], departure: Departure) -> float:
    """Time until the end of the last leg (s)."""
    ticks = departure.way.remaining - departure.remaining + sum(one.length for one in _moves(legs, departure.start))
    return ticks * s.config.tick / SECOND


def _relax(s: ControllerState, request: RelaxRequest, now: int) -> RequestResult:
    names = s.config.names if request.servos is None else request.servos
    if request.servos is not None and s.report.board_outputs & ~s.report.outputs:
        take_over = 'take its pose over: lrm arm --board (in rpc/arm: "where": "board")'
        text = f"the board is still pulsing others too; {take_over}, or relax all"
        raise RequestError("still_pulsing", text)
    remaining = s.outputs & ~sum({1 << s.config.index(name) for name in names})
    if remaining and s.mode not in LIVE:
        raise InvalidTransition(s.mode, Trigger.HOLD, s.why)
    s.transition(Trigger.HOLD if remaining else Trigger.RELAX, "relax", now)
    s.stops += 1
    s.stand(now, remaining)
    return RequestResult()


def _disarm(s: ControllerState, _: DisarmRequest, now: int) -> RequestResult:
    s.transition(Trigger.DISARM, "disarmed", now)
    s.stops += 1
    s.orders.issue(now, 0)
    return RequestResult()


def _reset(s: ControllerState, _: ResetRequest, now: int) -> RequestResult:
    if s.mode is Mode.FAULT and s.report.link is not LinkState.READY:
        raise RequestError("link", "the board still does not answer", retryable=True)
    if s.mode is Mode.ESTOP and s.report.outputs:
        raise RequestError("busy", "the pulses are still being stopped", retryable=True)
    s.transition(Trigger.RESET_OUTPUTS_ON if s.outputs else Trigger.RESET_OUTPUTS_OFF, "reset_fault", now)
    s.faults.clear()
    if s.outputs:  # else there may be pulses that another ramp left: an order of none would let the arm fall
        s.stand(now, s.outputs)
        thermal_protection.after_reset(s)
    return RequestResult()


def _gravity(s: ControllerState, request: GravityCommand, now: int) -> RequestResult:
    s.gravity.tell(request.gravity_m_per_s2, now)
    return RequestResult()


def _payload(s: ControllerState, request: PayloadRequest, now: int) -> RequestResult:
    """Raises `RequestError` for a load that the arm cannot carry where it stands; a motion whose rest the guard does
    not allow with it is stopped."""
    payload, (x, y, z) = request.payload_kg, request.payload_centre_m
    if any((x, y, z)) and not s.config.arm.carries_on_tool:
        raise RequestError(
            "payload", f"no body on the tool of {s.config.arm.name} carries a load: leave out its centre"
        )
    if s.report.outputs and payload and (payload > s.payload or (x, y, z) != s.load_at):
        s.motion_check.check_bearable(s.position, payload, s.guard_with(s.obstacles, (x, y, z)), (x, y, z))
    s.carry(payload, (x, y, z))
    updates.reconsider(s, now, "the new load")
    return RequestResult()


def _scene(s: ControllerState, request: SceneCommand, now: int) -> RequestResult:
    """Raises `RequestError`; an obstacle inside the arm is refused, and stops a motion."""
    if s.obstacles_told_at is not None and now - s.obstacles_told_at < SECOND // SCENES_PER_S:
        raise RequestError("busy", f"obstacles are taken {SCENES_PER_S} times a second at most", retryable=True)
    s.obstacles_told_at, names = now, s.config.arm.shapes.names
    obstacles = s.obstacles.changed(request, names, now)
    guard = s.guard_with(obstacles, s.load_at)
    told = [entry.name for entry in request.put]
    if told and isinstance(guard, CollisionGuard):
        here = np.array(s.angles(s.position)[: s.config.dof])
        if (inside := guard.overlaps(here, s.payload, told)) and s.report.outputs:
            s.stop_motion(now, f"the obstacle {inside[1]} is said to be inside the arm")
            raise RequestError("obstacle", f"'{inside[1]}' would be inside {inside[0]} where the arm stands")
    s.obstacles = obstacles
    updates.use_guard(s, guard, now, "an obstacle")
    return RequestResult()


def _skill(s: Controller, request: SkillRequest, _: int) -> RequestResult:
    s.skill = begun(s, s.skill, request)
    return RequestResult(skill=s.skill.report.number)


def _sense(s: Controller, command: SenseCommand, now: int) -> RequestResult:
    if s.skill is not None:
        s.skill.sense(s, command, now)
    return RequestResult()


Handler: TypeAlias = "Callable[[Controller, Any, int], RequestResult]"
Kind = TypeVar("Kind", bound=Message)


def _handled(kind: type[Kind], by: Callable[[Controller, Kind, int], RequestResult]) -> tuple[type[Message], Handler]:
    """A line of the table below; mypy sees that the function takes that kind of request."""
    return kind, by


HANDLERS: dict[type[Message], Handler] = dict([
    _handled(LeaseRequest, _lease), _handled(HoldRequest, _hold), _handled(ArmRequest, _arm),
    _handled(MoveRequest, _move), _handled(JogRequest, request_jog), _handled(RelaxRequest, _relax),
    _handled(DisarmRequest, _disarm), _handled(ResetRequest, _reset), _handled(GravityCommand, _gravity),
    _handled(SceneCommand, _scene), _handled(PayloadRequest, _payload), _handled(SkillRequest, _skill),
    _handled(SenseCommand, _sense),
])  # fmt: skip


class Controller(ControllerState):
    """The arm controller without input and output: requests and ramp reports in; results, orders and events out.

    The state and every operation on it; all times are monotonic ns. Not thread-safe: its owner keeps a lock. Servos
    move only on request, with one exception that an event announces: thermal protection (`thermal_protection.py`).
    """

    observe = updates.observe
    others_seen = updates.others_seen
    adopt_guard = updates.adopt_guard
    skill: SkillRun | None = None

    @property
    def skill_report(self) -> SkillReport:
        """What is known of the last skill."""
        return SkillReport() if self.skill is None else self.skill.report

    @property
    def question(self) -> tuple[int, KinematicsRequest] | None:
        """What the skill under way waits for the answer to, with its number."""
        return None if self.skill is None else self.skill.question

    def tick(self, now: int) -> None:
        """One cycle of the daemon: see `updates.tick`; the skill under way goes on."""
        updates.tick(self, now)
        if self.skill is not None:
            self.skill.advance(self, now, self.handle)

    def order_at(self, now: int) -> RampOrder:
        """The order for the ramp, to be written now: since it was made, the lease of its client may have run out."""
        updates.expire_lease(self, now)
        self.orders.set_heartbeat(now)
        return self.order

    def answer(self, number: int, reply: Header | LrmError, now: int) -> None:
        """Takes the answer to the question of the skill under way; any other is ignored."""
        if self.skill is not None:
            self.skill.answer(self, number, reply, now)

    def saved(self, wall: int) -> StoredState:
        """The state to store; a skill may move the arm again at any time."""
        state = super().saved(wall)
        return state.model_copy(update={"still": state.still and self.skill_report.outcome != "running"})

    def handle(self, request: Message, now: int, came: int | None = None) -> RequestResult:
        """Carries out a request, which came before now if that is said. Raises an `LrmError` if it cannot; then nothing
        has changed but an expired lease."""
        self.check_sender(request, now)
        self.came = now if came is None else came
        if isinstance(request, MotionRequest):
            self._check_late(request, now)
        return HANDLERS[type(request)](self, request, now)

    def check_sender(self, request: Message, now: int) -> None:
        """Raises `RequestError` for a request of a client that may not ask for it, or not now."""
        updates.expire_lease(self, now)
        if type(request) not in HANDLERS:
            raise RequestError("unknown_request", f"no such request: {type(request).__name__}")
        if isinstance(request, ArmRequest) and self.other_daemons:  # before the lease: the other one gives its own
            raise RequestError("name_taken", self.name_trouble, retryable=True)
        if isinstance(request, CommandRequest):
            self.leasehold.check(request.lease)
        if isinstance(request, MotionRequest):
            self._check_overtaken(request)

    def _check_late(self, request: MotionRequest, now: int) -> None:
        """Raises `RequestError` for a request that waited in the daemon for longer than its sender did."""
        waited, most = now - self.came, self.config.command if isinstance(request, JogRequest) else PATIENCE
        if waited >= most:
            text = f"this waited for {waited / SECOND:.1f} s in the daemon; ask again if it may go on"
            raise RequestError("late", text, retryable=True)

    def _check_overtaken(self, request: MotionRequest) -> None:
        """Raises `RequestError` for a request whose sender does not know of the last stop."""
        if request.stops is not None and request.stops != self.stops:
            text = f"the arm was stopped since this was asked for ({self.mode}: {self.why}); ask again if it may go on"
            raise RequestError("overtaken", text, stops=self.stops)
