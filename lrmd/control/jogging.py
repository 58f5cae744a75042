"""Jogs: turning servos at given rates, stretch by stretch, each checked before the ramp gets it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lrm_math.errors import LrmError
from lrmd.config import SECOND, Config
from lrmd.control import thermal_protection
from lrmd.control.ramp_orders import Jog, Leg, Pulses, armed_index
from lrmd.control.state import ControllerState, RequestResult
from lrmd.control.state_machine import Trigger, next_mode
from lrmd.errors import RequestError
from lrmd.messages.control import JogRequest
from lrmd.ramp.shared_memory import HOLD_PULSE
from lrmd.ramp.stepping import Pace

HORIZON = SECOND // 4
"""ns: a jog is checked and ordered so far ahead, again when two thirds of it are left."""


def request_jog(s: ControllerState, request: JogRequest, now: int) -> RequestResult:
    """Begins or renews a jog, which lives from when it was asked for. Raises `LrmError` if its first stretch is not
    allowed."""
    next_mode(s.mode, Trigger.MOVE, s.why)
    thermal_protection.check_motion(s)
    rates = {name: rate for name, rate in request.rate_rad_per_s.items() if rate}
    if s.orders.jog is None or s.orders.jog.rates != rates:
        departure = s.departure()
        leg = _leg(s, request.rate_rad_per_s, departure.start, HORIZON // s.config.tick)
        s.motion_check.check_clearance(departure.start, [leg], s.payload)
        s.transition(Trigger.MOVE, "jog", now)
        s.orders.start([leg], departure, now)
    s.orders.jog = Jog(rates, s.came + s.config.command)
    return RequestResult()


def continue_jog(s: ControllerState, now: int) -> None:
    """Ends a jog that was not renewed; orders the next stretch of another, or stops it where that is not allowed."""
    jog, ticks = s.orders.jog, HORIZON // s.config.tick
    if jog is None:
        return
    if now >= jog.until:
        s.emit("command_watchdog", "warning", "the jog was not renewed; holding")
        s.stop_motion(now, "jog not renewed")
        return
    if not s.settled or 3 * s.report.remaining > 2 * ticks:
        return
    departure = s.orders.departure(s.report.remaining, s.report.remaining, s.position)
    try:
        leg = _leg(s, jog.rates, departure.start, ticks - s.report.remaining)
        s.motion_check.check_clearance(departure.start, [leg], s.payload)
    except LrmError as error:
        detail = error.detail if isinstance(error, RequestError) else {}
        s.emit("jog_stopped", "warning", str(error), **detail)
        s.stop_motion(now, "the jog may not go on")
        return
    if leg.move(departure.start).length:
        s.orders.start([leg], departure, now)
        s.orders.jog = jog


def _leg(s: ControllerState, rates: Mapping[str, float], start: Pulses, ticks: int) -> Leg:
    """Leg of so many ticks at rates (rad/s) by servo from pulses (ns), or up to the limits. Raises `LrmError`."""
    config = s.config
    target, stride = [HOLD_PULSE] * len(config.servos), [config.step] * len(config.servos)
    for name, rate in rates.items():
        i = armed_index(config, name, s.report.outputs)
        if rate:
            servo, change = config.servos[i], _change_per_tick(config, i, start[i], rate)
            stride[i] = max(1, round(abs(change)))
            ahead = start[i] + round(math.copysign(stride[i] * ticks, change))
            target[i] = min(max(ahead, servo.lowest), servo.highest)
    return Leg(tuple(target), tuple(stride), Pace.EACH)


def _change_per_tick(config: Config, i: int, here: int, rate: float) -> float:
    """Change of the pulse (ns per tick) of servo `i` at pulse `here` (ns) for a rate (rad/s). Raises `RequestError`."""
    servo, ahead = config.servos[i], math.copysign(0.01, rate)
    change = (servo.pulse_ns(servo.angle(here) + ahead) - here) / ahead * rate * config.tick / SECOND
    if abs(change) > config.step:
        fastest = math.degrees(abs(rate) * config.step / abs(change))
        text = f"{servo.name}: {math.degrees(abs(rate)):.1f} deg/s; at most {fastest:.1f} deg/s"
        raise RequestError("too_fast", text)
    return change
