"""Recordings of encoders, and their files as LeRobot's `record` writes them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

FPS = 30
COUNT_DEG = 360.0 / 4096.0
FLICKER_COUNTS = 0.4
"""Standard deviation of a reading before it is rounded."""
VERSIONS = ("v2.1", "v3.0")
NAMES = tuple(
    f"{name}.pos" for name in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
)
GRIPPER_DEG = 20.0


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames: `action`, `state` (N, n), deg; time in the episode (s), episode."""

    action: Array
    state: Array
    t: Array
    episode: NDArray[np.int64]


def encoder_readings(degrees: Array, rng: np.random.Generator) -> Array:
    """Angles (…, n), deg, as encoders of 4096 steps that flicker read them."""
    counts = degrees / COUNT_DEG + rng.normal(scale=FLICKER_COUNTS, size=degrees.shape)
    return np.asarray(np.round(counts) * COUNT_DEG)


def write_dataset(
    folder: Path, made: Recording, version: str = "v3.0", names: Sequence[str] = NAMES, fps: int = FPS
) -> Path:
    """Writes it; its folder. A name more than there are columns is that of a gripper, which stands still.

    v2.1 has a file for each episode; v3.0 files that are cut anywhere, here in the middle.
    """
    import pyarrow
    from pyarrow import parquet

    features = {
        name: {"dtype": "float32", "shape": [len(names)], "names": [*names]} for name in ("action", "observation.state")
    }
    info = {"codebase_version": version, "fps": fps, "robot_type": "so101_follower", "features": features}
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    (folder / "meta").mkdir()
    (folder / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    rest = ((0, 0), (0, len(names) - made.action.shape[1]))
    angles = {
        name: np.pad(values, rest, constant_values=GRIPPER_DEG).tolist()
        for name, values in zip(features, (made.action, made.state), strict=True)
    }
    table = pyarrow.table(
        {
            **{name: pyarrow.array(rows, pyarrow.list_(pyarrow.float32())) for name, rows in angles.items()},
            "timestamp": pyarrow.array(made.t, pyarrow.float32()),
            "episode_index": pyarrow.array(made.episode, pyarrow.int64()),
        }
    )
    if version == "v3.0":
        half = len(table) // 2
        for number, part in enumerate((table[:half], table[half:])):
            parquet.write_table(part, data / f"file-{number:03d}.parquet")
        return folder
    for episode in sorted(set(made.episode.tolist())):
        rows = pyarrow.array(made.episode == episode)
        parquet.write_table(table.filter(rows), data / f"episode_{episode:06d}.parquet")
    return folder
