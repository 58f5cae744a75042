"""A cancel of all goals also stops what the door has taken and does not follow yet; over the bridge in this process."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from tests.doors.daemon_door import simulated_config
from tests.doors.ros2_door import ALL_GOALS
from tests.doors.ros2_in_process import PATIENCE_S, InProcessBridge
from tests.ros2.test_bridge import goal, point, trajectory
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

FAR = point(12.0, a=0.4, b=0.3)
HERE = {"joint1": 0.0, "joint2": 0.0}


@pytest.fixture
def bridge() -> Iterator[InProcessBridge]:
    sim = SimulatedDaemon(simulated_config())
    sim.run(30)
    bridge = InProcessBridge(sim)
    with bridge.running():
        bridge.client(True)
        with bridge.person.control("person"):
            bridge.person.arm("given", HERE)
        yield bridge


def stands(bridge: InProcessBridge) -> None:
    assert bridge.send("cancel_goal", ALL_GOALS).wait(PATIENCE_S)
    time.sleep(0.3)
    before = bridge.person.joints().pulse_us
    time.sleep(0.7)
    assert bridge.person.joints().pulse_us == before
    assert bridge.person.mode().mode in ("armed", "holding")


def test_a_goal_that_was_offered_before_others_that_were_refused(bridge: InProcessBridge) -> None:
    for number in (1, 2, 3):
        bridge.send("send_goal", goal(number, FAR))
    time.sleep(0.01)
    stands(bridge)


@pytest.mark.long
def test_a_trajectory_of_the_topic_that_is_followed(bridge: InProcessBridge) -> None:
    bridge.send("topic", trajectory(FAR))
    end = time.monotonic() + PATIENCE_S
    while not bridge.person.joints().moving and time.monotonic() < end:
        time.sleep(0.02)
    assert bridge.person.joints().moving
    stands(bridge)
