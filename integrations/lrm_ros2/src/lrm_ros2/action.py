"""The action `FollowJointTrajectory`: goals through the door of trajectories, feedback as the ramp goes on.

A goal is followed only while its client is there: clients are known by their liveliness tokens. When one of those that
were there at the beginning has gone, or is silent (`SenderWatch`), the arm holds. What is measured is not known:
`desired` has the commanded angles, `actual` and `error` are empty, and a goal with tolerances is refused.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from lrm_math.errors import LrmError
from lrm_ros2.bridge import TrajectoryDoor, TrajectoryOrder
from lrm_ros2.ros_endpoints import ServiceAnswer
from lrm_ros2.ros_node import RosNode
from lrm_ros2.sender_watch import SenderEnd
from lrmd.client import JointsState
from lrmd.messages.shown_text import shown

FEEDBACK_S, AGAIN_S = 0.1, 0.2
"""s between feedbacks; between holds of a motion that nobody wants any more."""
KEPT = 16
"""Goals whose result is kept for whoever asks later."""
NO_TOLERANCES = "tolerances cannot be watched, as nothing measures the joints: leave them empty"


class GoalState(IntEnum):
    """`action_msgs/GoalStatus`."""

    UNKNOWN = 0
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class TrajectoryErrorCode(IntEnum):
    """`FollowJointTrajectory_Result.error_code`."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4


class CancelCode(IntEnum):
    """`CancelGoal_Response.return_code`."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


@dataclass(eq=False)
class JointGoal(TrajectoryOrder):
    """One goal.

    `clients`: tokens of those that were there when it came. `waiting`: answers to who asked for its result.
    """

    action: FollowAction
    id: bytes
    answer: ServiceAnswer
    clients: frozenset[str]
    stamp: float = field(default_factory=time.time)
    state: GoalState = GoalState.UNKNOWN
    cancelled: bool = False
    result: tuple[int, str] = (0, "")
    waiting: list[ServiceAnswer] = field(default_factory=list)

    def refused(self, why: str) -> None:
        """See `TrajectoryOrder`."""
        if self.state != GoalState.UNKNOWN:
            self.action.end(self, why)
            return
        self.action.forget(self)
        self.answer(accepted=False, stamp=self.action.node.stamp(self.stamp))

    def accepted(self) -> bool:
        """See `TrajectoryOrder`."""
        if self.unwanted:
            return False
        self.action.begin(self)
        self.answer(accepted=True, stamp=self.action.node.stamp(self.stamp))
        return not self.unwanted

    def ended(self, why: str) -> None:
        """See `TrajectoryOrder`."""
        self.action.end(self, why)


class FollowAction:
    """Serves the action, on the thread of the arrivals; `door` follows the goals on its own. `clients`: who asks."""

    def __init__(self, door: TrajectoryDoor, node: RosNode, clients: SenderEnd) -> None:
        self.door, self.node, self.clients = door, node, clients
        self._lock = threading.RLock()
        self._active: JointGoal | None = None
        self._offered: set[JointGoal] = set()
        self._goals: OrderedDict[bytes, JointGoal] = OrderedDict()
        self._last, self._held = 0.0, 0.0

    def send_goal(self, request: Any, answer: ServiceAnswer, number: int) -> None:
        """Service `send_goal`."""
        goal, id_ = request.goal, bytes(request.goal_id.uuid)
        clients = self.door.senders.of(self.clients)
        with self._lock:
            try:
                self._check(goal, id_, clients)
                newer_than = self.door.senders.newer_than(self.clients)
            except LrmError as why:
                print(f"action: a goal is refused: {shown(str(why))}", flush=True)
                answer(accepted=False, stamp=self.node.stamp(time.time()))
                return
            new = JointGoal(goal.trajectory, number, newer_than, self, id_, answer, clients)
            self._offered.add(new)
        self.door.offer(new)

    def _check(self, goal: Any, id_: bytes, clients: frozenset[str]) -> None:
        if not clients:
            raise LrmError("its client has no liveliness token: nobody would notice that it is lost")
        lists = (goal.path_tolerance, goal.component_path_tolerance, goal.goal_tolerance, goal.component_goal_tolerance)
        if any(len(one) for one in lists):
            raise LrmError(NO_TOLERANCES)
        if len(goal.multi_dof_trajectory.points) or not len(goal.trajectory.points):
            raise LrmError("it has no points of joints, or others")
        if id_ in self._goals:
            raise LrmError("its id was taken by another goal")

    def cancel_goal(self, request: Any, answer: ServiceAnswer, number: int) -> None:
        """Service `cancel_goal`: an id of zeros is any goal that came before, and whatever the door follows.

        Answered when the arm holds.
        """
        id_ = bytes(request.goal_info.goal_id.uuid)
        if every := not any(id_):
            self.door.arrivals.stopped(number)
        with self._lock:
            goals = [goal for goal in self._wanted() if every or id_ == goal.id]
            code = CancelCode.NONE if goals else CancelCode.GOAL_TERMINATED
            if not goals and not every and id_ not in self._goals:
                code = CancelCode.UNKNOWN_GOAL_ID
            for goal in goals:
                goal.cancelled, goal.unwanted = True, "cancelled"
                goal.state = GoalState.CANCELING if goal is self._active else goal.state
            told = [self.node.goal_info(goal.id, goal.stamp) for goal in goals]
            if goals:
                self._tell()

        def respond(held: bool) -> None:
            """Answers, on any thread."""
            answer(return_code=int(code if held else CancelCode.REJECTED), goals_canceling=told if held else [])

        if goals or (every and self.door.busy):
            self._held = time.monotonic()
            self.door.hold(respond)
        else:
            respond(held=True)

    def get_result(self, request: Any, answer: ServiceAnswer, _: int) -> None:
        """Service `get_result`: answered when the goal has ended."""
        with self._lock:
            goal = self._goals.get(bytes(request.goal_id.uuid))
            if goal is None:
                answer(status=int(GoalState.UNKNOWN), result=self.node.result(0, "no such goal"))
            elif goal.state > GoalState.CANCELING:
                answer(status=int(goal.state), result=self.node.result(*goal.result))
            else:
                goal.waiting.append(answer)

    def client(self, token: str, there: bool) -> None:
        """A liveliness token has come, or gone: maybe that of a client."""
        with self._lock:
            for goal in self._wanted():
                if there or token not in goal.clients:
                    continue
                goal.unwanted = "its client is gone: the arm holds"
                if goal is self._active:
                    self._stop(goal, goal.unwanted)

    def _wanted(self) -> list[JointGoal]:
        """The goal that is followed, and those that were offered to the door and are not refused yet."""
        return [*self._offered, *([] if self._active is None else [self._active])]

    def on_state(self, state: JointsState) -> None:
        """Feedback from the commanded angles; holds a motion whose client is silent, again and again."""
        with self._lock:
            goal, now = self._active, time.monotonic()
            if goal is None:
                return
            if not goal.unwanted and self.door.senders.silent(goal.clients):
                self._stop(goal, "its client is silent: the arm holds")
            if goal.unwanted and now - self._held > AGAIN_S:
                self._stop(goal, goal.unwanted)
            if now - self._last > FEEDBACK_S:
                self._last = now
                self.node.publish_feedback(goal.id, state.names, state.q_rad, state.t_wall_ns * 1e-9)

    def forget(self, goal: JointGoal) -> None:
        """A goal was refused."""
        with self._lock:
            self._offered.discard(goal)

    def begin(self, goal: JointGoal) -> None:
        """A goal is followed from now on."""
        with self._lock:
            self._goals[goal.id] = self._active = goal
            self._offered.discard(goal)
            while len(self._goals) > KEPT:
                self._goals.popitem(last=False)
            goal.state = GoalState.EXECUTING
            self._tell()

    def end(self, goal: JointGoal, why: str) -> None:
        """A goal has ended, well if `why` is empty."""
        with self._lock:
            self._active = None
            code = TrajectoryErrorCode.PATH_TOLERANCE_VIOLATED if why else TrajectoryErrorCode.SUCCESSFUL
            goal.result = int(code), f"{goal.unwanted}; {why}" if why and goal.unwanted else why
            goal.state = GoalState.SUCCEEDED if not why else GoalState.ABORTED
            if why and goal.cancelled:
                goal.state = GoalState.CANCELED
            for answer in goal.waiting:
                answer(status=int(goal.state), result=self.node.result(*goal.result))
            goal.waiting.clear()
            self._tell()

    def _stop(self, goal: JointGoal, why: str) -> None:
        goal.unwanted, self._held = why, time.monotonic()
        self.door.hold()

    def _tell(self) -> None:
        self.node.publish_goals([(goal.id, goal.stamp, int(goal.state)) for goal in self._goals.values()])
