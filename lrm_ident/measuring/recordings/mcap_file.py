"""MCAP files (mcap.dev): poses of bodies and joint states, as ROS 2 records them (CDR) or as JSON.

A body is a topic of poses, or a child frame of a topic of transforms. Times are the messages' own stamps, or where
these are zero the times of recording. Bodies of one tracker share their stamps; where one has none, it was not seen.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake, matrices
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

SUFFIX = ".mcap"
JOINTS = "JointState"
POSES = ("PoseStamped", "PoseWithCovarianceStamped", "PoseInFrame")
TRANSFORMS = ("TransformStamped", "FrameTransform", "TFMessage", "FrameTransforms")
Placed = tuple[float, tuple[float, ...]]
"""Time (s), and x, y, z (m) and quaternion x, y, z, w."""


def read_mcap(path: Path) -> RecordedTake:
    """All bodies of a file. Raises `FileError`: no MCAP file, or none of its topics has poses."""
    values_at: defaultdict[str, dict[float, tuple[float, ...]]] = defaultdict(dict)
    topics: dict[str, str] = {}
    for topic, kind, t, message in _messages(path):
        topics[topic] = kind
        for name, (at, place) in _places(topic, kind, t, message):
            values_at[name][at] = place
    if not values_at:
        raise FileError(path, "", f"has no topic of poses{_listed(topics)}", f"should be {', '.join(POSES)} or a tf")
    times = np.array(sorted({at for track in values_at.values() for at in track}))
    return RecordedTake(path, times, {name: _track(times, track) for name, track in values_at.items()})


def read_joints(path: Path, arm: Arm, t: Array) -> Array:
    """(N, n), joint angles (rad) of an arm that were said last at times (N,), s; the first before it.

    Raises `FileError`: there are none, of several topics, or of other joints.
    """
    at, q = joint_track(path, arm)
    return np.asarray(q[np.maximum(np.searchsorted(at, t, side="right") - 1, 0)])


def joint_track(path: Path, arm: Arm, wanted: str | None = None) -> tuple[Array, Array]:
    """Times (N,), s, ascending, and angles (N, n), rad, of a topic of joint states; `wanted`: its name.

    Raises `FileError`: there are none, of several topics, or of other joints.
    """
    topics: dict[str, str] = {}
    rows: defaultdict[str, list[tuple[float, list[float]]]] = defaultdict(list)
    for topic, kind, recorded, message in _messages(path):
        topics[topic] = kind
        if kind == JOINTS and wanted in (None, topic):
            rows[topic].append((_stamped(message.header.stamp, recorded), _angles(path, topic, message, arm)))
    if not rows and wanted is not None:
        raise FileError(path, "", f"no joint states in {wanted}{_listed(topics)}")
    if len(rows) > 1:
        what = f"has {len(rows)} topics of joint states: {', '.join(sorted(rows))}"
        raise FileError(path, "", what, "should be one sensor_msgs/JointState, or give the poses as a CSV")
    if not rows:
        what = f"has no topic of joint states{_listed(topics)}"
        raise FileError(path, "", what, "should be one sensor_msgs/JointState, or give the poses as a CSV")
    (track,) = rows.values()
    said = dict(sorted(track, key=lambda row: row[0]))
    return np.array([*said]), np.array([*said.values()])


def _angles(path: Path, topic: str, message: Any, arm: Arm) -> list[float]:
    """Angles by the names of the arm's joints, or in their order if these have no names."""
    names, values = list(message.name), list(message.position)
    wanted = [joint.name for joint in arm.joints]
    by_name = dict(zip(names, values, strict=False))
    if not any(wanted) and len(values) == arm.dof:
        return [float(value) for value in values]
    if missing := [name for name in wanted if name not in by_name]:
        right = f"should have {', '.join(name or '?' for name in wanted)}"
        raise FileError(path, topic, f"no joint {missing[0]} among {', '.join(names)}", right)
    return [float(by_name[name]) for name in wanted]


def _places(topic: str, kind: str, t: float, message: Any) -> Iterator[tuple[str, Placed]]:
    """Bodies that a message places, by name."""
    if kind in POSES:
        pose = message.pose.pose if kind == "PoseWithCovarianceStamped" else message.pose
        stamp = message.timestamp if kind == "PoseInFrame" else message.header.stamp
        yield topic, (_stamped(stamp, t), _numbers(pose.position, pose.orientation))
    elif kind in TRANSFORMS:
        for transform in getattr(message, "transforms", [message]):
            ros = hasattr(transform, "transform")
            placed = transform.transform if ros else transform
            stamp = transform.header.stamp if ros else transform.timestamp
            yield transform.child_frame_id, (_stamped(stamp, t), _numbers(placed.translation, placed.rotation))


def _numbers(place: Any, turn: Any) -> tuple[float, ...]:
    return (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)


def _stamped(stamp: Any, recorded: float) -> float:
    """s since 1970; `sec` with `nanosec` (ROS 2) or `nsec` (Foxglove's JSON)."""
    parts = vars(stamp) if isinstance(stamp, SimpleNamespace) else {k: getattr(stamp, k) for k in ("sec", "nanosec")}
    said = parts.get("sec", 0) + 1e-9 * parts.get("nanosec", parts.get("nsec", 0))
    return float(said) if said else recorded


def _track(t: Array, seen: dict[float, tuple[float, ...]]) -> BodyTrack:
    rows = np.array([seen.get(at, (np.nan,) * 7) for at in t.tolist()])
    return BodyTrack(rows[:, :3], matrices(rows[:, 3:]))


def _messages(path: Path) -> Iterator[tuple[str, str, float, Any]]:
    """Topic, last word of the type, time of recording (s) and message, of all that matter. Raises `FileError`."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise LrmError("an MCAP file is read with mcap; pip install 'lrm-arm[mcap]'") from None
    decoders = DecoderFactory()
    try:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                kind = "" if schema is None else schema.name.replace(".", "/").rpartition("/")[2]
                decode = None
                if kind in (JOINTS, *POSES, *TRANSFORMS):
                    decode = _decoder(channel.message_encoding, decoders.decoder_for, schema)
                yield channel.topic, kind, message.log_time * 1e-9, decode and decode(message.data)
    except FileNotFoundError:
        raise FileError(path, "", "no such file") from None
    except (McapError, ValueError, AttributeError, KeyError, EOFError, OSError) as error:
        raise FileError(path, "", f"is no readable MCAP file ({' '.join(str(error).split())[:120]})") from None


def _decoder(encoding: str, of_ros: Callable[..., Any], schema: Any) -> Callable[[bytes], Any]:
    if encoding == "json":
        return lambda data: json.loads(data, object_hook=lambda pairs: SimpleNamespace(**pairs))
    decode: Callable[[bytes], Any] | None = of_ros(encoding, schema)
    if decode is None:
        raise ValueError(f"messages in {encoding}; should be cdr or json")
    return decode


def _listed(topics: dict[str, str]) -> str:
    return f": {', '.join(f'{topic} ({kind})' for topic, kind in sorted(topics.items()))}" if topics else " at all"
