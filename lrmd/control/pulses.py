"""Conversion between the clients' angles (rad) and the ramp's pulses (ns), with the servo limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from lrmd.config import Config, ServoConfig
from lrmd.errors import RequestError
from lrmd.ramp.shared_memory import HOLD_PULSE
from lrmd.ramp.stepping import Move

Pulses = tuple[int, ...]


def within_limits(servo: ServoConfig, pulse: int) -> int:
    """The pulse (ns). Raises `RequestError` if it is outside the servo's limits."""
    if not servo.lowest <= pulse <= servo.highest:
        low, high = sorted(servo.angle(p) for p in (servo.lowest, servo.highest))
        angle = servo.angle(pulse)
        raise RequestError(
            "limit",
            f"{servo.name}: {math.degrees(angle):.1f} deg is outside its limits "
            f"{math.degrees(low):g} to {math.degrees(high):g} deg",
            servo=servo.name, q_rad=angle, limits_rad=[low, high],
        )  # fmt: skip
    return pulse


def pulses_of(config: Config, angles: Mapping[str, float], outputs: int) -> Pulses:
    """Pulse (ns) of every servo named in `angles` (rad), `HOLD_PULSE` for the others.

    Raises `RequestError` for no angles, a servo without pulses or an angle outside the limits; `UnknownName`.
    """
    if not angles:
        raise RequestError("no_angles", f"no angles; name servos: {', '.join(config.names)}")
    pulses = [HOLD_PULSE] * len(config.servos)
    for name, angle in angles.items():
        i = armed_index(config, name, outputs)
        pulses[i] = within_limits(config.servos[i], config.servos[i].pulse_ns(angle))
    return tuple(pulses)


def angles(config: Config, pulses: Sequence[int]) -> list[float]:
    """Angle (rad) of every servo for these pulses (ns); 0 where none was ever sent."""
    return [s.angle(p) if p else 0.0 for s, p in zip(config.servos, pulses, strict=False)]


def armed_index(config: Config, name: str, outputs: int) -> int:
    """The number of a servo that has pulses. Raises `RequestError` if it has none, `UnknownName`."""
    i = config.index(name)
    if not outputs >> i & 1:
        raise RequestError("not_armed", f"{name} has no pulses; arm it first", servo=name)
    return i


def overlaid(under: Sequence[int], over: Sequence[int]) -> Pulses:
    """Pulses (ns) of `over`, those of `under` where `over` is `HOLD_PULSE`."""
    return tuple(old if new == HOLD_PULSE else new for old, new in zip(under, over, strict=True))


def corners(config: Config, ramp: Move) -> list[int]:
    """Ticks at which the path through joint space bends: a joint stops, or passes a point of its level-1 table.

    Between them all joints turn in proportion, so each segment is straight in angles, too.
    """
    found = set()
    for servo, start, distance, ticks in zip(
        config.servos[: config.dof], ramp.start, ramp.distance, ramp.ticks, strict=False
    ):
        if distance:
            passed = [(round(p * 1e9) - start) * ticks / distance for p in servo.table.pulse]
            found |= {ticks, *(round_k(k) for k in passed if 0 < k < ticks for round_k in (math.floor, math.ceil))}
    return sorted(found)
