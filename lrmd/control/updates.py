"""Periodic updates of the controller: reports of the ramp, expired leases and jogs, thermal protection."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lrm_math.errors import LrmError
from lrmd.control import jogging, thermal_protection
from lrmd.control.ramp_orders import Leg
from lrmd.control.state import ControllerState, Level
from lrmd.control.state_machine import LIVE, Mode, Trigger
from lrmd.link.protocol import VERSION as PROTOCOL
from lrmd.messages.control import LEASE_LOST
from lrmd.ramp.shared_memory import LinkState, RampFault, RampReport
from lrmd.safety.collision_guard import Guard


@dataclass(frozen=True)
class FaultResponse:
    """The state machine's trigger, and the code and text of the event."""

    trigger: Trigger
    code: str
    text: str


FAULT_RESPONSES = {
    RampFault.STARTED: FaultResponse(
        Trigger.STOPPED, "ramp_restarted", "the ramp process was restarted; the arm does not move"
    ),
    RampFault.LINK_LOST: FaultResponse(Trigger.FAILED, "link_lost", "the board does not answer"),
    RampFault.BOARD_RESTARTED: FaultResponse(
        Trigger.OUTPUTS_LOST, "board_restarted", "the board lost its power; the arm is limp"
    ),
    RampFault.BOARD_SILENCED: FaultResponse(
        Trigger.OUTPUTS_LOST, "board_silenced", "the board stopped its pulses; the arm is limp"
    ),
    RampFault.API_SILENT: FaultResponse(
        Trigger.STOPPED, "api_silent", "the ramp had no sign of life of the daemon and stopped"
    ),
    RampFault.REFUSED: FaultResponse(
        Trigger.FAILED, "order_refused", "the ramp refused an order outside the limits: a software fault"
    ),
}
"""Response to every fault of the ramp but the emergency stop, which a client requested."""


def fault_response(report: RampReport, ordered: int) -> FaultResponse:
    """Response to the report's fault, where `ordered` outputs (bits) should be on: a stop may have lost them."""
    response = FAULT_RESPONSES[report.fault]
    outputs_lost = response.trigger is Trigger.STOPPED and ordered and not report.outputs
    return replace(response, trigger=Trigger.OUTPUTS_LOST) if outputs_lost else response


def observe(s: ControllerState, report: RampReport, now: int) -> None:
    """Processes a report of the ramp."""
    before, s.report = s.report, report
    s.fallen.follow(before, report, s.payload)
    s.motion_record.follow(report, max(s.thermal.temperature), now)
    if report.link is not before.link:
        _link_changed(s, before.link, report.link)
    if report.port_error not in (0, before.port_error):
        s.emit("port_refused", "warning", s.port_trouble)
    if report.other_version not in (0, before.other_version):
        s.emit("board_version", "error", s.board_trouble, board=report.other_version, needed=PROTOCOL)
    if report.fault_count != s.order.fault_count:
        _ramp_froze(s, report, now)
    elif report.order == s.order.number:
        _order_read(s, report, now)


def others_seen(s: ControllerState, others: frozenset[str]) -> None:
    """Notes the daemons of the same name that are on the network, by `boot_id`."""
    if others == s.other_daemons:
        return
    s.other_daemons = others
    if others:
        s.emit("name_taken", "error", s.name_trouble, boot_ids=sorted(others))
    else:
        s.emit("name_free", "info", f"no other daemon is named {s.config.robot} any more")


def _link_changed(s: ControllerState, before: LinkState, after: LinkState) -> None:
    if after is LinkState.READY:
        s.emit("link_up", "info", "the board answers")
    elif before is LinkState.READY:
        s.emit("link_down", "warning", "the board does not answer, or its port is gone")


def _ramp_froze(s: ControllerState, report: RampReport, now: int) -> None:
    s.orders.acknowledge_fault(report.fault_count)
    if report.fault is RampFault.ESTOP:
        if s.mode is not Mode.ESTOP:
            s.estop(now, "at the ramp")
        return
    response = fault_response(report, s.order.outputs)
    if report.fault is not RampFault.STARTED or report.starts > 1:
        level: Level = "error" if s.mode in LIVE else "info"
        s.emit(response.code, level, response.text, trip=report.fault.name.lower())
    s.orders.keep_outputs(report.outputs)
    if s.mode in (*LIVE, Mode.FAULT):
        s.stops += 1
        s.transition(response.trigger, response.text, now)
        if s.mode is Mode.FAULT:
            s.add_fault(response.code, response.text, now)


def _order_read(s: ControllerState, report: RampReport, now: int) -> None:
    """The ramp has read the newest order."""
    if report.outputs != s.order.outputs and report.order_accepted:
        s.orders.keep_outputs(report.outputs)
    if not report.order_accepted and s.mode in (Mode.MOVING, Mode.ARMING):
        _order_dropped(s, report, now)
    elif s.mode is Mode.ARMING and not s.orders.arming:
        s.transition(Trigger.ALL_ON, "all servos are on", now)
    elif s.mode is Mode.MOVING and not report.moving:
        if s.orders.legs:
            s.orders.next_leg(s.departure(), now)
        elif s.orders.jog is None:
            s.transition(Trigger.ARRIVED, "arrived", now)


def _order_dropped(s: ControllerState, report: RampReport, now: int) -> None:
    """The ramp could not take the newest order."""
    s.stops += 1
    s.orders.clear()
    s.orders.keep_outputs(report.outputs)
    s.emit("order_dropped", "warning", "the ramp could not take the order: it came too late, or the link was not up")
    s.transition(Trigger.STOPPED if report.outputs else Trigger.OUTPUTS_LOST, "order dropped", now)


def tick(s: ControllerState, now: int) -> None:
    """Checks the timeouts, continues arming, ends pulses that are to be off, protects from heat."""
    expire_lease(s, now)
    drop_old_obstacles(s, now)
    jogging.continue_jog(s, now)
    if s.report.order == s.order.number:
        s.orders.switch_on_next(now)
    if s.thermal.due(now):
        thermal_protection.update(s, now)
    thermal_protection.protect(s, now)
    end_pulses(s, now)


def end_pulses(s: ControllerState, now: int) -> None:
    """Orders all pulses off again, where a fault kept the ramp from that order."""
    off = s.mode in (Mode.DISARMED, Mode.ESTOP) or not s.order.outputs
    if off and s.report.outputs and s.settled and s.report.link is LinkState.READY:
        s.orders.stop(now, 0)


def expire_lease(s: ControllerState, now: int) -> None:
    """Ends a lease that its holder did not renew, and the motion under it: before every request, in every cycle."""
    lease = s.leasehold
    s.leasehold = lease.at(now)
    if lease.held and not s.leasehold.held:
        s.emit("lease_lost", "warning", f"{lease.holder} gave no sign of life; its lease is over")
        s.stop_motion(now, LEASE_LOST)


def adopt_guard(s: ControllerState, guard: Guard, now: int, cause: str = "the new model") -> None:
    """Uses another guard, that of a new model or direction of gravity (`cause`); a motion of which it does not
    allow the rest is stopped."""
    s.guard = guard
    reconsider(s, now, cause)


def reconsider(s: ControllerState, now: int, cause: str) -> None:
    """Asks the guard, with the obstacles and the load that are known now, about a motion under way in the same way."""
    use_guard(s, s.guard_with(s.obstacles, s.load_at), now, cause)


def drop_old_obstacles(s: ControllerState, now: int) -> None:
    """Forgets the obstacles that nobody told of for too long."""
    fresh = s.obstacles.at(now)
    if fresh is s.obstacles:
        return
    for name in s.obstacles.known.keys() - fresh.known.keys():
        owner = s.obstacles.known[name].owner
        s.emit("obstacle_dropped", "warning", f"{owner} tells no more of the obstacle {name}; it is forgotten")
    s.obstacles = fresh
    reconsider(s, now, "an obstacle")


def use_guard(s: ControllerState, guard: Guard | None, now: int, cause: str) -> None:
    """Asks a guard from now on, also about the rest of a motion under way."""
    s.motion_check.guard = guard
    if s.mode is not Mode.MOVING:
        return
    under_way = Leg(s.orders.goal, s.order.stride[: len(s.position)], s.order.pace)
    try:
        s.motion_check.check_clearance(s.position, [under_way, *s.orders.legs], s.payload, s.orders.contacts)
    except LrmError as error:
        s.emit("motion_stopped", "warning", f"by {cause} the rest of the motion is not allowed: {error}")
        s.hold(now, f"{cause} does not allow the rest of the motion")
