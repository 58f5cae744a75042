"""Check of a commanded motion: no collision on the path, and no more load on a hot servo at its waypoints."""

from __future__ import annotations

from collections.abc import Sequence

from lrmd.config import Config
from lrmd.control.pulses import Pulses, angles, corners, overlaid
from lrmd.errors import RequestError
from lrmd.ramp.stepping import Pace, move
from lrmd.safety.collision_guard import ClearanceViolation, Guard
from lrmd.safety.thermal_model import Torques
from lrmd.safety.thermal_monitor import ThermalMonitor


class MotionCheck:
    """`guard` checks clearances, `torques` gives the joint torques of a pose, `thermal` the temperatures."""

    def __init__(self, config: Config, torques: Torques, guard: Guard, thermal: ThermalMonitor) -> None:
        self._config, self._thermal = config, thermal
        self.torques, self.guard = torques, guard

    def check(
        self, here: Pulses, targets: Pulses, waypoints: Sequence[Pulses], stride: int, pace: Pace, payload: float
    ) -> None:
        """Raises `RequestError` for a path that collides, or a waypoint that loads a hot servo more than now.

        `here`: pulses (ns) now; `targets`: pulses (ns) of the motion under way, which a waypoint overrides.
        Each segment between two corners is straight in joint space, as the guard requires.
        """
        torques_now, goal = self.servo_torques(here, payload), targets
        for number, waypoint in enumerate(waypoints, start=1):
            goal = overlaid(goal, waypoint)
            ramp = move(here, goal, (stride,) * len(here), pace)
            for corner in (ramp.at(k) for k in corners(self._config, ramp)):
                self.check_segment(here, corner, number)
                here = corner
            self._thermal.check_load(torques_now, self.servo_torques(goal, payload))

    def check_segment(self, here: Pulses, there: Pulses, number: int = 1) -> None:
        """Raises `RequestError` if a straight segment between pulses (ns), before waypoint `number`, collides."""
        if self._joints(here) == self._joints(there):
            return
        try:
            self.check_clearance(here, there)
        except ClearanceViolation as error:
            raise RequestError(
                "collision", f"waypoint {number}: {error}", waypoint=number, bodies=[error.first, error.second],
                distance_m=error.distance, fraction=error.fraction,
            ) from None  # fmt: skip

    def check_clearance(self, here: Pulses, there: Pulses) -> None:
        """Passes a straight segment between pulses (ns) to the guard. Raises its `LrmError`."""
        self.guard(self._joints(here), self._joints(there))

    def servo_torques(self, pulses: Pulses, payload: float) -> tuple[float, ...]:
        """Gravity torque (N m) on every servo for pulses (ns) and a payload (kg); 0 for servos that are no joint."""
        tau = tuple(float(t) for t in self.torques(self._joints(pulses), payload))
        return tau + (0.0,) * (len(self._config.servos) - len(tau))

    def _joints(self, pulses: Pulses) -> list[float]:
        return angles(self._config, pulses)[: self._config.dof]
