"""The bridge at work: the daemon's states go out, and a trajectory goes through the daemon's own door.

A trajectory takes the lease for as long as it lasts, from nobody; it neither arms nor resets. The daemon checks limits
and collisions as for every client.
"""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

from lrm_math.errors import LrmError
from lrm_ros2.diagnostics import DiagnosticRow, Severity, fault_row, heat_row, mode_row, silent_row
from lrm_ros2.ros_node import RosNode
from lrm_ros2.trajectory import asks_to_hold, trajectory_path
from lrmd.client import JointsState, Rover

HOLDER = "ROS 2 bridge"
PERIOD_S = 1.0
"""s between diagnostics."""


@dataclass
class TrajectoryDoor:
    """Trajectories, one at a time. One that comes while another is followed is refused; an empty one holds at once."""

    rover: Rover
    said: DiagnosticRow = field(default=DiagnosticRow("lrm bridge: trajectory", Severity.OK, "none yet"))
    _waiting: queue.Queue[Any] = field(default_factory=queue.Queue)
    _busy: threading.Lock = field(default_factory=threading.Lock)

    def take(self, message: Any) -> None:
        """Takes a message in, on any thread."""
        if asks_to_hold(message):
            self._report(Severity.OK, "held, by an empty trajectory")
            threading.Thread(target=self._hold, daemon=True).start()  # zenoh's thread must not wait for zenoh
        elif self._busy.acquire(blocking=False):
            self._waiting.put(message)
        else:
            self._report(Severity.WARN, "refused: another trajectory is being followed")

    def follow_next(self, patience: float) -> None:
        """Follows the next trajectory to its end, if one comes within a time (s)."""
        try:
            message = self._waiting.get(timeout=patience)
        except queue.Empty:
            return
        try:
            self._follow(message)
            self._report(Severity.OK, "followed to its end")
        except LrmError as error:
            self._report(Severity.WARN, f"refused or not ended: {error}")
        finally:
            self._busy.release()

    def _follow(self, message: Any) -> None:
        joints, info = self.rover.joints(), self.rover.info()
        path = trajectory_path(message, dict(zip(joints.names, joints.q_rad, strict=True)), info, time.time())
        self._report(Severity.OK, f"following {len(path.waypoints)} points")
        with self.rover.control(HOLDER):
            self.rover.move(*path.waypoints, speed=path.speed)

    def _hold(self) -> None:
        try:
            self.rover.hold()
        except LrmError as error:
            self._report(Severity.ERROR, f"not held: {error}")

    def _report(self, level: Severity, text: str) -> None:
        self.said = DiagnosticRow(self.said.name, level, text)
        print(f"trajectory: {text}", flush=True)


def publish_states(rover: Rover, node: RosNode, door: TrajectoryDoor, ended: threading.Event) -> None:
    """Publishes joint states as they come, and diagnostics every second, until `ended`."""

    def pass_on(state: JointsState) -> None:
        node.publish_joints(state.names, state.q_rad, state.t_wall_ns * 1e-9)

    subscriber = rover.watch(JointsState, "state/joints", pass_on)
    while not ended.wait(PERIOD_S):
        node.publish_diagnostics([*_rows(rover), door.said], rover.robot)
    subscriber.undeclare()  # type: ignore[no-untyped-call]


def _rows(rover: Rover) -> list[DiagnosticRow]:
    try:
        faults = {fault.code: fault.text for fault in rover.faults().faults}
        return [mode_row(rover.mode()), fault_row(faults), heat_row(rover.thermal())]
    except LrmError:
        return [silent_row()]
