"""A trajectory of ROS 2 as waypoints: its path kept, no leg slower than asked, all that cannot be kept refused."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lrm_math.errors import LrmError
from lrm_ros2.trajectory import asks_to_hold, trajectory_path

SERVOS = SimpleNamespace(names=["joint1", "joint2", "gripper"], rate_rad_per_s=[1.0, 0.5, 2.0])
NOW = {"joint1": 0.0, "joint2": 0.2, "gripper": 0.0}
ANGLES = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


def stamp(t: float) -> SimpleNamespace:
    return SimpleNamespace(sec=math.floor(t), nanosec=round((t - math.floor(t)) * 1e9))


def trajectory(points: list[tuple[tuple[float, ...], float]], at: float = 0.0, **other: Any) -> SimpleNamespace:
    made = [SimpleNamespace(positions=list(q), time_from_start=stamp(t)) for q, t in points]
    fields = {"header": SimpleNamespace(stamp=stamp(at)), "joint_names": ["joint1", "joint2"], "points": made}
    return SimpleNamespace(**fields | other)


@given(st.lists(st.tuples(ANGLES, st.floats(0.001, 5.0)), min_size=1, max_size=6))
def test_no_leg_is_slower_than_asked_nor_too_fast(legs: list[tuple[tuple[float, float], float]]) -> None:
    t, points, needed, before = 0.0, [], 0.0, (NOW["joint1"], NOW["joint2"])
    for q, seconds in legs:
        t = round(t + seconds, 6)
        points.append((q, t))
    last = 0.0
    for q, at in points:
        rates = [abs(b - a) / (at - last) / most for a, b, most in zip(before, q, SERVOS.rate_rad_per_s, strict=False)]
        needed, before, last = max(needed, *rates), q, at
    assume(abs(needed - 1.0) > 1e-6)
    if needed > 1.0:
        with pytest.raises(LrmError, match=r"point \d: joint\d would need .* deg/s; its most is .* deg/s"):
            trajectory_path(trajectory(points), NOW, SERVOS, 100.0)
        return
    path = trajectory_path(trajectory(points), NOW, SERVOS, 100.0)
    assert [tuple(w.values()) for w in path.waypoints] == [q for q, _ in points]
    assert path.speed == pytest.approx(max(needed, 0.01), rel=1e-6)


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (trajectory([((0.1, 0.2), 1.0)], joint_names=["joint1", "elbow"]), "joint 'elbow' is unknown; should be of"),
        (trajectory([((0.1, 0.2), 1.0)], joint_names=["joint1", "joint1"]), "has a name twice"),
        (trajectory([((0.1,), 1.0)]), r"point 1 has positions \[0.1\]; should be 2 finite angles"),
        (trajectory([((math.nan, 0.2), 1.0)]), "should be 2 finite angles"),
        (trajectory([((0.1, 0.2), 2.0), ((0.1, 0.3), 1.0)]), "time_from_start does not ascend"),
        (trajectory([((0.5, 0.2), 0.0), ((0.5, 0.3), 1.0)]), r"begins 28.6 deg from where joint1 is"),
        (trajectory([((0.0, 0.2), 0.0)]), "the only point asks for no time"),
        (trajectory([((0.1, 0.2), 1.0)], at=90.0), "its stamp is 10.0 s old"),
    ],
)
def test_what_cannot_be_kept_is_refused_in_a_line(message: SimpleNamespace, why: str) -> None:
    with pytest.raises(LrmError, match=why) as caught:
        trajectory_path(message, NOW, SERVOS, 100.0)
    assert "\n" not in str(caught.value)


def test_a_first_point_where_the_arm_stands_is_no_waypoint_and_an_empty_trajectory_asks_to_hold() -> None:
    path = trajectory_path(trajectory([((0.0, 0.2), 0.0), ((0.5, 0.2), 1.0)], at=99.5), NOW, SERVOS, 100.0)
    assert path.waypoints == ({"joint1": 0.5, "joint2": 0.2},)
    assert path.speed == pytest.approx(0.5)
    assert asks_to_hold(trajectory([]))
