"""Orders for the ramp, in pulses (ns) by the clients' angles (rad): the newest one, and the queue of legs behind it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from lrm_math.collision.contact import Contact
from lrmd.config import Config, ServoConfig
from lrmd.errors import RequestError
from lrmd.ramp.shared_memory import AT_ONCE, HOLD_PULSE, IMPULSES, NONE, WAITS, RampOrder
from lrmd.ramp.stepping import Impulses, Move, Pace, Waits, Way, move

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


@dataclass(frozen=True)
class Leg:
    """A part of a motion: `target` (ns, or `HOLD_PULSE`) and `stride` (ns per tick) of every servo, shaped by
    `impulses` and `waits`."""

    target: Pulses
    stride: Pulses
    pace: Pace
    impulses: Impulses = ()
    waits: Waits = ()

    def move(self, start: Pulses) -> Move:
        """The ramp's staircase along this leg from pulses (ns)."""
        return move(start, overlaid(start, self.target), self.stride, self.pace, self.impulses, self.waits)


@dataclass(frozen=True)
class Departure:
    """Beginning of a motion: at pulses `start` (ns), where `remaining` ticks of the present way are left."""

    start: Pulses
    remaining: int = 0
    way: Way = field(default_factory=Way)


@dataclass(frozen=True)
class Jog:
    """A jog under way: rates (rad/s) by servo; it ends at `until` (monotonic ns) unless it is renewed."""

    rates: Mapping[str, float]
    until: int


class OrderScheduler:
    """`newest`: the order that the ramp reads. Queued behind it: `legs` of a motion, servos (numbers) of `arming`.

    `goal`: target pulse (ns) of each servo, `HOLD_PULSE` for one that stays. `way`: what the ramp makes of the newest
    order, tick by tick. `jog`: the one under way. `contacts`: those that the motion's own request permits.
    `motions`: how many have begun.
    """

    def __init__(self, config: Config, now: int) -> None:
        self._config = config
        self._no_goal: Pulses = (HOLD_PULSE,) * len(config.servos)
        self.newest = RampOrder(stride=(config.step,) * len(config.servos), target=(HOLD_PULSE,) * 16)
        self.goal, self.way = self._no_goal, Way()
        self.legs: deque[Leg] = deque()
        self.arming: deque[int] = deque()
        self.jog: Jog | None = None
        self.contacts: tuple[Contact, ...] = ()
        self.motions = 0
        self._next_on = now

    @property
    def destination(self) -> Pulses:
        """Target pulses (ns) of the last leg."""
        return self.legs[-1].target if self.legs else self.goal

    def clear(self) -> None:
        """Empties the queue; the next order stops the servos where they are."""
        self.legs.clear()
        self.arming.clear()
        self.jog, self.contacts = None, ()
        self.goal, self.way = self._no_goal, Way()

    def issue(self, now: int, outputs: int | None = None, branch_at: int = AT_ONCE) -> None:
        """Orders the goal, with pulses for `outputs` (bits; None: as before)."""
        self.newest = replace(
            self.newest, number=(self.newest.number + 1) & 0xFFFFFFFF, heartbeat=now, target=self.goal,
            outputs=self.newest.outputs if outputs is None else outputs, after=self.newest.number, branch_at=branch_at,
        )  # fmt: skip

    def stop(self, now: int, outputs: int | None = None, pose: Pulses = NONE) -> None:
        """Orders the servos to stay where they are, with pulses for `outputs` (bits; None: as before).

        `pose`: first pulses (ns) of those that it switches on. Without one the ramp refuses to switch any on.
        """
        self.clear()
        self._shape((), ())
        self.newest = replace(self.newest, pose=pose)
        self.issue(now, outputs)

    def arm(self, pose: Pulses, outputs: int, one_by_one: Sequence[int], now: int) -> None:
        """Orders `outputs` (bits) on at their pulses (ns) in `pose`; the servos of `one_by_one` follow, staggered."""
        self.stop(now, outputs, pose)
        self.arming.extend(one_by_one)
        self._next_on = now

    def switch_on_next(self, now: int) -> None:
        """Switches on the next servo of the queue, if it is due."""
        if self.arming and now >= self._next_on:
            self._next_on = now + self._config.stagger
            self.issue(now, self.newest.outputs | 1 << self.arming.popleft())

    def departure(self, remaining: int, lead: int, position: Pulses) -> Departure:
        """Beginning of the next motion: `lead` ticks ahead on the present one, or at its end.

        `remaining`: ticks of it that were left in the ramp's last report; `position`: pulses (ns) of servos that stand.
        """
        if not remaining:
            return Departure(position)
        ticks_left, way = max(0, remaining - lead), self.way.advanced_to(remaining)
        return Departure(way.at(ticks_left), ticks_left, way)

    def start(self, legs: Sequence[Leg], departure: Departure, now: int, contacts: Sequence[Contact] = ()) -> None:
        """Moves the servos along legs from a departure, with the contacts that its request permits."""
        self.legs, self.jog, self.contacts = deque(legs), None, tuple(contacts)
        self.motions += 1
        self.next_leg(departure, now)

    def next_leg(self, departure: Departure, now: int) -> None:
        """Moves the servos along the next leg."""
        leg = self.legs.popleft()
        self.goal = leg.target
        self.way = departure.way.branch(departure.remaining, leg.move(departure.start))
        self._shape(leg.impulses, leg.waits)
        self.newest = replace(self.newest, stride=leg.stride, pace=leg.pace, pose=NONE)
        self.issue(now, branch_at=departure.remaining)

    def _shape(self, impulses: Impulses, waits: Waits) -> None:
        (delay, share), (wait_at, wait) = _rows(impulses, IMPULSES), _rows(waits, WAITS)
        self.newest = replace(self.newest, delay=delay, share=share, wait_at=wait_at, wait=wait)

    def set_heartbeat(self, now: int) -> None:
        """Renews the heartbeat."""
        self.newest = replace(self.newest, heartbeat=now)

    def acknowledge_fault(self, fault_count: int) -> None:
        """Drops all orders made before the ramp's fault number `fault_count`; later orders carry that number.

        The newest one, which the ramp may not have read yet, moves nothing and switches nothing on any more.
        """
        self.clear()
        self.newest = replace(self.newest, fault_count=fault_count, target=self.goal, pose=NONE)

    def keep_outputs(self, outputs: int) -> None:
        """Later orders keep these outputs (bits) on."""
        self.newest = replace(self.newest, outputs=outputs)


def _rows(pairs: Sequence[tuple[int, int]], room: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First and second numbers of pairs, each row filled with zeros."""
    padded = (*pairs, *((0, 0),) * (room - len(pairs)))
    return tuple(first for first, _ in padded), tuple(second for _, second in padded)
