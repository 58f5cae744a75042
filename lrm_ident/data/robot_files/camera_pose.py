"""Where a camera stands at an arm's base, for programs of others: ROS 2 and MoveIt, or any that reads numbers.

A `.launch.py` is the file that MoveIt's hand-eye calibration saves: it starts `static_transform_publisher` of tf2. A
`.yaml` is a `geometry_msgs/TransformStamped`. A `.json` is for programs without a format of their own (LeRobot has
none for a camera's place). The camera's frame is the optical one of ROS and OpenCV: z ahead, x right, y down.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lrm_ident.data.rigid_motion import quaternions
from lrm_math.arrays import Array
from lrm_math.errors import FileError

AXES, TURNS = "xyz", "xyzw"
DIGITS = 9


def camera_pose_text(path: Path, camera: Array, base: str, frame: str) -> str:
    """Text of the file at a path, by its ending, of a camera (4, 4), m, at the link `base`. Raises `FileError`."""
    writers: dict[str, Callable[[Array, str, str], str]] = {".py": _launch, ".yaml": _transform, ".json": _numbers}
    if path.suffix not in writers or (path.suffix == ".py" and not path.name.endswith(".launch.py")):
        raise FileError(path, "", f"a {path.suffix or 'nameless'} file", "name it .launch.py, .yaml or .json")
    return writers[path.suffix](camera, base, frame)


def _parts(camera: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Components x, y, z (m), and x, y, z, w of the unit quaternion."""
    w, *vector = quaternions(camera[None, :3, :3])[0].round(DIGITS).tolist()
    at = camera[:3, 3].round(DIGITS).tolist()
    return dict(zip(AXES, at, strict=True)), dict(zip(TURNS, (*vector, w), strict=True))


def _launch(camera: Array, base: str, frame: str) -> str:
    at, turn = _parts(camera)
    words = {"--frame-id": base, "--child-frame-id": frame}
    words |= {f"--{axis}": f"{x:.9g}" for axis, x in at.items()}
    words |= {f"--q{axis}": f"{x:.9g}" for axis, x in turn.items()}
    arguments = "\n".join(f"                {json.dumps(name)}, {json.dumps(value)}," for name, value in words.items())
    return (
        f'"""EYE-TO-HAND: {base} -> {frame}, by lrm-ident camera export."""\n'
        "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n\n\n"
        "def generate_launch_description() -> LaunchDescription:\n"
        "    nodes = [\n        Node(\n"
        '            package="tf2_ros", executable="static_transform_publisher", output="log",\n'
        f"            arguments=[\n{arguments}\n            ],\n        ),\n    ]\n"
        "    return LaunchDescription(nodes)\n"
    )


def _transform(camera: Array, base: str, frame: str) -> str:
    at, turn = (", ".join(f"{axis}: {x!r}" for axis, x in part.items()) for part in _parts(camera))
    return (
        f"header: {{frame_id: {json.dumps(base)}}}\nchild_frame_id: {json.dumps(frame)}\n"
        f"transform:\n  translation: {{{at}}}  # m\n  rotation: {{{turn}}}\n"
    )


def _numbers(camera: Array, base: str, frame: str) -> str:
    at, turn = _parts(camera)
    layouts = {
        "frame": frame, "parent_frame": base, "position_m": [*at.values()], "quaternion_xyzw": [*turn.values()],
        "matrix_m": np.round(camera, DIGITS).tolist(),
    }  # fmt: skip
    return json.dumps(layouts, indent=4) + "\n"
