"""ROS 2's ways to the arm, over the bridge as a process between a real daemon and a zenoh router of ROS 2's own.

One daemon and one bridge serve all sequences of a run; each begins with the arm at home and armed anew.
"""

from __future__ import annotations

import atexit
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

import pytest

from lrm_math.errors import LrmError
from lrm_ros2.action_types import CANCEL_GOAL, SEND_GOAL, TRIGGER
from lrm_ros2.message_types import JOINT_TRAJECTORY
from lrmd.client import RequestRefused, Rover
from tests.doors.door import Angles, DoorKind
from tests.ros2.test_bridge import ACTION, RosPeer, bridged, goal, point, ros_router, said, trajectory
from tests.support.daemon.daemon_harness import HOME, wait_for_link
from tests.support.daemon.daemon_process import COOL, SLOW_BOARD, DaemonSetup, free_port, running_daemon, wait_for

JOINTS = ("joint1", "joint2")
NOTHING = {"structure_needs_at_least_one_member": 0}
ALL_GOALS = {"goal_info": {"goal_id": {"uuid": [0] * 16}, "stamp": {"sec": 0, "nanosec": 0}}}
SLOW_S = 12.0
"""s that every trajectory may take, so that it lasts longer than a sequence."""


class RosStack:
    """Daemon, router, bridge, and whoever looks at the daemon."""

    def __init__(self, running: ExitStack) -> None:
        folder = Path(running.enter_context(tempfile.TemporaryDirectory()))
        setup, self.port = DaemonSetup.make(folder, SLOW_BOARD | COOL), free_port()
        running.enter_context(running_daemon(setup))
        self.rover: Rover = running.enter_context(setup.rover())
        self.peer: RosPeer = running.enter_context(ros_router(self.port))
        wait_for_link(self.rover)
        self.bridge = running.enter_context(bridged(setup, self.port, folder / "bridge.log", "--trajectories"))
        self.goals, self._wakes = 0, threading.Timer(0.0, lambda: None)

    def stall(self, seconds: float | None) -> None:
        """Freezes the bridge for some seconds, or for good, and comes back."""
        self._wakes.cancel()
        self.bridge.send_signal(signal.SIGSTOP)
        if seconds is not None:
            self._wakes = threading.Timer(seconds, self.bridge.send_signal, (signal.SIGCONT,))
            self._wakes.start()

    def wake(self) -> None:
        """Wakes the bridge."""
        self._wakes.cancel()
        self.bridge.send_signal(signal.SIGCONT)

    def ready(self) -> None:
        """Pulses off and nothing followed."""
        wait_for(lambda: "following" not in said(self.peer, "lrm bridge: trajectory")[1], "the last one has ended", 20)
        with self.rover.control("door", take=True):
            if self.rover.mode().mode in ("fault", "estop"):
                self.rover.reset_fault()
            self.rover.relax()


_RUNNING = ExitStack()


@cache
def _stack() -> RosStack:
    atexit.register(end)
    return RosStack(_RUNNING)


def end() -> None:
    """Ends daemon, router and bridge, where they run: pytest-xdist's workers run nothing that `atexit` registered."""
    _RUNNING.close()
    _stack.cache_clear()


class RosDoor:
    """One client of ROS 2, a process of its own: topic and action, and all stops."""

    def __init__(self, stack: RosStack, client: subprocess.Popen[bytes], seed: int) -> None:
        self._stack, self._client, self._rng = stack, client, random.Random(seed)
        self.joints: Sequence[str] = JOINTS
        self._way = self._rng.choice(["topic", "action"])

    def torque_on(self) -> None:
        """The bridge does not arm: a person does, at the daemon, and says where the arm stands."""
        state = self._stack.rover.joints()
        with self._stack.rover.control("door"):
            self._stack.rover.arm("given", dict(zip(list(HOME), state.q_rad, strict=False)))

    def ask(self, wish: Sequence[float]) -> None:
        there = point(SLOW_S, **dict(zip("ab", wish, strict=True)))
        if self._way == "topic":
            self._stack.peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory(there))
            return
        self._stack.goals += 1
        number = goal(1 + self._stack.goals % 250, there)
        number["goal_id"]["uuid"][1] = self._stack.goals // 250
        self._stack.peer.ask(f"{ACTION}/send_goal", SEND_GOAL, number)

    def stop(self) -> None:
        """By ROS, or by somebody at the daemon."""
        ways = ["hold", "hold", "estop", "empty", "cancel", "hold by a person", "hold by a person"]
        peer, how = self._stack.peer, self._rng.choice(ways)
        if how == "empty":
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory())
        elif how == "hold by a person":
            with suppress(RequestRefused):  # nothing to hold
                self._stack.rover.hold()
        elif how == "cancel" and self._way == "action":
            peer.call(f"{ACTION}/cancel_goal", CANCEL_GOAL, ALL_GOALS)
        else:
            peer.call("hold" if how != "estop" else how, TRIGGER, NOTHING)

    def lose_contact(self) -> None:
        """The client is frozen or killed; who sent by a topic has none, so that there the bridge is killed off."""
        if self._way == "action":
            self._client.send_signal(self._rng.choice([signal.SIGSTOP, signal.SIGKILL]))
        else:
            self._stack.stall(None)

    def disturb(self) -> None:
        """What is asked meanwhile waits in the bridge."""
        self._stack.stall(self._rng.uniform(0.05, 0.8))

    def pass_time(self, seconds: float) -> None:
        time.sleep(seconds)

    def commanded(self) -> Angles:
        return tuple(self._stack.rover.joints().q_rad[: len(JOINTS)])

    def standing(self) -> Angles:
        return self.commanded()

    def powered(self) -> frozenset[str]:
        state = self._stack.rover.joints()
        return frozenset(name for name, on in zip(state.names, state.on, strict=True) if on and name in JOINTS)


@contextmanager
def ros_door(seed: int) -> Iterator[RosDoor]:
    """A client on the stack, which is left with nothing moving."""
    pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed (lrm-ros2)")
    stack = _stack()
    stack.ready()
    token = stack.peer.token_of(f"{ACTION}/send_goal").replace(str(stack.peer.session.info.zid()), "ZID")
    command = [sys.executable, "-m", "tests.ros2.frozen_client", f"tcp/127.0.0.1:{stack.port}", token]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as client:
        client.stdout.readline()
        time.sleep(0.2)
        try:
            yield RosDoor(stack, client, seed)
        finally:
            client.kill()
            stack.wake()
            with suppress(LrmError):
                stack.rover.hold()


DOORS = (
    DoorKind(
        "ROS 2: topic, services, action", ("lrm_ros2.action", "lrm_ros2.bridge", "lrm_ros2.command"), ros_door,
        0.3, 1.0, slow=True, close=_RUNNING.close,
    ),
)  # fmt: skip
