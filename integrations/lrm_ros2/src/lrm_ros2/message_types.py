"""Types of ROS 2 messages and services, their texts and hashes, from `rosbags`: nothing is fetched from anywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from lrm_math.errors import LrmError
from lrm_ros2.action_types import SERVICES, TEXTS

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
DISTRIBUTIONS = ("humble", "jazzy", "kilted")
"""Those that have `rmw_zenoh`."""
WITHOUT_HASHES = ("humble",)
NO_HASH = "TypeHashNotSupported"
EVENT = "service_msgs/msg/ServiceEventInfo"


@dataclass(frozen=True)
class MessageType:
    """Name of a type, its text with those of all that it contains, and its hash as `rmw_zenoh` has it in its keys."""

    name: str
    text: str
    type_hash: str


def message_type(name: str, distribution: str) -> MessageType:
    """A message type of a distribution of ROS 2. Raises `LrmError`: `rosbags` is not installed."""
    text, _ = type_store(distribution).generate_msgdef(as_message(name), ros_version=2)
    return MessageType(name, text, type_hash(name, distribution))


def as_message(name: str) -> str:
    """Name under which a part of a service or an action has a text: texts know messages only."""
    return name.replace("/srv/", "/msg/").replace("/action/", "/msg/")


def type_hash(name: str, distribution: str) -> str:
    """Hash of a message's or a service's type as `rmw_zenoh` has it in its keys. Raises `LrmError`."""
    if distribution in WITHOUT_HASHES:
        return NO_HASH
    return str(type_store(distribution).hash_rihs01(name))


@cache
def type_store(distribution: str) -> Any:
    """All types of a distribution, to write and read messages of. Raises `LrmError`: `rosbags` is not installed."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LrmError("the bridge to ROS 2 needs more packages; pip install lrm-ros2") from None
    store = get_typestore(Stores(f"ros2_{distribution}"))
    add_types(store, TEXTS, SERVICES if distribution not in WITHOUT_HASHES else ())
    return store


def add_types(store: Any, texts: Mapping[str, str], services: Sequence[str]) -> None:
    """Adds messages by their texts, and services of such messages, to a store of `rosbags`."""
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    parsed = "lrm/msg/Parsed"
    for named in (as_message, str):
        store.register({named(n): get_types_from_msg(named(text), parsed)[parsed] for n, text in texts.items()})
    if services:
        constants, event = store.fielddefs[EVENT]  # whose `char` is an octet: rosidl hashes it as one, rosbags does not
        store.fielddefs[EVENT] = constants, [(name, _octets(field, Nodetype)) for name, field in event]
    for service in services:
        store.register(_service_structs(service, Nodetype))


def _octets(field: Any, kind: Any) -> Any:
    octet = (kind.BASE, ("uint8", 0))
    return (kind.ARRAY, (octet, field[1][1])) if field[0] == kind.ARRAY else field


def _service_structs(service: str, kind: Any) -> dict[str, Any]:
    """A service as the type of its request, response and event, whose hash is its own (REP 2016)."""
    said, answered, event = (f"{service}_{part}" for part in ("Request", "Response", "Event"))
    one = [(kind.SEQUENCE, ((kind.NAME, name), 1)) for name in (said, answered)]
    info = (kind.NAME, EVENT)
    parts = zip(("request_message", "response_message", "event_message"), (said, answered, event), strict=True)
    return {
        event: ([], [("info", info), ("request", one[0]), ("response", one[1])]),
        service: ([], [(name, (kind.NAME, of)) for name, of in parts]),
    }
