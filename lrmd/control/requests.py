"""What clients ask of the arm, carried out."""

from __future__ import annotations

from lrmd.control import lease as leases
from lrmd.control.arming_pose import standing
from lrmd.control.events import Done
from lrmd.control.pulses import armed, duration, pulses_of, turning
from lrmd.control.state import Situation
from lrmd.control.state_machine import LIVE, Mode, NotAllowed, Trigger, follow
from lrmd.errors import Refused
from lrmd.messages.control import (
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
from lrmd.ramp.shared_memory import HERE, LinkState
from lrmd.ramp.stepping import Pace

SECOND = 1_000_000_000
WithLease = ArmRequest | MoveRequest | JogRequest | RelaxRequest | DisarmRequest | ResetRequest


def carry_out(s: Situation, request: Message, now: int) -> Done:
    """Carries out a request. Raises an `LrmError` if it cannot; then nothing has changed."""
    match request:
        case LeaseRequest():
            return _lease(s, request, now)
        case HoldRequest():
            s.hold(now, "hold")
            return Done()
        case ArmRequest() | MoveRequest() | JogRequest() | RelaxRequest() | DisarmRequest() | ResetRequest():
            leases.checked(s.lease, request.lease, now)
            return _commanded(s, request, now)
        case _:
            raise Refused("unknown_request", f"no such request: {type(request).__name__}")


def _commanded(s: Situation, request: WithLease, now: int) -> Done:
    match request:
        case ArmRequest():
            return _arm(s, request, now)
        case MoveRequest():
            return _move(s, request, now)
        case JogRequest():
            return _jog(s, request, now)
        case RelaxRequest():
            return _relax(s, request, now)
        case DisarmRequest():
            return _disarm(s, now)
        case ResetRequest():
            return _reset(s, now)


def _lease(s: Situation, request: LeaseRequest, now: int) -> Done:
    if request.action == "acquire":
        return _acquire(s, request, now)
    if request.action == "renew":
        s.lease = leases.renew(s.lease, request.lease, now, s.config.lease)
        return Done(lease=s.lease)
    leases.checked(s.lease, request.lease, now)
    s.lease = None
    s.stop_motion(now, "lease released")
    return Done()


def _acquire(s: Situation, request: LeaseRequest, now: int) -> Done:
    if not request.holder:
        raise Refused("no_holder", "holder is missing: say who asks, for others to read")
    before = s.lease
    s.lease = leases.acquire(before, request.holder, now, s.config.lease, request.take)
    if before is not None and now < before.until:
        s.happened("lease_taken", "warning", f"{request.holder} took the lease from {before.holder}")
        s.stop_motion(now, f"{request.holder} took the lease")
    return Done(lease=s.lease)


def _arm(s: Situation, request: ArmRequest, now: int) -> Done:
    follow(s.mode, Trigger.ARM)
    if s.report.link is not LinkState.READY:
        why = s.port_trouble or f"link {s.report.link.name.lower()}"
        raise Refused("link", f"the board is not there yet ({why})", retryable=True)
    fresh = standing(request, s.config, s.report, s.stored)
    s.go(Trigger.ARM, "arm", now)
    pose = tuple(fresh.get(i, pulse) for i, pulse in enumerate(s.position))
    pulsing = s.report.board_outputs & sum(1 << i for i in fresh) if request.where == "board" else 0
    one_by_one = [] if pulsing else sorted(fresh)
    s.orders.arm(pose, s.report.outputs | pulsing, one_by_one, now)
    return Done(seconds=len(one_by_one) * s.config.stagger / SECOND)


def _move(s: Situation, request: MoveRequest, now: int) -> Done:
    follow(s.mode, Trigger.MOVE)
    payload = s.payload if request.payload_kg is None else request.payload_kg
    waypoints = [pulses_of(s.config, w, s.report.outputs) for w in request.waypoints]
    stride = max(1, int(s.config.step * request.speed))
    pace = Pace[request.pace.upper()]
    s.way.check(s.position, s.targets, waypoints, stride, pace, payload)
    s.go(Trigger.MOVE, "move", now)
    s.payload = payload
    s.orders.go(waypoints, stride, pace, now)
    return Done(seconds=duration(s.config, s.position, waypoints, stride))


def _jog(s: Situation, request: JogRequest, now: int) -> Done:
    follow(s.mode, Trigger.MOVE)
    stride, target = list(s.order.stride), [HERE] * len(s.config.servos)
    for name, rate in request.rate_rad_per_s.items():
        i = armed(s.config, name, s.report.outputs)
        if rate:
            target[i], stride[i] = turning(s.config, i, s.position[i], rate)
    s.go(Trigger.MOVE, "jog", now)
    s.orders.jog(tuple(target), tuple(stride), now)
    return Done()


def _relax(s: Situation, request: RelaxRequest, now: int) -> Done:
    chosen = s.config.names if request.servos is None else request.servos
    off = sum({1 << s.config.index(name) for name in chosen})
    left = s.report.outputs & ~off
    if left and s.mode not in LIVE:
        raise NotAllowed(s.mode, Trigger.HOLD)
    s.go(Trigger.HOLD if left else Trigger.RELAX, "relax", now)
    s.orders.stop(now, left)
    return Done()


def _disarm(s: Situation, now: int) -> Done:
    s.go(Trigger.DISARM, "disarmed", now)
    s.orders.issue(now, 0)
    return Done()


def _reset(s: Situation, now: int) -> Done:
    if s.mode is Mode.FAULT and s.report.link is not LinkState.READY:
        raise Refused("link", "the board still does not answer", retryable=True)
    if s.mode is Mode.ESTOP and not s.limp:
        raise Refused("busy", "the pulses are still being stopped", retryable=True)
    s.go(Trigger.RESET_LIMP if s.limp else Trigger.RESET_STANDING, "reset_fault", now)
    s.faults.clear()
    s.orders.stop(now, s.report.outputs)
    return Done()
