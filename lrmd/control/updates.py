"""What comes by itself: because of what the ramp says, or because time passes."""

from __future__ import annotations

from lrm_math.errors import LrmError
from lrmd.control import thermal_protection
from lrmd.control.events import Level
from lrmd.control.ramp_faults import consequence
from lrmd.control.state import Situation
from lrmd.control.state_machine import LIVE, Mode, Trigger
from lrmd.errors import Refused
from lrmd.ramp.shared_memory import LinkState, Report, Trip

SECOND = 1_000_000_000
LOOK_AHEAD = SECOND // 4
"""ns: how far ahead of a jog nothing may be in the way."""


# ---- what the ramp says


def observe(s: Situation, report: Report, now: int) -> None:
    """Takes in what the ramp says."""
    before, s.report = s.report, report
    if report.link is not before.link:
        _link_changed(s, before.link, report.link)
    if report.port_error not in (0, before.port_error):
        s.happened("port_refused", "warning", s.port_trouble)
    if report.trips != s.order.trips:
        _tripped(s, report, now)
    elif report.order == s.order.number:
        _followed(s, report, now)


def _link_changed(s: Situation, before: LinkState, after: LinkState) -> None:
    if after is LinkState.READY:
        s.happened("link_up", "info", "the board answers")
    elif before is LinkState.READY:
        s.happened("link_down", "warning", "the board does not answer, or its port is gone")


def _tripped(s: Situation, report: Report, now: int) -> None:
    """The ramp froze."""
    s.orders.froze(report.trips)
    if report.trip is Trip.ESTOP:
        if s.mode is not Mode.ESTOP:
            s.estop(now, "at the ramp")
        return
    what = consequence(report, s.order.outputs)
    if report.trip is not Trip.STARTED or report.starts > 1:
        level: Level = "error" if s.mode in LIVE else "info"
        s.happened(what.code, level, what.text, trip=report.trip.name.lower())
    s.orders.seen(report.outputs)
    if s.mode in (*LIVE, Mode.FAULT):
        s.go(what.trigger, what.text, now)
        if s.mode is Mode.FAULT:
            s.add_fault(what.code, what.text, now)


def _followed(s: Situation, report: Report, now: int) -> None:
    """The ramp has read the newest order."""
    if report.outputs != s.order.outputs and report.taken:
        s.orders.seen(report.outputs)
    if not report.taken and s.mode in (Mode.MOVING, Mode.ARMING):
        _dropped(s, report, now)
    elif s.mode is Mode.ARMING and not s.orders.arming:
        s.go(Trigger.ALL_ON, "all servos are on", now)
    elif s.mode is Mode.MOVING and not report.moving and s.orders.jog_until is None:
        if s.orders.waypoints:
            s.orders.next_waypoint(now)
        else:
            s.go(Trigger.ARRIVED, "arrived", now)


def _dropped(s: Situation, report: Report, now: int) -> None:
    """The ramp could not take the newest order."""
    s.orders.drop()
    s.orders.seen(report.outputs)
    s.happened("order_dropped", "warning", "the ramp could not take the order: the link was not up")
    s.go(Trigger.STOPPED if report.outputs else Trigger.OUTPUTS_LOST, "order dropped", now)


# ---- time


def tick(s: Situation, now: int) -> None:
    """What happens because time passes. Leaves a sign of life in the order."""
    _watch_lease(s, now)
    _watch_jog(s, now)
    if s.report.order == s.order.number:
        s.orders.switch_on_next(now)
    if s.heat.due(now):
        thermal_protection.warm_up(s, now)
    s.orders.alive(now)


def _watch_lease(s: Situation, now: int) -> None:
    if s.lease is not None and now >= s.lease.until:
        s.happened("lease_lost", "warning", f"{s.lease.holder} gave no sign of life; its lease is over")
        s.lease = None
        s.stop_motion(now, "lease lost")


def _watch_jog(s: Situation, now: int) -> None:
    until = s.orders.jog_until
    if until is not None and now >= until:
        s.happened("command_watchdog", "warning", "the jog was not renewed; holding")
        s.stop_motion(now, "jog not renewed")
    elif until is not None and now >= s.looked_ahead + LOOK_AHEAD // 3:
        s.looked_ahead = now
        _look_ahead(s, now)


def _look_ahead(s: Situation, now: int) -> None:
    """Stops a jog before it comes too close to anything."""
    reach = [LOOK_AHEAD // s.config.tick * stride for stride in s.order.stride]
    ahead = tuple(min(max(g, p - r), p + r) for g, p, r in zip(s.targets, s.position, reach, strict=False))
    try:
        s.way.stretch(s.position, ahead)
    except LrmError as error:
        detail = error.detail if isinstance(error, Refused) else {}
        s.happened("jog_stopped", "warning", str(error), **detail)
        s.stop_motion(now, "a collision ahead")
