"""Replies of a LeRobot robot's servos that came after their time: dropped, not taken for the answer to what is asked
next. A servo's packets have no number: what comes after the next request cannot be told from its answer."""

from __future__ import annotations

from typing import Any


def drop_late_replies(robot: Any) -> None:
    """Lets each request of a robot's bus begin with an empty input.

    The servo makers' kits call `clearPort` before each request, and theirs only waits for the output. After one late
    reply LeRobot tries again by itself and takes the late one for the answer: each later reading is then that of the
    request before, and nothing says so. Robots without such a bus are left as they are.
    """
    port = getattr(getattr(robot, "bus", None), "port_handler", None)
    wait_for_output = getattr(port, "clearPort", None)
    if port is None or wait_for_output is None:
        return

    def clear() -> None:
        wait_for_output()
        port.ser.reset_input_buffer()

    port.clearPort = clear
