"""Stops of ROS 2 are not overtaken by what they stop, and a cancel of all goals stops what waits at the door."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lrm_ros2.action_types import CANCEL_GOAL, SEND_GOAL, TRIGGER
from lrm_ros2.message_types import JOINT_TRAJECTORY
from lrm_ros2.sender_watch import OVERTAKEN_S
from lrmd.client import Rover
from tests.doors.daemon_door import simulated_config
from tests.doors.ros2_door import ALL_GOALS
from tests.doors.ros2_in_process import PATIENCE_S, InProcessBridge
from tests.ros2.test_bridge import ACTION, RosPeer, bridged, goal, point, ros_router, said, trajectory
from tests.support.daemon.daemon_harness import HOME, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, free_port, running_daemon, wait_for
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

pytestmark = pytest.mark.long

GAPS_MS = (0, 1, 3, 10)
"""From the trajectory to its stop."""
FAR = (60.0, 1.0)
"""s, rad: a motion that would still go on."""
DOOR = "lrm bridge: trajectory"


@dataclass
class BridgeUnderTest:
    """A bridge between a daemon whose arm is armed at home, and ROS 2's side of it."""

    rover: Rover
    peer: RosPeer
    process: subprocess.Popen[bytes]
    port: int
    goals: int = 10

    def send(self, way: str) -> None:
        """Sends a trajectory by a topic or as a goal, and returns at once."""
        seconds, angle = FAR
        there = point(seconds, a=angle, b=0.05)
        if way == "topic":
            self.peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory(there))
            return
        self.goals += 1
        self.peer.ask(f"{ACTION}/send_goal", SEND_GOAL, goal(self.goals, there))

    def stop(self, way: str) -> Any:
        """Stops it; returns the answer, if there is one."""
        if way == "empty":
            return self.peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory())
        if way == "hold":
            return self.peer.call("hold", TRIGGER, {"structure_needs_at_least_one_member": 0})
        info = {"goal_id": {"uuid": [0] * 16}, "stamp": {"sec": 0, "nanosec": 0}}
        return self.peer.call(f"{ACTION}/cancel_goal", CANCEL_GOAL, {"goal_info": info})

    def counts(self) -> list[float]:
        """Commanded pulses (us)."""
        return self.rover.joints().pulse_us

    def stands(self) -> None:
        """Asserts that it stands, and goes on standing while everything on its way has time to arrive."""
        time.sleep(0.25)
        before = self.counts()
        time.sleep(0.35)
        assert self.counts() == before, self.rover.mode()
        assert self.rover.mode().mode in ("armed", "holding")

    def ready(self) -> None:
        """Waits until the door takes another trajectory."""
        wait_for(lambda: "following" not in said(self.peer, DOOR)[1], "the last one is done", 5.0)


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BridgeUnderTest]:
    folder: Path = tmp_path_factory.mktemp("bridge")
    setup, port = DaemonSetup.make(folder, {**SLOW_BOARD}), free_port()
    with ExitStack() as stack:
        stack.enter_context(running_daemon(setup))
        rover, peer = stack.enter_context(setup.rover()), stack.enter_context(ros_router(port))
        wait_for_link(rover)
        with rover.control("test"):
            rover.arm("given", HOME)
        process = stack.enter_context(bridged(setup, port, folder / "bridge.log", "--trajectories"))
        wait_for(lambda: said(peer, DOOR)[0] >= 0, "diagnostics")
        token = peer.client_of(f"{ACTION}/send_goal")
        stack.callback(token.undeclare)
        time.sleep(0.3)
        yield BridgeUnderTest(rover, peer, process, port)


WAYS = [("topic", "empty"), ("topic", "hold"), ("action", "hold"), ("action", "cancel all")]


@pytest.mark.parametrize(("order", "stop"), WAYS)
def test_no_trajectory_moves_the_arm_after_a_stop(bridge: BridgeUnderTest, order: str, stop: str) -> None:
    for gap in GAPS_MS:
        bridge.ready()
        bridge.send(order)
        time.sleep(gap / 1000)
        answer = bridge.stop(stop)
        if stop == "hold":
            assert answer.success, answer.message
            at_the_answer = bridge.counts()
            time.sleep(0.1)
            assert bridge.counts() == at_the_answer
        bridge.stands()


@pytest.mark.parametrize(("order", "stop"), [("topic", "empty"), ("topic", "hold")])
def test_nor_when_both_waited_in_a_stalled_bridge(bridge: BridgeUnderTest, order: str, stop: str) -> None:
    for _ in range(3):
        bridge.ready()
        bridge.process.send_signal(signal.SIGSTOP)
        bridge.send(order)
        time.sleep(0.05)
        stopping = threading.Thread(target=bridge.stop, args=(stop,))
        stopping.start()
        time.sleep(0.5)
        bridge.process.send_signal(signal.SIGCONT)
        stopping.join()
        bridge.stands()


@pytest.mark.parametrize("order", ["topic", "action"])
def test_nor_one_that_waited_in_a_stalled_bridge(bridge: BridgeUnderTest, order: str) -> None:
    """The stop is by the daemon's own door: the bridge hears of it when it wakes, together with the order."""
    for stall in (0.1, 0.3, 1.0, 3.0):
        bridge.ready()
        bridge.process.send_signal(signal.SIGSTOP)
        bridge.send(order)
        time.sleep(0.05)
        bridge.rover.hold()
        before = bridge.counts()
        time.sleep(stall)
        bridge.process.send_signal(signal.SIGCONT)
        bridge.stands()
        assert bridge.counts() == before


def test_nor_one_that_waited_in_its_frozen_sender(bridge: BridgeUnderTest) -> None:
    """It leaves its sender before the stop or after it."""
    token = bridge.peer.token_of("joint_trajectory", "MP", JOINT_TRAJECTORY)
    seconds, angle = FAR
    key, data, attachment = bridge.peer.parts(
        "lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory(point(seconds, a=angle, b=0.05))
    )
    with frozen_client(bridge, token) as sender:
        assert sender.stdin is not None
        for stall in (0.1, 0.3, 1.0):
            bridge.ready()
            sender.stdin.write(f"{key} {data.hex()} {attachment.hex()}\n".encode())
            sender.stdin.flush()
            time.sleep(0.05)
            bridge.rover.hold()
            before = bridge.counts()
            time.sleep(stall)
            sender.send_signal(signal.SIGCONT)
            bridge.stands()
            assert bridge.counts() == before


@pytest.mark.parametrize(("order", "stop"), WAYS)
def test_an_order_after_a_stop_is_followed(bridge: BridgeUnderTest, order: str, stop: str) -> None:
    """At once where the stop was answered; after an empty trajectory, which has no answer, soon."""
    bridge.ready()
    answer = bridge.stop(stop)
    time.sleep(1.0 if answer is None else 0.0)
    bridge.send(order)
    wait_for(lambda: bridge.rover.joints().moving, "it is followed", 10.0)
    bridge.stop("hold")


def test_a_stop_by_another_door_is_not_overtaken_either(bridge: BridgeUnderTest) -> None:
    """The bridge looks, is stalled, somebody holds at the daemon, and the bridge goes on."""
    bridge.ready()
    seen = bridge.rover.mode().stops
    with bridge.rover.control("other"):
        before = bridge.counts()
        bridge.rover.hold()
        with pytest.raises(Exception, match="stopped since"):
            bridge.rover.move({"joint1": 1.0}, stops=seen)
        assert bridge.counts() == before
        assert _moves(lambda: bridge.rover.move({"joint1": 0.0}, wait=False), bridge)


def _moves(ask: Callable[[], object], bridge: BridgeUnderTest) -> bool:
    ask()
    wait_for(lambda: bridge.rover.mode().mode in ("moving", "armed"), "it moves")
    return True


@contextmanager
def frozen_client(bridge: BridgeUnderTest, token: str) -> Iterator[subprocess.Popen[bytes]]:
    """Another node, a process of its own, with a token like one of the peer's."""
    token = token.replace(str(bridge.peer.session.info.zid()), "ZID")
    command = [sys.executable, "-m", "tests.ros2.frozen_client", f"tcp/127.0.0.1:{bridge.port}", token]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        time.sleep(0.3)
        try:
            yield process
        finally:
            process.kill()
            process.wait()
            time.sleep(2 * OVERTAKEN_S)  # until then an order may be one of its last


@pytest.fixture
def client(bridge: BridgeUnderTest) -> Iterator[subprocess.Popen[bytes]]:
    """Another client of the action."""
    with frozen_client(bridge, bridge.peer.token_of(f"{ACTION}/send_goal")) as process:
        yield process


CLIENT_S = 1.0
"""The stated bound for a client that is lost."""


@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_frozen_client_ends_it(bridge: BridgeUnderTest, client: subprocess.Popen[bytes], how: signal.Signals) -> None:
    bridge.ready()
    bridge.send("action")
    wait_for(lambda: bridge.rover.joints().moving, "it moves")
    time.sleep(0.3)
    client.send_signal(how)
    time.sleep(CLIENT_S)
    at_the_bound = bridge.counts()
    bridge.stands()
    assert bridge.counts() == at_the_bound
    client.send_signal(signal.SIGCONT)


AWAY = point(12.0, a=0.4, b=0.3)
HERE = {"joint1": 0.0, "joint2": 0.0}


@pytest.fixture
def bridge_in_process() -> Iterator[InProcessBridge]:
    sim = SimulatedDaemon(simulated_config())
    sim.run(30)
    bridge_in_process = InProcessBridge(sim)
    with bridge_in_process.running():
        bridge_in_process.client(True)
        with bridge_in_process.person.control("person"):
            bridge_in_process.person.arm("given", HERE)
        yield bridge_in_process


def stands(bridge_in_process: InProcessBridge) -> None:
    assert bridge_in_process.send("cancel_goal", ALL_GOALS).wait(PATIENCE_S)
    time.sleep(0.3)
    before = bridge_in_process.person.joints().pulse_us
    time.sleep(0.7)
    assert bridge_in_process.person.joints().pulse_us == before
    assert bridge_in_process.person.mode().mode in ("armed", "holding")


def test_a_goal_that_was_offered_before_others_that_were_refused(bridge_in_process: InProcessBridge) -> None:
    for number in (1, 2, 3):
        bridge_in_process.send("send_goal", goal(number, AWAY))
    time.sleep(0.01)
    stands(bridge_in_process)


def test_a_trajectory_of_the_topic_that_is_followed(bridge_in_process: InProcessBridge) -> None:
    bridge_in_process.send("topic", trajectory(AWAY))
    end = time.monotonic() + PATIENCE_S
    while not bridge_in_process.person.joints().moving and time.monotonic() < end:
        time.sleep(0.02)
    assert bridge_in_process.person.joints().moving
    stands(bridge_in_process)
