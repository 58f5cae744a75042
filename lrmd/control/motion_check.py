"""Whether a way may be taken: nothing in it, and no hot servo worse off at its stops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lrmd.config import Config
from lrmd.control.pulses import Pulses, angles, corners, overlaid
from lrmd.errors import Refused
from lrmd.ramp.stepping import Pace, move
from lrmd.safety.collision_guard import Guard, TooClose
from lrmd.thermal.monitor import HeatWatch

Torques = Callable[[Sequence[float], float], Sequence[float]]
"""Gravity's torque (N m) on every joint for a pose (rad) and a payload (kg)."""


class WayCheck:
    """`guard` knows what is in the way, `torques` what a pose loads, `heat` which servo may not be loaded more."""

    def __init__(self, config: Config, torques: Torques, guard: Guard, heat: HeatWatch) -> None:
        self._config, self._heat = config, heat
        self.torques, self.guard = torques, guard

    def check(
        self, here: Pulses, targets: Pulses, waypoints: Sequence[Pulses], stride: int, pace: Pace, payload: float
    ) -> None:
        """Raises `Refused` for a way that collides, or that stops where a hot servo is loaded more than it is now.

        `here`: pulses (ns) now; `targets`: where the servos are on their way to, which a waypoint overrides.
        Each stretch between two corners is straight in joint space, as the guard wants it.
        """
        loads_now, goal = self.loads(here, payload), targets
        for number, waypoint in enumerate(waypoints, start=1):
            goal = overlaid(goal, waypoint)
            going = move(here, goal, (stride,) * len(here), pace)
            for stop in (going.at(k) for k in corners(self._config, going)):
                self.stretch(here, stop, number)
                here = stop
            self._heat.check(loads_now, self.loads(goal, payload))

    def stretch(self, here: Pulses, there: Pulses, number: int = 1) -> None:
        """Raises `Refused` for a straight stretch between pulses (ns) that collides, on the way to a waypoint."""
        if self._joints(here) == self._joints(there):
            return
        try:
            self.look(here, there)
        except TooClose as error:
            raise Refused(
                "collision", f"waypoint {number}: {error}", waypoint=number, bodies=[error.first, error.second],
                distance_m=error.distance, fraction=error.fraction,
            ) from None  # fmt: skip

    def look(self, here: Pulses, there: Pulses) -> None:
        """Asks the guard about a straight stretch between pulses (ns). Raises its `LrmError`."""
        self.guard(self._joints(here), self._joints(there))

    def loads(self, pulses: Pulses, payload: float) -> tuple[float, ...]:
        """Gravity's torque (N m) on every servo for pulses (ns) and a payload (kg); 0 for what is no joint."""
        tau = tuple(float(t) for t in self.torques(self._joints(pulses), payload))
        return tau + (0.0,) * (len(self._config.servos) - len(tau))

    def _joints(self, pulses: Pulses) -> list[float]:
        return angles(self._config, pulses)[: self._config.dof]
