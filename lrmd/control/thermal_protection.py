"""What the daemon does about hot servos: it warns, then sends the arm to rest, then stops the pulses."""

from __future__ import annotations

from lrm_math.errors import LrmError
from lrmd.control.pulses import overlaid
from lrmd.control.state import Situation
from lrmd.control.state_machine import LIVE, STANDING, Mode, Trigger
from lrmd.ramp.shared_memory import HERE
from lrmd.ramp.stepping import Pace
from lrmd.thermal.model import Heat


def warm_up(s: Situation, now: int) -> None:
    """Lets the modelled temperatures go on to now, under what the pose loads, and sees to servos that got hotter."""
    loads = s.way.loads(s.position, s.payload)
    tau = [load if s.report.outputs >> i & 1 else 0.0 for i, load in enumerate(loads)]
    for change in s.heat.update(now, tau):
        if change.after > change.before:
            _hotter(s, change.servo, change.after, now)
        elif change.after is Heat.COOL:
            s.happened("servo_cool", "info", f"{s.config.names[change.servo]} has cooled down")


def _hotter(s: Situation, i: int, heat: Heat, now: int) -> None:
    name, T = s.config.names[i], s.heat.temperature[i]
    text = f"{name} is at {T:.0f} degC (modelled)"
    if heat is Heat.WARM:
        s.happened("servo_warm", "warning", f"{text}: no pose that loads it more is taken", servo=name)
    elif heat is Heat.HOT:
        s.happened("servo_hot", "error", f"{text}: the arm goes to rest", servo=name)
        _rest(s, now)
    elif s.mode in LIVE:
        s.happened("servo_too_hot", "error", f"{text}: the pulses stop", servo=name)
        s.go(Trigger.FAILED, text, now)
        s.add_fault("too_hot", text, now)
        s.orders.stop(now, 0)


def _rest(s: Situation, now: int) -> None:
    """Brings the joints that are on to the rest pose: the one motion that nobody asked for."""
    rest = s.config.rest
    if rest is None or s.mode not in (*STANDING, Mode.MOVING):
        return
    pulses = [HERE] * len(s.config.servos)
    for joint, angle in enumerate(rest):
        if s.report.outputs >> joint & 1:
            pulses[joint] = s.config.servos[joint].pulse_ns(angle)
    try:
        s.way.look(s.position, overlaid(s.position, pulses))
    except LrmError as error:
        s.happened("rest_blocked", "error", f"the straight way to rest is not free: {error}; the arm stays")
        return
    s.go(Trigger.MOVE, "a hot servo goes to rest", now)
    s.orders.drop()
    s.orders.go([tuple(pulses)], s.config.step, Pace.TOGETHER, now)
