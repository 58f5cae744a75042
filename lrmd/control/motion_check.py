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
        """
        torques_now, goal = self.servo_torques(here, payload), targets
        for number, waypoint in enumerate(waypoints, start=1):
            goal = overlaid(goal, waypoint)
            try:
                here = self.check_path(here, goal, stride, pace, payload)
            except ClearanceViolation as error:
                raise _collision(error, number) from None
            self._thermal.check_load(torques_now, self.servo_torques(goal, payload))

    def check_path(self, here: Pulses, goal: Pulses, stride: int, pace: Pace, payload: float) -> Pulses:
        """Passes the ramp's path to a goal (ns) to the guard; returns its last pulses. Raises the guard's `LrmError`.

        Each segment between two corners is straight in joint space, as the guard requires.
        """
        ramp = move(here, goal, (stride,) * len(here), pace)
        for corner in (ramp.at(k) for k in corners(self._config, ramp)):
            self._check_straight(here, corner, payload)
            here = corner
        return here

    def check_jog(self, here: Pulses, ahead: Pulses, payload: float) -> None:
        """Raises `RequestError` if the straight segment between pulses (ns) collides, or the guard's `LrmError`."""
        try:
            self._check_straight(here, ahead, payload)
        except ClearanceViolation as error:
            raise _collision(error, 1) from None

    def _check_straight(self, here: Pulses, there: Pulses, payload: float) -> None:
        if self._joints(here) != self._joints(there):
            self.guard(self._joints(here), self._joints(there), payload)

    def servo_torques(self, pulses: Pulses, payload: float) -> tuple[float, ...]:
        """Gravity torque (N m) on every servo for pulses (ns) and a payload (kg); 0 for servos that are no joint."""
        tau = tuple(float(t) for t in self.torques(self._joints(pulses), payload))
        return tau + (0.0,) * (len(self._config.servos) - len(tau))

    def _joints(self, pulses: Pulses) -> list[float]:
        return angles(self._config, pulses)[: self._config.dof]


def _collision(error: ClearanceViolation, waypoint: int) -> RequestError:
    return RequestError(
        "collision", f"waypoint {waypoint}: {error}", waypoint=waypoint, bodies=[error.first, error.second],
        distance_m=error.distance, fraction=error.fraction,
    )  # fmt: skip
