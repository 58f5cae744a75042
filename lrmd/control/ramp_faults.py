"""What follows for the daemon from a ramp that froze."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lrmd.control.state_machine import Trigger
from lrmd.ramp.shared_memory import Report, Trip


@dataclass(frozen=True)
class Consequence:
    """The state machine's trigger, and the code and text that it is told with."""

    trigger: Trigger
    code: str
    text: str


TRIPS = {
    Trip.STARTED: Consequence(
        Trigger.STOPPED, "ramp_restarted", "the ramp process was started anew; the arm stands still"
    ),
    Trip.LINK_LOST: Consequence(Trigger.FAILED, "link_lost", "the board does not answer"),
    Trip.BOARD_RESTARTED: Consequence(
        Trigger.OUTPUTS_LOST, "board_restarted", "the board lost its power; the arm is limp"
    ),
    Trip.BOARD_SILENCED: Consequence(
        Trigger.OUTPUTS_LOST, "board_silenced", "the board stopped its pulses; the arm is limp"
    ),
    Trip.API_SILENT: Consequence(
        Trigger.STOPPED, "api_silent", "the ramp had no sign of life of the daemon and stopped"
    ),
    Trip.REFUSED: Consequence(
        Trigger.FAILED, "order_refused", "the ramp refused an order outside the limits: a software fault"
    ),
}
"""Every trip but the emergency stop, which is asked for."""


def consequence(report: Report, ordered: int) -> Consequence:
    """What follows from the report's trip, where `ordered` outputs should have been on: a stop may have lost them."""
    found = TRIPS[report.trip]
    if found.trigger is Trigger.STOPPED and ordered and not report.outputs:
        return replace(found, trigger=Trigger.OUTPUTS_LOST)
    return found
