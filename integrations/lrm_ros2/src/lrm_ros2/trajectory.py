"""A `trajectory_msgs/JointTrajectory` as waypoints of the daemon, refused in one line where it cannot be kept.

The daemon's ramp has one rate for each servo, so that of a trajectory the path is kept, and its times are bounds: no
leg takes longer than asked. Velocities, accelerations and efforts are left out of account.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from lrm_math.errors import LrmError

STALE_S = 2.0
"""s: an older trajectory is a replay, and moves nothing."""
THERE = math.radians(1.0)
"""rad: how near the arm has to be to a first point that asks for no time."""
SLOWEST = 0.01
"""Least share of the full rate."""


class ServoRates(Protocol):
    """Part of the daemon's `info` that bounds a trajectory."""

    @property
    def names(self) -> list[str]:
        """Names of the servos."""

    @property
    def rate_rad_per_s(self) -> list[float]:
        """Full rate of each (rad/s)."""


@dataclass(frozen=True)
class TrajectoryPath:
    """Waypoints (rad by servo name), and the share of the full rate at which no leg is slower than asked."""

    waypoints: tuple[Mapping[str, float], ...]
    speed: float


def asks_to_hold(message: Any) -> bool:
    """Whether a trajectory is empty, which means to stop (as for ROS's joint_trajectory_controller)."""
    return not message.points


def trajectory_path(message: Any, now: Mapping[str, float], servos: ServoRates, clock: float) -> TrajectoryPath:
    """Path of a message. `now`: where the servos are (rad), `clock`: s since 1970. Raises `LrmError`."""
    names = _names(message, servos)
    _check_age(message, clock)
    points = [_positions(point, names, k) for k, point in enumerate(message.points, start=1)]
    times = [_seconds(point.time_from_start) for point in message.points]
    begin = {name: now[name] for name in names}
    if times[0] == 0.0:
        _check_there(begin, points[0])
        points, times = points[1:], times[1:]
        if not points:
            raise LrmError("the only point asks for no time (time_from_start 0); should be later")
    if any(b <= a for a, b in zip([0.0, *times], times, strict=False)):
        raise LrmError("time_from_start does not ascend from point to point")
    rates = dict(zip(servos.names, servos.rate_rad_per_s, strict=True))
    return TrajectoryPath(tuple(points), _speed([begin, *points], [0.0, *times], rates))


def _names(message: Any, servos: ServoRates) -> Sequence[str]:
    names = list(message.joint_names)
    if unknown := next((name for name in names if name not in servos.names), None):
        raise LrmError(f"joint '{unknown}' is unknown; should be of {', '.join(servos.names)}")
    if not names or len(set(names)) != len(names):
        raise LrmError("joint_names is empty, or has a name twice")
    return names


def _check_age(message: Any, clock: float) -> None:
    stamp = _seconds(message.header.stamp)
    if stamp and abs(clock - stamp) > STALE_S:
        raise LrmError(f"its stamp is {clock - stamp:.1f} s old; should be 0 (at once), or at most {STALE_S:g} s off")


def _positions(point: Any, names: Sequence[str], number: int) -> dict[str, float]:
    values = [float(value) for value in point.positions]
    if len(values) != len(names) or not all(map(math.isfinite, values)):
        raise LrmError(f"point {number} has positions {values}; should be {len(names)} finite angles (rad)")
    return dict(zip(names, values, strict=True))


def _check_there(now: Mapping[str, float], first: Mapping[str, float]) -> None:
    for name, angle in first.items():
        if (off := abs(angle - now[name])) > THERE:
            raise LrmError(f"it begins {math.degrees(off):.1f} deg from where {name} is, and leaves it no time")


def _speed(points: Sequence[Mapping[str, float]], times: Sequence[float], rates: Mapping[str, float]) -> float:
    """The least share of the full rates at which every leg ends in time. Raises `LrmError`: more than all."""
    needed = SLOWEST
    for k in range(1, len(points)):
        for name, angle in points[k].items():
            rate = abs(angle - points[k - 1][name]) / (times[k] - times[k - 1])
            if rate > rates[name] * (1.0 + 1e-9):
                rate_deg, most = math.degrees(rate), math.degrees(rates[name])
                raise LrmError(f"point {k}: {name} would need {rate_deg:.1f} deg/s; its most is {most:.1f} deg/s")
            needed = max(needed, rate / rates[name])
    return min(needed, 1.0)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
