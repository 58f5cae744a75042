"""The side of ROS 2: topics and services, by `zenoh-ros2-sdk`, which has the conventions of `rmw_zenoh`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
from zenoh import ConsolidationMode

from lrm_math.errors import LrmError
from lrm_ros2.action_types import ACTION, BODY_POINT, FEEDBACK, POINT, STATUS
from lrm_ros2.arrivals import Arrivals
from lrm_ros2.diagnostics import DiagnosticRow
from lrm_ros2.message_types import (
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
    JOINT_TRAJECTORY,
    as_message,
    message_type,
    type_store,
)
from lrm_ros2.ros_endpoints import Handler, RosListener, RosService
from lrm_ros2.sender_watch import SILENT_S

NODE = "lrm_bridge"
TOPIC_NAME, ACTION_NAME = "joint_trajectory", "follow_joint_trajectory/_action"


@dataclass(frozen=True)
class RosNetwork:
    """Address of ROS's zenoh router, its distribution, and the domain's number."""

    host: str = "127.0.0.1"
    port: int = 7447
    distribution: str = "jazzy"
    domain: int = 0


class RosNode:
    """Topics of the bridge in a namespace such as `/lrm`: `joint_states`, `diagnostics`, `joint_trajectory`.

    Raises `LrmError` where it is opened: a package is missing, or there is no router.
    """

    def __init__(self, network: RosNetwork, namespace: str, arrivals: Arrivals) -> None:
        self._arrivals = arrivals
        self._network, self._namespace = network, namespace.rstrip("/")
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        try:
            import zenoh_ros2_sdk as sdk
        except ImportError:
            raise LrmError("the bridge to ROS 2 needs more packages; pip install lrm-ros2") from None
        where = f"{self._network.host}:{self._network.port}"
        with ExitStack() as stack:
            self._sdk, self._session = sdk, _session(sdk, self._network, where)
            session = self._session
            stack.callback(session.close)
            self._types = session.store.types
            self._joints = self._open(stack, "joint_states", JOINT_STATE)
            self._diagnostics = self._open(stack, "/diagnostics", DIAGNOSTIC_ARRAY)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def publish_joints(self, names: Sequence[str], q: Sequence[float], t: float) -> None:
        """Publishes commanded angles (rad) of a time (s since 1970); velocity and effort are not known: empty."""
        none = np.zeros(0)
        self._joints.publish(
            header=self._header(t), name=list(names), position=np.array(q, dtype=np.float64), velocity=none, effort=none
        )

    def publish_diagnostics(self, rows: Sequence[DiagnosticRow], hardware: str) -> None:
        """Publishes rows, all of one robot."""
        self._diagnostics.publish(header=self._header(time.time()), status=[self._status(r, hardware) for r in rows])

    def take_trajectories(self, take: Callable[[Any, int], None]) -> None:
        """Subscribes to trajectories, until the node is closed: `take` gets each and its number. Opens what tells of
        goals."""
        whole = f"{self._namespace}/{TOPIC_NAME}"
        listener = RosListener(
            self._sdk, self._session, self._network, whole, JOINT_TRAJECTORY, NODE, self._arrivals, take
        )
        self._stack.callback(listener.close)
        self._feedback = self._open(self._stack, f"{ACTION_NAME}/feedback", FEEDBACK)
        self._goals = self._open(self._stack, f"{ACTION_NAME}/status", STATUS)

    def serve(self, name: str, service: str, handler: Handler, stops: bool = False) -> None:
        """Opens a service in the namespace, until the node is closed. `stops`: whatever is asked of it is a stop."""
        whole = f"{self._namespace}/{name}"
        opened = RosService(
            self._sdk, self._session, self._network, whole, service, NODE, self._arrivals, handler, stops
        )
        self._stack.callback(opened.close)

    def watch_tokens(self, on_token: Callable[[str, bool], object]) -> None:
        """Tells of each liveliness token of the domain when it comes (True) and goes (False), in order of arrival."""

        def heard(sample: Any, _: int) -> None:
            """A token of any entity."""
            on_token(str(sample.key_expr), str(sample.kind).endswith("PUT"))

        key = f"@ros2_lv/{self._network.domain}/**"
        opened = self._session.liveliness.declare_subscriber(key, self._arrivals.taken_by(heard), history=True)
        self._stack.callback(opened.undeclare)

    def ask_session(self, other: str, answered: Callable[[], None]) -> None:
        """Asks another session of zenoh whether it runs; `answered` is called if it does, in order of arrival."""

        def heard(reply: Any, _: int) -> None:
            """Its answer, or that there is none."""
            if reply.ok is not None:
                answered()

        self._session.session.get(
            f"@/{other}/*", self._arrivals.taken_by(heard), timeout=SILENT_S, consolidation=ConsolidationMode.NONE
        )

    def publish_feedback(self, goal: bytes, names: Sequence[str], q: Sequence[float], t: float) -> None:
        """Publishes commanded angles (rad) of a goal; what is measured is not known: empty."""
        none = np.zeros(0)
        zero = self._types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
        point = partial(self._types[POINT], velocities=none, accelerations=none, effort=none, time_from_start=zero)
        body = self._types[BODY_POINT](transforms=[], velocities=[], accelerations=[], time_from_start=zero)
        told = self._types[as_message(f"{ACTION}_Feedback")](
            header=self._header(t), joint_names=list(names), desired=point(positions=np.array(q, dtype=np.float64)),
            actual=point(positions=none), error=point(positions=none), multi_dof_joint_names=[],
            multi_dof_desired=body, multi_dof_actual=body, multi_dof_error=body,
        )  # fmt: skip
        self._feedback.publish(goal_id=self._uuid(goal), feedback=told)

    def publish_goals(self, goals: Sequence[tuple[bytes, float, int]]) -> None:
        """Publishes the states of goals, each with its id and when it came (s since 1970)."""
        status = self._types["action_msgs/msg/GoalStatus"]
        self._goals.publish(
            status_list=[status(goal_info=self.goal_info(id_, t), status=state) for id_, t, state in goals]
        )

    def goal_info(self, goal: bytes, t: float) -> Any:
        """A goal's id, and when it came (s since 1970)."""
        return self._types["action_msgs/msg/GoalInfo"](goal_id=self._uuid(goal), stamp=self.stamp(t))

    def result(self, code: int, text: str) -> Any:
        """The result of a goal."""
        return type_store(self._network.distribution).types[f"{ACTION}_Result"](error_code=code, error_string=text)

    def stamp(self, t: float) -> Any:
        """A time (s since 1970) as ROS has it."""
        whole = math.floor(t)
        return self._types["builtin_interfaces/msg/Time"](sec=whole, nanosec=min(int((t - whole) * 1e9), 999_999_999))

    def _uuid(self, goal: bytes) -> Any:
        return self._types["unique_identifier_msgs/msg/UUID"](uuid=np.frombuffer(goal, dtype=np.uint8))

    def _open(self, stack: ExitStack, topic: str, name: str) -> Any:
        """A publisher. Type and hash are given: the SDK would clone their repositories from the net."""
        of = message_type(name, self._network.distribution)
        whole = topic if topic.startswith("/") else f"{self._namespace}/{topic}"
        opened = self._sdk.ROS2Publisher(
            topic=whole, msg_type=name, msg_definition=of.text, type_hash=of.type_hash, node_name=NODE,
            domain_id=self._network.domain, router_ip=self._network.host, router_port=self._network.port,
        )  # fmt: skip
        stack.callback(opened.close)
        return opened

    def _header(self, t: float) -> Any:
        return self._types["std_msgs/msg/Header"](stamp=self.stamp(t), frame_id="")

    def _status(self, row: DiagnosticRow, hardware: str) -> Any:
        pair = self._types["diagnostic_msgs/msg/KeyValue"]
        values = [pair(key=key, value=value) for key, value in row.values]
        status = self._types["diagnostic_msgs/msg/DiagnosticStatus"]
        return status(level=int(row.level), name=row.name, message=row.text, hardware_id=hardware, values=values)


def _session(sdk: Any, network: RosNetwork, where: str) -> Any:
    """The SDK's session, connected. Raises `LrmError`: no router answers within a second or so."""
    import socket

    try:
        socket.create_connection((network.host, network.port), timeout=2.0).close()
        return sdk.ZenohSession.get_instance(network.host, network.port)
    except Exception as error:  # zenoh raises its own kind, of no fixed base
        why = str(error).split(" at /")[0]
        raise LrmError(f"no zenoh router of ROS 2 at {where} ({why}); is rmw_zenohd running there?") from None
