"""The newest order for the ramp, and what is still to be ordered when that is done."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from lrmd.config import Config
from lrmd.control.pulses import Pulses, overlaid
from lrmd.ramp.shared_memory import HERE, Order
from lrmd.ramp.stepping import Pace


class Orders:
    """`newest` is what the ramp shall do. Of what comes after it: `waypoints` (ns) of a move, numbers of the servos in
    `arming` that wait to be switched on, and when (monotonic ns) a jog ends that is not renewed, in `jog_until`.

    `goal`: the pulse (ns) that each servo was sent to, `HERE` where it stands.
    """

    def __init__(self, config: Config, now: int) -> None:
        self._config = config
        self._nowhere: Pulses = (HERE,) * len(config.servos)
        self.newest = Order(stride=(config.step,) * len(config.servos), target=(HERE,) * 16)
        self.goal = self._nowhere
        self.waypoints: deque[Pulses] = deque()
        self.arming: deque[int] = deque()
        self.jog_until: int | None = None
        self._next_on = now

    def drop(self) -> None:
        """Forgets what was to come; the next order stops the servos where they are."""
        self.waypoints.clear()
        self.arming.clear()
        self.jog_until = None
        self.goal = self._nowhere

    def issue(self, now: int, outputs: int | None = None) -> None:
        """Orders the goal, with these servos pulsing (bits; None: as before)."""
        self.newest = replace(
            self.newest, number=(self.newest.number + 1) & 0xFFFFFFFF, heartbeat=now, target=self.goal,
            outputs=self.newest.outputs if outputs is None else outputs,
        )  # fmt: skip

    def stop(self, now: int, outputs: int | None = None) -> None:
        """Orders the servos to stay where they are, with these pulsing (bits; None: as before)."""
        self.drop()
        self.issue(now, outputs)

    def arm(self, pose: Pulses, outputs: int, one_by_one: Sequence[int], now: int) -> None:
        """Orders `outputs` (bits) on at their pulses (ns) in `pose`; the servos of `one_by_one` are to follow."""
        self.newest = replace(self.newest, pose=pose)
        self.stop(now, outputs)
        self.arming.extend(one_by_one)
        self._next_on = now

    def switch_on_next(self, now: int) -> None:
        """Switches on the next servo that waits for it, if it is time."""
        if self.arming and now >= self._next_on:
            self._next_on = now + self._config.stagger
            self.issue(now, self.newest.outputs | 1 << self.arming.popleft())

    def go(self, waypoints: Sequence[Pulses], stride: int, pace: Pace, now: int) -> None:
        """Sends the servos through waypoints (ns) with at most `stride` ns per tick."""
        self.jog_until = None
        self.waypoints = deque(waypoints)
        self.newest = replace(self.newest, stride=(stride,) * len(self.goal), pace=pace)
        self.next_waypoint(now)

    def next_waypoint(self, now: int) -> None:
        """Sends the servos to the next waypoint."""
        self.goal = overlaid(self.goal, self.waypoints.popleft())
        self.issue(now)

    def jog(self, target: Pulses, stride: Pulses, now: int) -> None:
        """Sends each servo to its target (ns) at its own stride (ns per tick) until the jog is not renewed."""
        self.waypoints.clear()
        self.jog_until = now + self._config.command
        if target != self.goal or stride != self.newest.stride:
            self.goal = target
            self.newest = replace(self.newest, stride=stride, pace=Pace.EACH)
            self.issue(now)

    def alive(self, now: int) -> None:
        """Leaves a sign of life."""
        self.newest = replace(self.newest, heartbeat=now)

    def froze(self, trips: int) -> None:
        """The ramp froze for the `trips`th time: what it was told before is void, later orders know of it."""
        self.drop()
        self.newest = replace(self.newest, trips=trips)

    def seen(self, outputs: int) -> None:
        """Later orders keep what the ramp has on (bits)."""
        self.newest = replace(self.newest, outputs=outputs)
