"""Torque for servos that stand somewhere: bounded before it is switched on, where they stand, for all or for none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.measuring.servo_bus.bus import NoAnswer, ServoHost
from lrm_math.arm.servo_goal import standing_goal
from lrm_math.errors import LrmError

TORQUE = 0.6
"""Share of a servo's greatest torque that it may use."""


@dataclass(frozen=True)
class JointServo:
    """Servo of a joint: its number on the bus, and its own limits (counts)."""

    joint: str
    number: int
    least: int
    greatest: int


def switch_on(host: ServoHost, servos: Sequence[JointServo]) -> None:
    """Gives each servo torque where it stands: that is its goal before, so that it does not move.

    Where one cannot be switched on, those that were limp before are limp again. Raises `NoAnswer`, or `LrmError`: a
    joint stands where its servo would not hold it. Both name the joints that have torque.
    """
    limp, begun = list(servos), list[JointServo]()
    try:
        limp = [servo for servo in servos if not host.read_with_retries(servo.number, host.kind.torque)]
        for servo in limp:
            goal_at(host, servo)
        bound_torque(host, [servo.number for servo in servos], TORQUE)
        for servo in limp:
            goal = goal_at(host, servo)
            begun.append(servo)  # some firmware switches torque on with a goal
            host.write_with_retries(servo.number, host.kind.goal, goal)
            host.write_with_retries(servo.number, host.kind.torque, 1)
    except (NoAnswer, LrmError) as error:
        held = [servo.joint for servo in servos if servo not in limp]
        unknown = released(host, begun)
        raise type(error)(f"{error}; {_with_torque(held, unknown)}") from None
    except BaseException:
        released(host, begun)
        raise


def goal_at(host: ServoHost, servo: JointServo) -> int:
    """The goal (counts) at which a servo does not move. Raises `LrmError`: it would turn to within its limits."""
    at = host.read_with_retries(servo.number, host.kind.position)
    return standing_goal(servo.joint, at, servo.least, servo.greatest)


def bound_torque(host: ServoHost, numbers: Sequence[int], share: float) -> None:
    """Bounds the torque of servos to a share of their greatest. Raises `NoAnswer`.

    That of a servo which holds is only lowered: one that was too weak for its goal would turn there with more.
    """
    for number in numbers:
        bound = round(share * host.read_with_retries(number, host.kind.most))
        if host.read_with_retries(number, host.kind.torque):
            bound = min(bound, host.read_with_retries(number, host.kind.limit))
        host.write_with_retries(number, host.kind.limit, bound)


def released(host: ServoHost, servos: Sequence[JointServo]) -> list[str]:
    """Takes the torque from servos, each whatever the others say; joints of those that do not confirm."""
    silent = []
    for servo in servos:
        try:
            host.write_with_retries(servo.number, host.kind.torque, 0)
        except (NoAnswer, LrmError):
            silent.append(servo.joint)
    return silent


def _with_torque(held: Sequence[str], unknown: Sequence[str]) -> str:
    """Joints with torque, in words."""
    words = [f"torque is on, as before, at {', '.join(held)}"] * bool(held)
    words += [f"torque may be on at {', '.join(unknown)}"] * bool(unknown)
    return ", and ".join(words) or "no joint has torque"
