"""Orders for the ramp: the newest one, and the queue of waypoints and servos behind it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from lrmd.config import Config
from lrmd.control.pulses import Pulses, overlaid
from lrmd.ramp.shared_memory import HOLD_PULSE, RampOrder
from lrmd.ramp.stepping import Pace


class OrderScheduler:
    """`newest`: the order that the ramp reads. Queued behind it: `waypoints` (ns) of a move, servos (numbers) of
    `arming`. A jog that is not renewed ends at `jog_until` (monotonic ns).

    `goal`: target pulse (ns) of each servo, `HOLD_PULSE` for one that stays.
    """

    def __init__(self, config: Config, now: int) -> None:
        self._config = config
        self._no_goal: Pulses = (HOLD_PULSE,) * len(config.servos)
        self.newest = RampOrder(stride=(config.step,) * len(config.servos), target=(HOLD_PULSE,) * 16)
        self.goal = self._no_goal
        self.waypoints: deque[Pulses] = deque()
        self.arming: deque[int] = deque()
        self.jog_until: int | None = None
        self._next_on = now

    def clear(self) -> None:
        """Empties the queue; the next order stops the servos where they are."""
        self.waypoints.clear()
        self.arming.clear()
        self.jog_until = None
        self.goal = self._no_goal

    def issue(self, now: int, outputs: int | None = None) -> None:
        """Orders the goal, with pulses for `outputs` (bits; None: as before)."""
        self.newest = replace(
            self.newest, number=(self.newest.number + 1) & 0xFFFFFFFF, heartbeat=now, target=self.goal,
            outputs=self.newest.outputs if outputs is None else outputs,
        )  # fmt: skip

    def stop(self, now: int, outputs: int | None = None) -> None:
        """Orders the servos to stay where they are, with pulses for `outputs` (bits; None: as before)."""
        self.clear()
        self.issue(now, outputs)

    def arm(self, pose: Pulses, outputs: int, one_by_one: Sequence[int], now: int) -> None:
        """Orders `outputs` (bits) on at their pulses (ns) in `pose`; the servos of `one_by_one` follow, staggered."""
        self.newest = replace(self.newest, pose=pose)
        self.stop(now, outputs)
        self.arming.extend(one_by_one)
        self._next_on = now

    def switch_on_next(self, now: int) -> None:
        """Switches on the next servo of the queue, if it is due."""
        if self.arming and now >= self._next_on:
            self._next_on = now + self._config.stagger
            self.issue(now, self.newest.outputs | 1 << self.arming.popleft())

    def start_move(self, waypoints: Sequence[Pulses], stride: int, pace: Pace, now: int) -> None:
        """Moves the servos through waypoints (ns) with at most `stride` ns per tick."""
        self.jog_until = None
        self.waypoints = deque(waypoints)
        self.newest = replace(self.newest, stride=(stride,) * len(self.goal), pace=pace)
        self.next_waypoint(now)

    def next_waypoint(self, now: int) -> None:
        """Moves the servos to the next waypoint."""
        self.goal = overlaid(self.goal, self.waypoints.popleft())
        self.issue(now)

    def jog(self, target: Pulses, stride: Pulses, now: int) -> None:
        """Moves each servo to its target (ns) at its own stride (ns per tick) while the jog is renewed."""
        self.waypoints.clear()
        self.jog_until = now + self._config.command
        if target != self.goal or stride != self.newest.stride:
            self.goal = target
            self.newest = replace(self.newest, stride=stride, pace=Pace.EACH)
            self.issue(now)

    def set_heartbeat(self, now: int) -> None:
        """Renews the heartbeat."""
        self.newest = replace(self.newest, heartbeat=now)

    def acknowledge_fault(self, fault_count: int) -> None:
        """Drops all orders made before the ramp's fault number `fault_count`; later orders carry that number."""
        self.clear()
        self.newest = replace(self.newest, fault_count=fault_count)

    def keep_outputs(self, outputs: int) -> None:
        """Later orders keep these outputs (bits) on."""
        self.newest = replace(self.newest, outputs=outputs)
