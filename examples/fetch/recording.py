"""A run as an MCAP file for Foxglove: `/joint_states`, `/tip`, `/scene`, `/stones`, `/events`, by the board's clock.

`/joint_states` are the angles of the board's pulses, `/tip` is where the true arm then has its tip, `/scene` shows the
arm as commanded, `/stones` what lies and stands around it, and an event is what a skill or a whole fetch came to.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.fetch.distance_check import frames_of
from examples.fetch.places import RADIUS, Stone
from lrm_ident.report.plots.foxglove import JsonMessage, line, mcap_file, point, scene_message, solid
from lrm_math.arrays import Array, Vector3
from validation import synthetic

EVERY_S = 0.2
SECOND = 1_000_000_000
ARM, STONE, BOX = (0.1, 0.3, 0.9), (0.4, 0.3, 0.2), (0.7, 0.7, 0.7)


def recorded(
    arm_file: Path, t: Array, q: Array, tips: Array, notes: Sequence[tuple[float, str]], stones: Sequence[Stone]
) -> bytes:
    """Content of the file, of a run: times (N,), s, angles (N, n), rad, of the joints, and tips (N, 3), m.

    Raises `LrmError`: mcap is not installed.
    """
    arm = tomllib.loads(arm_file.read_text(encoding="utf-8"))
    messages = [*_moving(arm, t, q, tips), *_standing(arm, t, stones), *_told(notes)]
    return mcap_file(sorted(messages, key=lambda message: message.t), "examples.fetch")


def thinned(t: Array) -> NDArray[np.intp]:
    """(K,), numbers of the first of the times (N,), s, in every `EVERY_S`."""
    return np.unique((t / EVERY_S).astype(np.intp), return_index=True)[1]


def true_tips(
    arm: synthetic.ArmDescription,
    truth: synthetic.GroundTruth,
    t: Array,
    q: Array,
    loads: Sequence[tuple[float, float]],
    grounds: Sequence[tuple[float, Vector3]] = (),
) -> Array:
    """(N, 3), m, of the true arm at times (N,), s, and angles (N, n), rad.

    Args:
        loads: kg from a time on. grounds: gravity (m/s²) from a time on; before, that of the arm.
    """
    since, masses = np.array([(-np.inf, 0.0), *loads]).T
    payload = masses[np.searchsorted(since, t, side="right") - 1]
    tips = np.empty((len(t), 3))
    below = [(-np.inf, arm.gravity_m_per_s2), *grounds]
    number = np.searchsorted([at for at, _ in below], t, side="right") - 1
    for ground in np.unique(number):
        rows = number == ground
        there = replace(arm, gravity_m_per_s2=below[ground][1])
        schedule = synthetic.Schedule(t[rows], np.ones(int(rows.sum())), q[0])
        tips[rows] = synthetic.true_state(there, truth, q[rows], payload[rows], schedule).tcp_m
    return tips


def _moving(arm: dict[str, Any], t: Array, q: Array, tips: Array) -> Iterator[JsonMessage]:
    names = [f"joint{i}" for i in range(1, q.shape[1] + 1)]
    joints = np.array([frame[:, :3, 3] for frame in frames_of(arm, q)])
    for k, ns in enumerate((t * SECOND).astype(np.int64).tolist()):
        stamp = {"sec": ns // SECOND, "nanosec": ns % SECOND}
        header = {"stamp": stamp, "frame_id": "base"}
        state = {"header": header, "name": names, "position": q[k].tolist(), "velocity": [], "effort": []}
        yield JsonMessage("/joint_states", "sensor_msgs/JointState", ns, state)
        yield JsonMessage("/tip", "geometry_msgs/PointStamped", ns, {"header": header, "point": point(tips[k])})
        yield scene_message("/scene", ns, {"what": "arm as commanded"}, {"lines": [line(joints[:, k], ARM)]})


def _standing(arm: dict[str, Any], t: Array, stones: Sequence[Stone]) -> Iterator[JsonMessage]:
    """The stones where they lie, and what stands around the arm, once."""
    ns = int(t[0] * SECOND) if len(t) else 0
    base = frames_of(arm, np.zeros((1, len(arm["joint"]))))[0]
    boxes = []
    for box in arm["box"]:
        frame = base[0] if box.get("frame") == "base" else np.eye(4)
        centre = frame[:3, :3] @ (1e-3 * np.array(box["center_mm"])) + frame[:3, 3]
        boxes.append(solid(centre, [1e-3 * size for size in box["size_mm"]], BOX, 0.3))
    spheres = [solid(stone.place, [2 * RADIUS] * 3, STONE) for stone in stones]
    yield scene_message(
        "/stones", ns, {"what": "stones, and boxes of the arm file"}, {"cubes": boxes, "spheres": spheres}
    )


def _told(notes: Sequence[tuple[float, str]]) -> Iterator[JsonMessage]:
    for at, text in notes:
        ns = int(at * SECOND)
        stamp = {"sec": ns // SECOND, "nsec": ns % SECOND}
        log = {"timestamp": stamp, "level": 2, "message": text, "name": "fetch", "file": "", "line": 0}
        yield JsonMessage("/events", "foxglove.Log", ns, log)
