"""Thermal protection by the present level of the servos with pulses: warn, move the arm to rest, stop the pulses.

It follows from the level alone, in every cycle: how a servo got hot, and in which mode the arm is, make no difference.
But a reset moves nothing: a hot arm goes to rest only after somebody has asked for another motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from lrm_math.errors import LrmError
from lrmd.config import SECOND
from lrmd.control.ramp_orders import Leg, Pulses, overlaid
from lrmd.control.state import ControllerState
from lrmd.control.state_machine import STATIONARY, Mode, Trigger
from lrmd.errors import RequestError
from lrmd.ramp.shared_memory import HOLD_PULSE
from lrmd.ramp.stepping import Pace
from lrmd.safety.thermal_model import LevelChange, ThermalLevel

HOLD_TIME = 10 * SECOND
"""ns for which a `hold` keeps a hot arm where it is: somebody may be in its way to rest."""
RETRY = SECOND
"""ns between two attempts of a hot arm whose way to rest is not free."""


def update(s: ControllerState, now: int) -> None:
    """Updates the modelled temperatures under the torques of the present pose, and reports changed levels."""
    torques = s.motion_check.servo_torques(s.position, s.payload)
    tau = [t if s.report.outputs >> i & 1 else 0.0 for i, t in enumerate(torques)]
    for change in s.thermal.update(now, tau):
        _report(s, change)


def _report(s: ControllerState, change: LevelChange) -> None:
    name, text = s.config.names[change.servo], _temperature(s, change.servo)
    if change.after is ThermalLevel.COOL:
        s.emit("servo_cool", "info", f"{name} has cooled down")
    elif change.after < change.before:
        return
    elif change.after is ThermalLevel.WARM:
        s.emit("servo_warm", "warning", f"{text}: no pose that loads it more is taken", servo=name)
    elif change.after is ThermalLevel.HOT:
        s.emit("servo_hot", "error", f"{text}: the arm goes to rest", servo=name)
    else:
        s.emit("servo_too_hot", "error", f"{text}: the pulses stop until it is cooler", servo=name)


def _temperature(s: ControllerState, servo: int) -> str:
    return f"{s.config.names[servo]} is at {s.thermal.temperature[servo]:.0f} degC (modelled)"


def protect(s: ControllerState, now: int) -> None:
    """Responds to the level of the hottest servo that has pulses, or is about to."""
    hottest = s.thermal.hottest(s.report.outputs | s.order.outputs)
    level = ThermalLevel.COOL if hottest is None else s.thermal.level(hottest)
    if hottest is not None and level is ThermalLevel.TOO_HOT:
        _stop_pulses(s, hottest, now)
    elif level is ThermalLevel.HOT:
        _go_to_rest(s, now)
    else:
        s.rest_blocked, s.reset_at = False, None


def after_reset(s: ControllerState) -> None:
    """Lets a hot arm whose fault was reset stand until somebody asks for a motion."""
    s.reset_at = s.orders.motions
    hottest = s.thermal.hottest(s.report.outputs)
    if hottest is not None and s.config.rest is not None and s.thermal.level(hottest) is ThermalLevel.HOT:
        limit = s.thermal.model.limits[ThermalLevel.TOO_HOT - 1]
        text = f"{_temperature(s, hottest)}: a reset does not send the arm to rest; move it, at {limit:g} degC it falls"
        s.emit("rest_waits", "warning", text, servo=s.config.names[hottest])


def _waits_after_reset(s: ControllerState) -> bool:
    return s.reset_at == s.orders.motions


def _stop_pulses(s: ControllerState, hottest: int, now: int) -> None:
    """Orders all pulses off, unless such an order is on its way."""
    if not s.order.outputs and s.report.order != s.order.number:
        return
    text = _temperature(s, hottest)
    if s.mode is not Mode.ESTOP:
        s.stops += 1
        s.transition(Trigger.FAILED, text, now)
        s.add_fault("too_hot", text, now)
    s.orders.stop(now, 0)


def _go_to_rest(s: ControllerState, now: int) -> None:
    """Moves the joints that are on to the rest pose: the only motion without a request."""
    held = s.held_at is not None and now - s.held_at < HOLD_TIME
    waits = s.rest_blocked and now - s.rest_tried_at < RETRY
    rest = _rest_pulses(s)
    if rest is None or held or waits or _waits_after_reset(s) or s.going_to_rest:
        return
    if s.mode not in (*STATIONARY, Mode.MOVING):
        return
    if not s.settled or (s.position == overlaid(s.position, rest) and s.mode is not Mode.MOVING):
        return
    s.rest_tried_at, departure = now, s.departure()
    leg = Leg(rest, (s.config.step,) * len(rest), Pace.TOGETHER)
    try:
        s.motion_check.check_clearance(departure.start, [leg], s.payload)
    except LrmError as error:
        if not s.rest_blocked:
            s.emit("rest_blocked", "error", f"the straight way to rest is not free: {error}; it is not taken")
        s.rest_blocked = True
        return
    s.rest_blocked, s.rest_goal = False, rest
    s.transition(Trigger.MOVE, "a hot servo goes to rest", now)
    s.orders.start([leg], departure, now)


def _rest_pulses(s: ControllerState) -> Pulses | None:
    """Pulses (ns) of the rest pose for the joints that are on; None if no rest pose is configured."""
    if s.config.rest is None:
        return None
    pulses = [HOLD_PULSE] * len(s.config.servos)
    for joint, angle in enumerate(s.config.rest):
        if s.report.outputs >> joint & 1:
            pulses[joint] = s.config.servos[joint].pulse_ns(angle)
    return tuple(pulses)


def check_motion(s: ControllerState) -> None:
    """Raises `RequestError` while the arm is hot, since it goes to rest instead; not if its way to rest is blocked, or
    it stands after a reset."""
    hottest = s.thermal.hottest(s.report.outputs)
    stays = s.config.rest is None or s.rest_blocked or _waits_after_reset(s)
    if hottest is None or stays or s.thermal.level(hottest) < ThermalLevel.HOT:
        return
    limit = s.thermal.model.limits[ThermalLevel.HOT - 1]
    text = f"{_temperature(s, hottest)}: the arm goes to rest, and stays there until it is below {limit:g} degC"
    raise RequestError("too_warm", text, retryable=True, servo=s.config.names[hottest])


def check_arming(s: ControllerState, servos: Iterable[int]) -> None:
    """Raises `RequestError` if a servo that is to be switched on is so hot that the arm would go to rest at once, or,
    without a rest pose, too hot; it says when it will be cool enough."""
    hottest = s.thermal.hottest(sum(1 << i for i in servos))
    most = ThermalLevel.TOO_HOT if s.config.rest is None else ThermalLevel.HOT
    if hottest is None or s.thermal.level(hottest) < most:
        return
    limit = s.thermal.model.limits[most - 1]
    seconds = s.thermal.cooling_time(hottest, limit)
    left = f"{math.ceil(seconds)} s" if seconds < 120 else f"{math.ceil(seconds / 60)} min"
    text = f"{_temperature(s, hottest)}: too hot to be switched on; it is cool enough, below {limit:g} degC, in {left}"
    raise RequestError("too_warm", text, retryable=True, servo=s.config.names[hottest], seconds=seconds)
