"""The side of ROS 2: two publishers and a subscriber, by `zenoh-ros2-sdk`, which has the conventions of `rmw_zenoh`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np

from lrm_math.errors import LrmError
from lrm_ros2.diagnostics import DiagnosticRow
from lrm_ros2.message_types import DIAGNOSTIC_ARRAY, JOINT_STATE, JOINT_TRAJECTORY, message_type

NODE = "lrm_bridge"


@dataclass(frozen=True)
class RosNetwork:
    """Where ROS's zenoh router listens, of which distribution it is, and the domain's number."""

    host: str = "127.0.0.1"
    port: int = 7447
    distribution: str = "jazzy"
    domain: int = 0


class RosNode:
    """Topics of the bridge in a namespace such as `/lrm`: `joint_states`, `diagnostics`, `joint_trajectory`.

    `on_trajectory`: called with each trajectory, on a thread of zenoh; None: none is subscribed to.
    Raises `LrmError` where it is opened: a package is missing, or there is no router.
    """

    def __init__(self, network: RosNetwork, namespace: str, on_trajectory: Callable[[Any], None] | None) -> None:
        self._network, self._namespace, self._on_trajectory = network, namespace.rstrip("/"), on_trajectory
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        try:
            import zenoh_ros2_sdk as sdk
        except ImportError:
            raise LrmError("the bridge to ROS 2 needs more packages; pip install 'lrm-arm[ros2]'") from None
        where = f"{self._network.host}:{self._network.port}"
        with ExitStack() as stack:
            session = _session(sdk, self._network, where)
            stack.callback(session.close)
            open_one = partial(self._open, stack)
            self._types = session.store.types
            self._joints = open_one(sdk.ROS2Publisher, "joint_states", JOINT_STATE)
            self._diagnostics = open_one(sdk.ROS2Publisher, "/diagnostics", DIAGNOSTIC_ARRAY)
            if self._on_trajectory is not None:
                listener = partial(sdk.ROS2Subscriber, callback=self._on_trajectory)
                open_one(listener, "joint_trajectory", JOINT_TRAJECTORY)
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

    def _open(self, stack: ExitStack, kind: Callable[..., Any], topic: str, name: str) -> Any:
        """A publisher or subscriber. Type and hash are given: the SDK would clone their repositories from the net."""
        of = message_type(name, self._network.distribution)
        whole = topic if topic.startswith("/") else f"{self._namespace}/{topic}"
        opened = kind(
            topic=whole, msg_type=name, msg_definition=of.text, type_hash=of.type_hash, node_name=NODE,
            domain_id=self._network.domain, router_ip=self._network.host, router_port=self._network.port,
        )  # fmt: skip
        stack.callback(opened.close)
        return opened

    def _header(self, t: float) -> Any:
        whole = math.floor(t)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=whole, nanosec=min(int((t - whole) * 1e9), 999_999_999))
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id="")

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
