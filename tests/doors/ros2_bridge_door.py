"""ROS 2's ways to the arm again, over the bridge in this process: many of them run side by side.

What `ros2_door` drives as processes at few instants is driven here at many: everything of the bridge but zenoh and CDR.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from lrmd.client import RequestRefused
from tests.doors.daemon_door import SimulatedArmDoor, simulated_config
from tests.doors.door import DoorKind
from tests.doors.ros2_door import ALL_GOALS, NOTHING
from tests.doors.ros2_in_process import PATIENCE_S, InProcessBridge
from tests.ros2.test_bridge import goal, point, trajectory
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

JOINTS = ("joint1", "joint2")
SLOW_S, LONGEST_STALL_S = 12.0, 0.8


class RosBridgeDoor(SimulatedArmDoor):
    """One client of ROS 2 by topic or action, and all stops; the bridge stalls meanwhile."""

    def __init__(self, bridge: InProcessBridge, seed: int) -> None:
        self._bridge, self._sim, self._rng = bridge, bridge.daemon.sim, random.Random(seed)
        self.joints: Sequence[str] = JOINTS
        self._way = self._rng.choice(["topic", "action"])
        self._shaft = [self._rng.uniform(-0.5, 0.5) for _ in JOINTS]
        self._goals = 0

    def torque_on(self) -> None:
        """The bridge does not arm: a person does, at the daemon, and says where the arm stands."""
        with self._bridge.person.control("door", take=True):
            self._bridge.person.arm("given", dict(zip(JOINTS, self._shaft, strict=True)))

    def ask(self, wish: Sequence[float]) -> None:
        there = point(SLOW_S, **dict(zip("ab", wish, strict=True)))
        if self._way == "topic":
            self._bridge.send("topic", trajectory(there))
            return
        self._goals += 1
        self._bridge.send("send_goal", goal(self._goals, there))

    def stop(self) -> None:
        how = self._rng.choice(["hold", "hold", "estop", "empty", "cancel", "hold by a person", "hold by a person"])
        if how == "hold by a person":
            with suppress(RequestRefused):  # nothing to hold
                self._bridge.person.hold()
            return
        end, message = {"empty": ("topic", trajectory()), "cancel": ("cancel_goal", ALL_GOALS)}.get(how, (how, NOTHING))
        assert self._bridge.send(end, message).wait(PATIENCE_S), f"nobody answers {how}"

    def lose_contact(self) -> None:
        """The client is frozen or killed; who sent by a topic has none, so that there the bridge is frozen."""
        if self._way == "topic":
            self._bridge.gate.shut()
            return
        self._bridge.ros.client_runs = False
        if self._rng.random() < 0.5:
            self._bridge.client(False)

    def disturb(self) -> None:
        self._bridge.gate.shut(self._rng.uniform(0.05, LONGEST_STALL_S))

    def pass_time(self, seconds: float) -> None:
        time.sleep(seconds)


@contextmanager
def bridge_door(seed: int) -> Iterator[RosBridgeDoor]:
    """A client, the bridge and a daemon."""
    sim = SimulatedDaemon(simulated_config(), seed=seed)
    sim.run(30)
    bridge = InProcessBridge(sim)
    with bridge.running():
        bridge.client(True)
        yield RosBridgeDoor(bridge, seed)


DOORS = (
    DoorKind(
        "ROS 2: the bridge in one process", ("lrm_ros2.action", "lrm_ros2.bridge", "lrm_ros2.command"), bridge_door,
        0.3, 1.0, slow=True, abreast=16,
    ),
)  # fmt: skip
