"""The bridge as a process between a real daemon and a zenoh router of ROS 2's own.

The other end is zenoh, with the bytes written and read by `mcap-ros2-support`, which shares no code with the bridge.
"""

from __future__ import annotations

import json
import os
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

from lrm_ros2.message_types import DIAGNOSTIC_ARRAY, JOINT_STATE, JOINT_TRAJECTORY, message_type
from lrmd.client import Rover
from tests.support.daemon.daemon_harness import HOME, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, free_port, running_daemon, wait_for

pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed (lrm-arm[ros2])")
dynamic = pytest.importorskip("mcap_ros2._dynamic", reason="mcap-ros2-support is not installed")

HASHES = {  # as `ros2 topic info --verbose` prints it
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
}


class RosPeer:
    """What a node of ROS 2 would be on the router: raw samples by topic."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session, self.samples = session, dict[str, zenoh.Sample]()
        self._heard = session.declare_subscriber("0/**", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.samples[str(sample.key_expr)] = sample

    def last(self, topic: str, name: str) -> Any:
        """The last message of a topic, decoded; None: there was none."""
        of = message_type(name, "jazzy")
        sample = self.samples.get(f"0/{topic}/{dds(name)}/{of.type_hash}")
        return sample and dynamic.generate_dynamic(name, of.text)[name](sample.payload.to_bytes())

    def send(self, topic: str, name: str, message: dict[str, Any]) -> None:
        """Sends a message, with the attachment that rmw_zenoh gives it."""
        of = message_type(name, "jazzy")
        data = dynamic.serialize_dynamic(name, of.text)[name](message)
        attachment = struct.pack("<QQB16s", 1, time.time_ns(), 16, bytes(range(16)))
        self.session.put(f"0/{topic}/{dds(name)}/{of.type_hash}", data, attachment=attachment)


def dds(name: str) -> str:
    package, _, kind = name.split("/")
    return f"{package}::msg::dds_::{kind}_"


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
    with zenoh.open(config) as session:
        yield RosPeer(session)


@contextmanager
def bridged(setup: DaemonSetup, port: int, log: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "lrm_ros2", "--connect", setup.endpoint, "--ros-router", f"127.0.0.1:{port}"]
    with log.open("wb") as out:
        process = subprocess.Popen([*command, *options], stdout=out, stderr=subprocess.STDOUT, env=dict(os.environ))
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


def test_without_the_option_no_trajectory_is_listened_to(tmp_path: Path) -> None:
    setup, port = DaemonSetup.make(tmp_path, {**SLOW_BOARD}), free_port()
    with running_daemon(setup), setup.rover() as rover, ros_router(port) as peer:
        wait_for_link(rover)
        with rover.control("test"):
            rover.arm("given", HOME)
        with bridged(setup, port, tmp_path / "bridge.log"):
            wait_for(lambda: said(peer, "lrmd: mode")[0] >= 0, "diagnostics")
            tokens = [str(reply.ok.key_expr) for reply in peer.session.liveliness().get("@ros2_lv/**") if reply.ok]
            assert sum("/MP/" in token for token in tokens) == 2
            assert not any("/MS/" in token for token in tokens)
            peer.send("lrm/joint_trajectory", JOINT_TRAJECTORY, trajectory(point(1.0, a=0.1, b=0.0)))
            time.sleep(2.5)
            assert q1(rover) == pytest.approx(0.0, abs=1e-3)


def test_the_hash_of_a_type_is_the_one_that_ros_publishes() -> None:
    assert {name: message_type(name, "jazzy").type_hash for name in HASHES} == HASHES


def test_no_router_is_said_in_a_line(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with running_daemon(setup):
        command = [sys.executable, "-m", "lrm_ros2", "--connect", setup.endpoint]
        ended = subprocess.run(
            [*command, "--ros-router", f"127.0.0.1:{free_port()}"], capture_output=True, text=True, timeout=60
        )
    assert ended.returncode == 2
    assert ended.stderr.startswith("lrm-ros2: no zenoh router of ROS 2 at 127.0.0.1:")
    assert ended.stderr.count("\n") == 1
