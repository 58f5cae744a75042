"""MCAP files of JSON messages that Foxglove shows: `foxglove.SceneUpdate` with lines, arrows, boxes and spheres."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

SCENE = "foxglove.SceneUpdate"
FRAME = "base"
KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
Rgb = tuple[float, float, float]
AHEAD = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class JsonMessage:
    """A message of a topic at a time (ns), with the name of its schema."""

    topic: str
    schema: str
    t: int
    content: Mapping[str, Any]


def mcap_file(messages: Iterable[JsonMessage], library: str) -> bytes:
    """Content of an MCAP file. Raises `LrmError`: mcap is not installed."""
    try:
        from mcap.writer import Writer
    except ImportError:
        raise LrmError("an MCAP file is written with mcap; pip install 'lrm-arm[mcap]'") from None
    content = io.BytesIO()
    writer = Writer(content)
    writer.start(library=library)
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for message in messages:
        if message.schema not in schemas:
            described = json.dumps({"title": message.schema, "type": "object"}).encode()
            schemas[message.schema] = writer.register_schema(message.schema, "jsonschema", described)
        if message.topic not in channels:
            channels[message.topic] = writer.register_channel(message.topic, "json", schemas[message.schema])
        writer.add_message(channels[message.topic], message.t, json.dumps(message.content).encode(), message.t)
    writer.finish()  # type: ignore[no-untyped-call,unused-ignore]
    return content.getvalue()


def scene_message(topic: str, t: int, about: Mapping[str, str], parts: Mapping[str, Any]) -> JsonMessage:
    """A scene of one entity at a time (ns): what is said `about` it, and its parts by their kind."""
    empty: dict[str, Any] = {kind: [] for kind in KINDS}
    stamp = {"sec": t // 1_000_000_000, "nsec": t % 1_000_000_000}
    entity = {
        "timestamp": stamp, "frame_id": FRAME, "id": topic, "frame_locked": True, "lifetime": {"sec": 0, "nsec": 0},
        "metadata": [{"key": key, "value": value} for key, value in about.items()], **empty, **parts,
    }  # fmt: skip
    return JsonMessage(topic, SCENE, t, {"deletions": [], "entities": [entity]})


def line(points: Array, rgb: Rgb, thickness: float = 0.01) -> dict[str, Any]:
    """A line through points (N, 3), m."""
    return {
        "type": 0, "pose": pose(np.zeros(3)), "thickness": thickness, "scale_invariant": False,
        "points": [point(p) for p in points], "color": color(rgb), "colors": [], "indices": [],
    }  # fmt: skip


def solid(centre: Array, size: Sequence[float], rgb: Rgb, opacity: float = 1.0) -> dict[str, Any]:
    """A box, or a sphere, about a place (3,), m, with edges or diameters (m)."""
    return {"pose": pose(centre), "size": point(np.array(size)), "color": {**color(rgb), "a": opacity}}


def pose(place: Array, along: Array = AHEAD) -> dict[str, Any]:
    """A pose whose x axis points along a direction."""
    length = float(np.linalg.norm(along))
    turn = Rotation.align_vectors(along[None] / length, AHEAD[None])[0] if length else Rotation.identity()
    return {"position": point(place), "orientation": dict(zip("xyzw", turn.as_quat().tolist(), strict=True))}


def point(place: Array) -> dict[str, float]:
    """A place (3,), m."""
    return dict(zip("xyz", place.tolist(), strict=True))


def color(rgb: Rgb) -> dict[str, float]:
    """A colour that hides what is behind it."""
    return {**dict(zip("rgb", rgb, strict=True)), "a": 1.0}
