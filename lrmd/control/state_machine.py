"""The daemon's state machine, as a table.

Theory of operation: the outputs are off in DISARMED and ESTOP. ARMING switches one servo on after the other where it
stands. ARMED and HOLDING both stand still with pulses; HOLDING says that something else than arrival ended the motion.
FAULT is entered by what the daemon did not ask for; whatever still has pulses stands still. Nothing leaves FAULT or
ESTOP but a reset, and a reset moves nothing. What is not in the table is refused.
"""

from __future__ import annotations

from enum import StrEnum

from lrm_math.errors import LrmError


class Mode(StrEnum):
    """Where the daemon is."""

    DISARMED = "disarmed"
    ARMING = "arming"
    ARMED = "armed"
    MOVING = "moving"
    HOLDING = "holding"
    FAULT = "fault"
    ESTOP = "estop"


class Trigger(StrEnum):
    """What may happen to it: first what clients ask for, then what comes by itself."""

    ARM = "arm"
    MOVE = "move"
    HOLD = "hold"
    RELAX = "relax"
    DISARM = "disarm"
    ESTOP = "estop"
    RESET_STANDING = "reset_fault with pulses on"
    RESET_LIMP = "reset_fault with pulses off"
    ALL_ON = "all servos are on"
    ARRIVED = "arrived"
    STOPPED = "stopped by itself"
    OUTPUTS_LOST = "pulses stopped"
    FAILED = "failed"


class NotAllowed(LrmError):
    """A request that the present mode does not take; carries `mode` and `trigger`."""

    def __init__(self, mode: Mode, trigger: Trigger) -> None:
        self.mode, self.trigger = mode, trigger
        allowed = ", ".join(sorted(m for m, t in TABLE if t is trigger)) or "no mode"
        super().__init__(f"{trigger} is not allowed while {mode}; it is while {allowed}")


STANDING = (Mode.ARMED, Mode.HOLDING)
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
    (Mode.FAULT, Trigger.RESET_STANDING): Mode.HOLDING,
    (Mode.FAULT, Trigger.RESET_LIMP): Mode.DISARMED,
    (Mode.ESTOP, Trigger.RESET_LIMP): Mode.DISARMED,
    **{(mode, Trigger.ESTOP): Mode.ESTOP for mode in Mode},
}


def follow(mode: Mode, trigger: Trigger) -> Mode:
    """The mode after a trigger. Raises `NotAllowed` for what is not in the table."""
    try:
        return TABLE[mode, trigger]
    except KeyError:
        raise NotAllowed(mode, trigger) from None
