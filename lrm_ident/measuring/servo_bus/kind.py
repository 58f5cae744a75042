"""Facts that a bus has to know of a kind of servos: how their packets are written, and which registers do what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lrm_ident.measuring.servo_bus.packets import Packet
from lrm_ident.measuring.servo_bus.register import Register


@dataclass(frozen=True)
class BusServoKind:
    """A kind of servos of 4096 counts a turn.

    Attributes:
        prefix: of its name in `--robot`. baud: usual bits per second. models: names by model number.
        modes: those that go to angles. last_read: registers below say all of a servo's settings and state.
        limit: register that bounds its torque until it is switched on anew; most: that of its greatest value.
    """

    prefix: str
    packet: type[Packet]
    baud: int
    models: Mapping[int, str]
    modes: tuple[int, ...]
    last_read: int
    model: Register
    mode: Register
    least: Register
    greatest: Register
    torque: Register
    goal: Register
    position: Register
    temperature: Register
    limit: Register
    most: Register
