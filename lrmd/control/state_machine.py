"""The daemon's finite state machine, as a transition table.

Theory of operation: the outputs are off in DISARMED and ESTOP. ARMING switches the servos on one after the other at
their present positions. ARMED and HOLDING are stationary with pulses; HOLDING means that the motion ended before its
target. FAULT follows an error; servos that still have pulses are stationary. Only a reset leaves FAULT or ESTOP, and a
reset moves nothing. A transition that is not in the table is refused.
"""

from __future__ import annotations

from enum import StrEnum

from lrmd.errors import RequestError


class Mode(StrEnum):
    """State of the state machine."""

    DISARMED = "disarmed"
    ARMING = "arming"
    ARMED = "armed"
    MOVING = "moving"
    HOLDING = "holding"
    FAULT = "fault"
    ESTOP = "estop"


class Trigger(StrEnum):
    """Input of the state machine: first the requests of clients, then internal events."""

    ARM = "arm"
    MOVE = "move"
    HOLD = "hold"
    RELAX = "relax"
    DISARM = "disarm"
    ESTOP = "estop"
    RESET_OUTPUTS_ON = "reset_fault with pulses on"
    RESET_OUTPUTS_OFF = "reset_fault with pulses off"
    ALL_ON = "all servos are on"
    ARRIVED = "arrived"
    STOPPED = "ramp stopped"
    OUTPUTS_LOST = "pulses stopped"
    FAILED = "failed"


class InvalidTransition(RequestError):
    """A trigger that the present mode does not allow; carries `mode` and `trigger`."""

    def __init__(self, mode: Mode, trigger: Trigger, why: str) -> None:
        self.mode, self.trigger = mode, trigger
        allowed = ", ".join(sorted(m for m, t in TABLE if t is trigger)) or "no mode"
        text = f"{trigger} is not allowed while {mode}{f' ({why})' if why else ''}; it is while {allowed}"
        text += "; lrm reset (reset_fault) leaves this mode" if mode in (Mode.ESTOP, Mode.FAULT) else ""
        super().__init__("wrong_mode", text, mode=mode.value)


STATIONARY = (Mode.ARMED, Mode.HOLDING)
LIVE = (Mode.ARMING, Mode.ARMED, Mode.MOVING, Mode.HOLDING)

TABLE: dict[tuple[Mode, Trigger], Mode] = {
    (Mode.DISARMED, Trigger.ARM): Mode.ARMING,
    (Mode.ARMED, Trigger.ARM): Mode.ARMING,
    (Mode.HOLDING, Trigger.ARM): Mode.ARMING,
    (Mode.ARMING, Trigger.ALL_ON): Mode.ARMED,
    (Mode.ARMING, Trigger.HOLD): Mode.HOLDING,
    (Mode.ARMED, Trigger.MOVE): Mode.MOVING,
    (Mode.HOLDING, Trigger.MOVE): Mode.MOVING,
    (Mode.MOVING, Trigger.MOVE): Mode.MOVING,
    (Mode.MOVING, Trigger.ARRIVED): Mode.ARMED,
    (Mode.MOVING, Trigger.HOLD): Mode.HOLDING,
    (Mode.ARMED, Trigger.HOLD): Mode.HOLDING,
    (Mode.HOLDING, Trigger.HOLD): Mode.HOLDING,
    (Mode.ARMED, Trigger.DISARM): Mode.DISARMED,
    (Mode.HOLDING, Trigger.DISARM): Mode.DISARMED,
    **{(mode, Trigger.STOPPED): Mode.HOLDING for mode in LIVE},
    **{(mode, Trigger.OUTPUTS_LOST): Mode.FAULT for mode in LIVE},
    **{(mode, Trigger.FAILED): Mode.FAULT for mode in (*LIVE, Mode.DISARMED, Mode.FAULT)},
    **{(mode, Trigger.RELAX): Mode.DISARMED for mode in (*LIVE, Mode.DISARMED)},
    (Mode.FAULT, Trigger.RELAX): Mode.FAULT,
    (Mode.FAULT, Trigger.OUTPUTS_LOST): Mode.FAULT,
    (Mode.FAULT, Trigger.STOPPED): Mode.FAULT,
    (Mode.FAULT, Trigger.RESET_OUTPUTS_ON): Mode.HOLDING,
    (Mode.FAULT, Trigger.RESET_OUTPUTS_OFF): Mode.DISARMED,
    (Mode.ESTOP, Trigger.RESET_OUTPUTS_OFF): Mode.DISARMED,
    **{(mode, Trigger.ESTOP): Mode.ESTOP for mode in Mode},
}


def next_mode(mode: Mode, trigger: Trigger, why: str = "") -> Mode:
    """The mode after a trigger. `why`: the reason of the present mode, for the message of a refusal.

    Raises `InvalidTransition` for what is not in the table.
    """
    try:
        return TABLE[mode, trigger]
    except KeyError:
        raise InvalidTransition(mode, trigger, why) from None
