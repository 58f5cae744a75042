"""Types of ROS 2 messages with their texts and hashes, from `rosbags`, so that nothing is fetched from anywhere."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_math.errors import LrmError

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
DISTRIBUTIONS = ("humble", "jazzy", "kilted")
"""Those that have `rmw_zenoh`."""
WITHOUT_HASHES = ("humble",)
NO_HASH = "TypeHashNotSupported"


@dataclass(frozen=True)
class MessageType:
    """Name of a type, its text with those of all that it contains, and its hash as `rmw_zenoh` has it in its keys."""

    name: str
    text: str
    type_hash: str


def message_type(name: str, distribution: str) -> MessageType:
    """A message type of a distribution of ROS 2. Raises `LrmError`: `rosbags` is not installed."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LrmError("the bridge to ROS 2 needs more packages; pip install 'lrm-arm[ros2]'") from None
    store = get_typestore(Stores(f"ros2_{distribution}"))
    text, _ = store.generate_msgdef(name, ros_version=2)
    return MessageType(name, text, NO_HASH if distribution in WITHOUT_HASHES else store.hash_rihs01(name))
