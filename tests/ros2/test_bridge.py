"""The bridge as a process between a real daemon and a zenoh router of ROS 2's own.

The other end is zenoh, with the bytes written and read by `mcap-ros2-support`, which shares no code with the bridge.
"""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from lrm_ros2.action_types import CANCEL_GOAL, FEEDBACK, GET_RESULT, SEND_GOAL, STATUS, TRIGGER
from lrm_ros2.message_types import (
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
    JOINT_TRAJECTORY,
    as_message,
    message_type,
    type_hash,
)
from lrmd.client import Rover
from tests.support.daemon.daemon_harness import HOME, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, free_port, running_daemon, wait_for

pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed (lrm-ros2)")
dynamic = pytest.importorskip("mcap_ros2._dynamic", reason="mcap-ros2-support is not installed")

pytestmark = pytest.mark.long

HERE = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
"""For processes: the bridge of this checkout, installed or not."""
HASHES = {  # as `ros2 topic info --verbose` prints it
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}


class RosPeer:
    """Stand-in for a node of ROS 2 on the router: raw samples by topic."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session, self.samples = session, dict[str, zenoh.Sample]()
        self._queriers: dict[str, Any] = {}
        self._heard = session.declare_subscriber("0/**", self._take)
        self._publisher = session.liveliness().declare_token(self.token_of("joint_trajectory", "MP", JOINT_TRAJECTORY))

    def _take(self, sample: zenoh.Sample) -> None:
        self.samples[str(sample.key_expr)] = sample

    def last(self, topic: str, name: str) -> Any:
        """The last message of a topic, decoded; None: there was none."""
        sample = self.samples.get(f"0/{topic}/{dds(name)}/{type_hash(name, 'jazzy')}")
        plain, text = plainly(name)
        return sample and dynamic.generate_dynamic(plain, text)[plain](sample.payload.to_bytes())

    def send(self, topic: str, name: str, message: dict[str, Any]) -> None:
        """Sends a message."""
        key, data, attachment = self.parts(topic, name, message)
        self.session.put(key, data, attachment=attachment)

    def parts(self, topic: str, name: str, message: dict[str, Any]) -> tuple[str, bytes, bytes]:
        """Key and bytes of a message, with the attachment that rmw_zenoh gives it."""
        of = message_type(name, "jazzy")
        data = dynamic.serialize_dynamic(name, of.text)[name](message)
        attachment = struct.pack("<QQB16s", 1, time.time_ns(), 16, bytes(range(16)))
        return f"0/{topic}/{dds(name)}/{of.type_hash}", data, attachment

    def ask(self, service: str, name: str, request: dict[str, Any], patience: float = 20.0) -> Any:
        """Sends a request to a service of the bridge, as rmw_zenoh does; the replies that will come."""
        plain, text = plainly(f"{name}_Request")
        data = dynamic.serialize_dynamic(plain, text)[plain](request)
        attachment = struct.pack("<QQB16s", 7, time.time_ns(), 16, bytes(range(16)))
        key = f"0/lrm/{service}/{dds(name)}/{type_hash(name, 'jazzy')}"
        if key not in self._queriers:
            querier = self._queriers[key] = self.session.declare_querier(key, timeout=patience)
            wait_for(lambda: querier.matching_status.matching, f"the router knows {key}", patience)
        return self._queriers[key].get(payload=data, attachment=attachment)

    def call(self, service: str, name: str, request: dict[str, Any]) -> Any:
        """Asks a service of the bridge; its response, decoded."""
        for reply in self.ask(service, name, request):
            assert reply.ok is not None, reply.err.payload.to_string()
            assert struct.unpack("<QQB16s", reply.ok.attachment.to_bytes())[::3] == (7, bytes(range(16)))
            plain, text = plainly(f"{name}_Response")
            return dynamic.generate_dynamic(plain, text)[plain](reply.ok.payload.to_bytes())
        raise AssertionError(f"nobody answers {service}")

    def client_of(self, service: str) -> zenoh.LivelinessToken:
        """Declares a client of a service, as rmw_zenoh does."""
        return self.session.liveliness().declare_token(self.token_of(service))

    def token_of(self, name: str, kind: str = "SC", type_: str = SEND_GOAL) -> str:
        """The token of a client of a service (SC), or of a publisher (MP)."""
        place = f"@ros2_lv/0/{self.session.info.zid()}/1/2/{kind}/%/%/tester/%lrm%{name.replace('/', '%')}"
        of = f"{dds(type_)}/{type_hash(type_, 'jazzy')}"
        return f"{place}/{of}/::,:,:"


def plainly(name: str) -> tuple[str, str]:
    """Name and text of a type for a decoder that knows messages only, without underscores in their names."""
    text = message_type(name, "jazzy").text
    name = as_message(name)
    parts = sorted({found[1] for found in re.finditer(r"\w+/(?:msg/)?([A-Z]\w+_\w+)", f"{name}\n{text}")}, key=len)
    for part in reversed(parts):
        name, text = (where.replace(part, part.replace("_", "")) for where in (name, text))
    return name, text


def dds(name: str) -> str:
    package, kind, plain = name.split("/")
    return f"{package}::{kind}::dds_::{plain}_"


def point(seconds: float, **angles: float) -> dict[str, Any]:
    whole = int(seconds)
    duration = {"sec": whole, "nanosec": round((seconds - whole) * 1e9)}
    return {
        "positions": list(angles.values()), "velocities": [], "accelerations": [], "effort": [],
        "time_from_start": duration,
    }  # fmt: skip


def trajectory(*points: dict[str, Any], joints: tuple[str, ...] = ("joint1", "joint2")) -> dict[str, Any]:
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(joints), "points": list(points)}


@contextmanager
def ros_router(port: int) -> Iterator[RosPeer]:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")  # as rmw_zenoh's sessions have it
    with zenoh.open(config) as session:
        yield RosPeer(session)


@contextmanager
def bridged(setup: DaemonSetup, port: int, log: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "lrm_ros2", "--connect", setup.endpoint, "--ros-router", f"127.0.0.1:{port}"]
    with log.open("wb") as out:
        process = subprocess.Popen([*command, *options], stdout=out, stderr=subprocess.STDOUT, env=HERE)
    try:
        wait_for(lambda: b"bridge of" in log.read_bytes(), f"the bridge is up: {log.read_text()}", 30.0)
        yield process
    finally:
        process.terminate()
        assert process.wait(10.0) == 0, log.read_text()


def said(peer: RosPeer, name: str) -> tuple[int, str]:
    array = peer.last("diagnostics", DIAGNOSTIC_ARRAY)
    rows = {} if array is None else {row.name: (int(row.level), row.message) for row in array.status}
    return rows.get(name, (-1, ""))


def q1(rover: Rover) -> float:
    return rover.joints().q_rad[0]


def test_states_go_out_and_a_trajectory_takes_the_daemons_own_door(tmp_path: Path) -> None:
    setup, port, door = DaemonSetup.make(tmp_path, {**SLOW_BOARD}), free_port(), "lrm bridge: trajectory"
    log = tmp_path / "bridge.log"
    with running_daemon(setup), setup.rover() as rover, ros_router(port) as peer:
        wait_for_link(rover)
        with bridged(setup, port, log, "--trajectories"):
            wait_for(lambda: said(peer, "lrmd: mode")[0] >= 0, "diagnostics")
            state = peer.last("lrm/joint_states", JOINT_STATE)
            assert list(state.name) == rover.joints().names
            assert list(state.velocity) == []
            assert abs(state.header.stamp.sec - time.time()) < 60

            goal = trajectory(point(2.0, a=0.1, b=0.05))
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, goal)  # it does not arm: nothing moves
            wait_for(lambda: "refused" in said(peer, door)[1], "the refusal")
            assert rover.mode().mode == "disarmed"

            with rover.control("test"):
                rover.arm("given", HOME)
                peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, goal)  # somebody else has the lease
                wait_for(lambda: "test" in said(peer, door)[1], "who has the lease")
                assert q1(rover) == pytest.approx(0.0, abs=1e-3)

            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, goal)
            wait_for(lambda: said(peer, door) == (0, "followed to its end"), "the end", 30.0)
            assert rover.joints().q_rad[:2] == pytest.approx([0.1, 0.05], abs=2e-3)
            wait_for(lambda: abs(peer.last("lrm/joint_states", JOINT_STATE).position[0] - 0.1) < 2e-3, "it is told")

            far = trajectory(point(60.0, a=1.0, b=0.05))
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, far)
            wait_for(lambda: rover.mode().mode == "moving", "it moves")
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory())
            wait_for(lambda: rover.mode().mode == "holding", "an empty trajectory holds it")
            wait_for(lambda: "holding" in said(peer, door)[1], "why it ended")
            assert q1(rover) < 0.9

            fast = trajectory(point(0.001, a=0.9, b=0.05))
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, fast)
            wait_for(lambda: "deg/s; its most is" in said(peer, door)[1], "too fast")


ACTION = "follow_joint_trajectory/_action"


def goal(number: int, *points: dict[str, Any], tolerance: bool = False) -> dict[str, Any]:
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    one = {"name": "joint1", "position": 0.01, "velocity": 0.0, "acceleration": 0.0}
    return {
        "goal_id": {"uuid": [number] * 16},
        "goal": {
            "trajectory": trajectory(*points),
            "multi_dof_trajectory": {"header": header, "joint_names": [], "points": []},
            "path_tolerance": [one] if tolerance else [], "component_path_tolerance": [], "goal_tolerance": [],
            "component_goal_tolerance": [], "goal_time_tolerance": {"sec": 0, "nanosec": 0},
        },
    }  # fmt: skip


def result_of(peer: RosPeer, number: int) -> tuple[int, int, str]:
    found = peer.call(f"{ACTION}/get_result", GET_RESULT, {"goal_id": {"uuid": [number] * 16}})
    return found.status, found.result.error_code, found.result.error_string


def accepted(peer: RosPeer, *parts: Any, **more: bool) -> bool:
    return bool(peer.call(f"{ACTION}/send_goal", SEND_GOAL, goal(*parts, **more)).accepted)


def test_an_action_is_followed_cancelled_and_held_when_its_client_is_lost(tmp_path: Path) -> None:
    """States 4, 5 and 6 of a goal: succeeded, cancelled, aborted."""
    setup, port = DaemonSetup.make(tmp_path, {**SLOW_BOARD}), free_port()
    log = tmp_path / "bridge.log"
    with running_daemon(setup), setup.rover() as rover, ros_router(port) as peer:
        wait_for_link(rover)
        with bridged(setup, port, log, "--trajectories"):
            near, far = point(2.0, a=0.1, b=0.05), point(60.0, a=1.0, b=0.05)
            assert not accepted(peer, 1, near)  # its loss could not be seen
            client = peer.client_of(f"{ACTION}/send_goal")
            time.sleep(0.5)
            assert not accepted(peer, 2, near, tolerance=True)
            wait_for(lambda: accepted(peer, 3, near), "a new client's goal is taken")  # it does not arm: nothing moves
            status, code, why = result_of(peer, 3)
            assert (status, code) == (6, -4)
            assert "disarmed" in why
            assert result_of(peer, 9)[0] == 0

            with rover.control("test"):
                rover.arm("given", HOME)
            assert accepted(peer, 4, near)
            assert result_of(peer, 4) == (4, 0, "")
            assert rover.joints().q_rad[:2] == pytest.approx([0.1, 0.05], abs=2e-3)
            told = peer.last(f"lrm/{ACTION}/feedback", FEEDBACK)
            assert list(bytes(told.goal_id.uuid)) == [4] * 16
            assert len(told.feedback.desired.positions) == len(told.feedback.joint_names)
            assert list(told.feedback.actual.positions) == []

            assert accepted(peer, 5, far)
            wait_for(lambda: rover.mode().mode == "moving", "it moves")
            assert not accepted(peer, 6, near)  # one at a time
            info = {"goal_id": {"uuid": [5] * 16}, "stamp": {"sec": 0, "nanosec": 0}}
            assert peer.call(f"{ACTION}/cancel_goal", CANCEL_GOAL, {"goal_info": info}).return_code == 0
            assert result_of(peer, 5)[:2] == (5, -4)
            assert rover.mode().mode == "holding"
            assert peer.call(f"{ACTION}/cancel_goal", CANCEL_GOAL, {"goal_info": info}).return_code == 3

            assert accepted(peer, 7, far)
            wait_for(lambda: rover.mode().mode == "moving", "it moves again")
            client.undeclare()
            status, code, why = result_of(peer, 7)
            assert (status, code) == (6, -4)
            assert "its client is gone" in why
            assert rover.mode().mode == "holding"
            assert q1(rover) < 0.9

            def states() -> dict[int, int]:
                status_list = peer.last(f"lrm/{ACTION}/status", STATUS).status_list
                return {bytes(one.goal_info.goal_id.uuid)[0]: one.status for one in status_list}

            # Result and status are two messages: the answer to `get_result` may be here before the topic's.
            wait_for(lambda: states() == {3: 6, 4: 4, 5: 5, 7: 6}, "the status of every goal")


def test_without_the_option_only_hold_and_estop_are_served(tmp_path: Path) -> None:
    setup, port = DaemonSetup.make(tmp_path, {**SLOW_BOARD}), free_port()
    empty = {"structure_needs_at_least_one_member": 0}
    with running_daemon(setup), setup.rover() as rover, ros_router(port) as peer:
        wait_for_link(rover)
        with rover.control("test"):
            rover.arm("given", HOME)
        with bridged(setup, port, tmp_path / "bridge.log"):
            wait_for(lambda: said(peer, "lrmd: mode")[0] >= 0, "diagnostics")
            tokens = [str(reply.ok.key_expr) for reply in peer.session.liveliness().get("@ros2_lv/**") if reply.ok]
            assert sum("/MP/" in token and "tester" not in token for token in tokens) == 2
            assert not any("/MS/" in token for token in tokens)
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory(point(1.0, a=0.1, b=0.0)))
            time.sleep(2.5)
            assert q1(rover) == pytest.approx(0.0, abs=1e-3)
            with rover.control("test"):
                rover.move({"joint1": 1.0}, speed=0.05, wait=False)
                wait_for(lambda: rover.mode().mode == "moving", "it moves")
                held = peer.call("hold", TRIGGER, empty)
                assert (held.success, held.message) == (True, "the arm holds")
                wait_for(lambda: rover.mode().mode == "holding", "it holds")
                assert peer.call("estop", TRIGGER, empty).success
                wait_for(lambda: rover.mode().mode == "estop", "the emergency stop")
        no_router_is_said_in_a_line(setup)


def test_the_hash_of_a_type_is_the_one_that_ros_publishes() -> None:
    assert {name: message_type(name, "jazzy").type_hash for name in HASHES} == HASHES


def no_router_is_said_in_a_line(setup: DaemonSetup) -> None:
    command = [sys.executable, "-m", "lrm_ros2", "--connect", setup.endpoint, "--ros-router"]
    ended = subprocess.run([*command, f"127.0.0.1:{free_port()}"], env=HERE, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2
    assert ended.stderr.startswith("lrm-ros2: no zenoh router of ROS 2 at 127.0.0.1:")
    assert ended.stderr.count("\n") == 1
