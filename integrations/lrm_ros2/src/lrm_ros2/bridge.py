"""The bridge at work: the daemon's states go out, and a trajectory goes through the daemon's own door.

A trajectory takes the lease for as long as it lasts, from nobody; it neither arms nor resets. The daemon checks limits
and collisions as for every client.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from lrm_math.errors import LrmError
from lrm_ros2.arrivals import Arrivals
from lrm_ros2.diagnostics import DiagnosticRow, Severity, fault_row, heat_row, mode_row, silent_row
from lrm_ros2.ros_endpoints import ServiceAnswer
from lrm_ros2.ros_node import RosNode
from lrm_ros2.sender_watch import SenderEnd, SenderWatch, StopsKnown
from lrm_ros2.trajectory import asks_to_hold, trajectory_path
from lrmd.client import JointsState, ModeState, Rover
from lrmd.messages.shown_text import shown

HOLDER = "ROS 2 bridge"
PERIOD_S = 1.0
"""s between diagnostics."""
LAST_ENDS_S = 0.3
"""s that an order which was stopped is given to end."""
NOT_NEWER = "the arm was stopped after this was sent, or at almost the same time: send it again if it may go on"


@dataclass(eq=False)
class TrajectoryOrder:
    """A `JointTrajectory`, and who is told what becomes of it, on threads that may wait: of one that came on a topic,
    nobody but the diagnostics. `number`: of its arrival; `newer_than`: the stops before it was sent; `unwanted`: why it
    is to be stopped, empty while it is not."""

    message: Any
    number: int
    newer_than: StopsKnown
    unwanted: str = field(default="", kw_only=True)

    def refused(self, why: str) -> None:
        """Tells that it is not followed."""

    def accepted(self) -> bool:
        """Tells that it is as it should be, and comes next. False: it is not wanted any more."""
        return True

    def ended(self, why: str) -> None:
        """Tells that it was followed to its end (empty), or why not."""


@dataclass
class TrajectoryDoor:
    """Trajectories, one at a time. One that comes while another is followed is refused; an empty one holds at once.

    None is followed after a stop that it is not surely newer than. The door refuses it if a stop of ROS came later
    (`Arrivals`). The daemon refuses it after any other: a move says how many stops there had been before the order was
    sent (`SenderWatch`). `topic`: where trajectories without a goal come from.
    """

    rover: Rover
    arrivals: Arrivals
    senders: SenderWatch
    topic: SenderEnd
    said: DiagnosticRow = field(default=DiagnosticRow("lrm bridge: trajectory", Severity.OK, "none yet"))
    _waiting: queue.Queue[TrajectoryOrder] = field(default_factory=queue.Queue)
    _busy: threading.Lock = field(default_factory=threading.Lock)
    _holds: list[threading.Thread] = field(default_factory=list)

    def take(self, message: Any, number: int) -> None:
        """Takes a message of the topic in, on any thread."""
        if asks_to_hold(message):
            self.arrivals.stopped(number)
            self._report(Severity.OK, "held, by an empty trajectory")
            self.hold()
            return
        try:
            self.offer(TrajectoryOrder(message, number, self.senders.newer_than(self.topic)))
        except LrmError as error:
            self.report_refused(str(error))

    def offer(self, order: TrajectoryOrder) -> None:
        """Takes an order in, on any thread."""
        if self._busy.acquire(blocking=False):
            self._waiting.put(order)
        else:
            self._refuse(order, "another trajectory is being followed")

    def hold(self, then: Callable[[bool], object] = bool) -> None:
        """Holds, on a thread of its own: that of the arrivals must not wait. `then` is told whether the arm holds."""
        thread = threading.Thread(target=self._hold, args=(then,), daemon=True)
        thread.start()
        self._holds = [*(one for one in self._holds if one.is_alive()), thread]

    @property
    def busy(self) -> bool:
        """Whether an order is followed or comes next."""
        return self._busy.locked()

    def stop(self, how: Callable[[], None]) -> None:
        """Stops by `how`; an order of a sender that is then told so is newer than the stop, and finds the door free.
        Raises `LrmError`."""
        how()
        if self._busy.acquire(timeout=LAST_ENDS_S):
            self._busy.release()
        self.senders.counted(self.rover.mode())

    def follow_next(self, patience: float) -> None:
        """Follows the next trajectory to its end, if one comes within a time (s)."""
        try:
            order = self._waiting.get(timeout=patience)
        except queue.Empty:
            return
        try:
            self._follow(order)
        finally:
            self._busy.release()

    def _follow(self, order: TrajectoryOrder) -> None:
        for earlier in self._holds:
            earlier.join()
        try:
            mode, joints, info = self.rover.mode(), self.rover.joints(), self.rover.info()
            if (mode.boot_id, mode.stops) != (order.newer_than.boot_id, order.newer_than.stops):
                raise LrmError(NOT_NEWER)
            now = dict(zip(joints.names, joints.q_rad, strict=True))
            path = trajectory_path(order.message, now, info, time.time())
        except LrmError as error:
            self._refuse(order, str(error))
            return
        if self.arrivals.overtaken(order.number):
            self._refuse(order, NOT_NEWER)
            return
        if not order.accepted():
            self._refuse(order, order.unwanted or "it is not wanted any more")
            return
        self._report(Severity.OK, f"following {len(path.waypoints)} points")
        try:
            with self.rover.control(HOLDER):
                self.rover.move(*path.waypoints, speed=path.speed, stops=order.newer_than.stops)
        except LrmError as error:
            self._report(Severity.WARN, f"refused or not ended: {error}")
            order.ended(str(error))
        except BaseException:
            order.ended("the bridge was ended")
            raise
        else:
            self._report(Severity.OK, "followed to its end")
            order.ended("")

    def report_refused(self, why: str) -> None:
        """Tells in the diagnostics, and on the terminal, of an order that is not followed."""
        self._report(Severity.WARN, f"refused or not ended: {why}")

    def _refuse(self, order: TrajectoryOrder, why: str) -> None:
        self.report_refused(why)
        order.refused(why)

    def _hold(self, then: Callable[[bool], object]) -> None:
        try:
            self.stop(self.rover.hold)
        except LrmError as error:
            self._report(Severity.ERROR, f"not held: {error}")
            then(False)
        else:
            then(True)

    def _report(self, level: Severity, text: str) -> None:
        self.said = DiagnosticRow(self.said.name, level, shown(text))
        print(f"trajectory: {self.said.text}", flush=True)


def stop_service(stop: Callable[[], None], done: str) -> Callable[[Any, ServiceAnswer, int], None]:
    """Handler of a `std_srvs/Trigger` that stops the arm, and says whether it did."""

    def handler(_: Any, answer: ServiceAnswer, __: int) -> None:
        """Stops on a thread of its own: that of the arrivals must not wait."""
        threading.Thread(target=carry_out, args=(answer,), daemon=True).start()

    def carry_out(answer: ServiceAnswer) -> None:
        """Stops and answers."""
        try:
            stop()
        except LrmError as error:
            answer(success=False, message=str(error))
        else:
            answer(success=True, message=done)

    return handler


def publish_states(
    rover: Rover, node: RosNode, door: TrajectoryDoor, on_state: Callable[[JointsState], None], ended: threading.Event
) -> None:
    """Publishes joint states as they come, and diagnostics every second, until `ended`; tells the watch of stops."""

    def pass_on(state: JointsState) -> None:
        node.publish_joints(state.names, state.q_rad, state.t_wall_ns * 1e-9)
        on_state(state)

    subscribers = (
        rover.watch(ModeState, "state/mode", door.senders.counted),
        rover.watch(JointsState, "state/joints", pass_on),
    )
    while not ended.wait(PERIOD_S):
        node.publish_diagnostics([*_rows(rover), door.said], rover.robot)
    for subscriber in subscribers:
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def _rows(rover: Rover) -> list[DiagnosticRow]:
    try:
        faults = {fault.code: fault.text for fault in rover.faults().faults}
        return [mode_row(rover.mode()), fault_row(faults), heat_row(rover.thermal())]
    except LrmError:
        return [silent_row()]
