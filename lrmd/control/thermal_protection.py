"""Thermal protection in three steps: warn, move the arm to its rest pose, stop the pulses."""

from __future__ import annotations

from lrm_math.errors import LrmError
from lrmd.control.pulses import overlaid
from lrmd.control.state import ControllerState
from lrmd.control.state_machine import LIVE, STATIONARY, Mode, Trigger
from lrmd.ramp.shared_memory import HOLD_PULSE
from lrmd.ramp.stepping import Pace
from lrmd.safety.thermal_model import ThermalLevel


def update(s: ControllerState, now: int) -> None:
    """Updates the modelled temperatures under the torques of the present pose, and responds to changed levels."""
    torques = s.motion_check.servo_torques(s.position, s.payload)
    tau = [t if s.report.outputs >> i & 1 else 0.0 for i, t in enumerate(torques)]
    for change in s.thermal.update(now, tau):
        if change.after > change.before:
            _respond(s, change.servo, change.after, now)
        elif change.after is ThermalLevel.COOL:
            s.emit("servo_cool", "info", f"{s.config.names[change.servo]} has cooled down")


def _respond(s: ControllerState, i: int, level: ThermalLevel, now: int) -> None:
    name, T = s.config.names[i], s.thermal.temperature[i]
    text = f"{name} is at {T:.0f} degC (modelled)"
    if level is ThermalLevel.WARM:
        s.emit("servo_warm", "warning", f"{text}: no pose that loads it more is taken", servo=name)
    elif level is ThermalLevel.HOT:
        s.emit("servo_hot", "error", f"{text}: the arm goes to rest", servo=name)
        _move_to_rest(s, now)
    elif s.mode in LIVE:
        s.emit("servo_too_hot", "error", f"{text}: the pulses stop", servo=name)
        s.transition(Trigger.FAILED, text, now)
        s.add_fault("too_hot", text, now)
        s.orders.stop(now, 0)


def _move_to_rest(s: ControllerState, now: int) -> None:
    """Moves the joints that are on to the rest pose: the only motion without a request."""
    rest = s.config.rest
    if rest is None or s.mode not in (*STATIONARY, Mode.MOVING):
        return
    pulses = [HOLD_PULSE] * len(s.config.servos)
    for joint, angle in enumerate(rest):
        if s.report.outputs >> joint & 1:
            pulses[joint] = s.config.servos[joint].pulse_ns(angle)
    try:
        s.motion_check.check_clearance(s.position, overlaid(s.position, pulses))
    except LrmError as error:
        s.emit("rest_blocked", "error", f"the straight way to rest is not free: {error}; the arm stays")
        return
    s.transition(Trigger.MOVE, "a hot servo goes to rest", now)
    s.orders.clear()
    s.orders.start_move([tuple(pulses)], s.config.step, Pace.TOGETHER, now)
