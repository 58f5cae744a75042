"""A comparison as an MCAP file of Foxglove's scenes (`foxglove.SceneUpdate`, JSON): one message for each pose.

Topics: `/arm`, the line through the joints to the tip; `/errors/0_nominal`, an arrow at the tip, the error of the arm
as drawn as `position_error` signs it; and one for the model after each step of its history, such as `/errors/1_fit` and
`/errors/2_add_backlash@joint2`. Pose number k stands at k seconds. Arrows are as long as the errors, times `ENLARGED`.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

ENLARGED = 20.0
SCHEMA = "foxglove.SceneUpdate"
FRAME = "base"
GREY, RED, BLUE = (0.5, 0.5, 0.5), (0.9, 0.2, 0.1), (0.1, 0.3, 0.9)
SECOND = 1_000_000_000


def scene_file(found: ModelComparison, models: Sequence[tuple[str, Model]]) -> bytes:
    """Content of the file; `models`: after each step, by its name. Raises `LrmError`: mcap is not installed."""
    try:
        from mcap.writer import Writer
    except ImportError:
        raise LrmError("an MCAP file is written with mcap; pip install 'lrm-arm[mcap]'") from None
    data, equilibrium = found.data, found.equilibrium
    steps = [("nominal", nominal_arm(equilibrium.model.arm, data)), *models]
    errors = {
        topic_of(k, name): (name, data.position_error(solve_equilibrium(model, data.poses)))
        for k, (name, model) in enumerate(steps)
    }
    lines = frames(equilibrium.model.chain, equilibrium.slots, len(data.poses))[:, :, :3, 3]
    content = io.BytesIO()
    writer = Writer(content)
    writer.start(library="lrm-ident")
    schema = writer.register_schema(SCHEMA, "jsonschema", json.dumps({"title": SCHEMA, "type": "object"}).encode())
    channels = {topic: writer.register_channel(topic, "json", schema) for topic in ("/arm", *errors)}
    for k, number in enumerate(data.pose.tolist()):
        t = int(number) * SECOND
        scenes: list[tuple[str, str, dict[str, Any]]] = [("/arm", "arm", {"lines": [_line(lines[k])]})]
        for place, (topic, (name, error)) in enumerate(errors.items()):
            arrow = _arrow(lines[k, -1], error[k], _between(place / max(len(errors) - 1, 1)))
            scenes.append((topic, name, {"arrows": [arrow]}))
        for topic, name, parts in scenes:
            said = json.dumps({"deletions": [], "entities": [_entity(topic, name, int(number), parts)]}).encode()
            writer.add_message(channels[topic], t, said, t)
    writer.finish()  # type: ignore[no-untyped-call,unused-ignore]
    return content.getvalue()


def topic_of(number: int, step: str) -> str:
    """Topic of the errors after a step: its number, 0 for the arm as drawn, and its name."""
    return f"/errors/{number}_{re.sub(r'[^A-Za-z0-9@<+.-]+', '_', step)}"


def _between(share: float) -> tuple[float, float, float]:
    """A colour from red to blue."""
    red, green, blue = ((1.0 - share) * a + share * b for a, b in zip(RED, BLUE, strict=True))
    return red, green, blue


def _entity(topic: str, step: str, pose: int, parts: Mapping[str, Any]) -> dict[str, Any]:
    empty: dict[str, Any] = {
        kind: [] for kind in ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    }
    head = {"timestamp": {"sec": pose, "nsec": 0}, "frame_id": FRAME, "id": topic, "frame_locked": True}
    about = [{"key": "step", "value": step}, {"key": "pose", "value": str(pose)}]
    about += [{"key": "arrows_enlarged", "value": f"{ENLARGED:g}"}]
    return {**head, "lifetime": {"sec": 0, "nsec": 0}, "metadata": about, **empty, **parts}


def _line(points: Array) -> dict[str, Any]:
    line = {"type": 0, "pose": _pose(np.zeros(3), np.array([1.0, 0.0, 0.0])), "thickness": 0.01}
    return {
        **line, "scale_invariant": False, "points": [_point(p) for p in points], "color": _color(GREY), "colors": [],
        "indices": [],
    }  # fmt: skip


def _arrow(tail: Array, error: Array, color: tuple[float, float, float]) -> dict[str, Any]:
    """An arrow along an error (3,), m, from a place."""
    length = ENLARGED * float(np.linalg.norm(error))
    shape = {"shaft_length": 0.8 * length, "shaft_diameter": 0.004, "head_length": 0.2 * length, "head_diameter": 0.01}
    return {"pose": _pose(tail, error), **shape, "color": _color(color)}


def _pose(place: Array, along: Array) -> dict[str, Any]:
    """A pose whose x axis points along a direction."""
    length = float(np.linalg.norm(along))
    turn = Rotation.align_vectors(along[None] / length, [[1.0, 0.0, 0.0]])[0] if length else Rotation.identity()
    return {"position": _point(place), "orientation": dict(zip("xyzw", turn.as_quat().tolist(), strict=True))}


def _point(place: Array) -> dict[str, float]:
    return dict(zip("xyz", place.tolist(), strict=True))


def _color(rgb: tuple[float, float, float]) -> dict[str, float]:
    return {**dict(zip("rgb", rgb, strict=True)), "a": 1.0}
