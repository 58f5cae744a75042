"""Facts that the ramp knows of the board and its servos: channels, limits, PWM clock and timeouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class ServoOutput:
    """A servo's `channel` of the board, lowest and highest pulse (ns)."""

    channel: int
    lowest: int
    highest: int


@dataclass(frozen=True)
class BoardSettings:
    """Servos, PWM clock and limits of the board. `step`: largest pulse change per tick, ns; `count_s`: s of a count.

    `reply`: timeout, ns, of which one late tick counts at most half, since it may come before the reply.
    `pause`: ns without a frame of our own after which the handshake is repeated.
    `simulated`: the ramp's clock is not real time, so only a simulated board is accepted.
    """

    servos: tuple[ServoOutput, ...]
    prescale: int
    count_s: float
    step: int
    reply: int
    pause: int
    silence_ms: int
    simulated: bool = False

    def counts(self, outputs: int, position: Sequence[int]) -> tuple[int, ...]:
        """OFF count per servo: its pulse `position` (ns) rounded to counts, 0 where its bit of `outputs` is clear."""
        per_ns = 1e-9 / self.count_s
        return tuple(int(p * per_ns + 0.5) if outputs >> i & 1 else 0 for i, p in enumerate(position))

    def pulse(self, count: int) -> int:
        """Pulse width (ns) of a count."""
        return round(count * self.count_s * 1e9)
