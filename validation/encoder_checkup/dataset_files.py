"""A recording as a LeRobot dataset on disk, in the format of v2.1 (a file for each episode) or v3 (several in one)."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow
import pyarrow.parquet as parquet

from validation.encoder_checkup.teleoperation import FPS, Recording

NAMES = [
    f"{name}.pos" for name in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
]
VERSIONS = ("v2.1", "v3.0")


def write_dataset(folder: Path, made: Recording, version: str) -> Path:
    """Writes it; its folder."""
    features = {name: {"dtype": "float32", "shape": [6], "names": NAMES} for name in ("action", "observation.state")}
    info = {"codebase_version": version, "fps": FPS, "robot_type": "so101_follower", "features": features}
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    (folder / "meta").mkdir()
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    table = pyarrow.table(
        {
            "action": pyarrow.array([[*row, 20.0] for row in made.action.tolist()], pyarrow.list_(pyarrow.float32())),
            "observation.state": pyarrow.array(
                [[*row, 20.0] for row in made.state.tolist()], pyarrow.list_(pyarrow.float32())
            ),
            "timestamp": pyarrow.array(made.t, pyarrow.float32()),
            "episode_index": pyarrow.array(made.episode, pyarrow.int64()),
        }
    )
    if version == "v3.0":
        parquet.write_table(table, data / "file-000.parquet")
        return folder
    for episode in sorted(set(made.episode.tolist())):
        rows = made.episode == episode
        parquet.write_table(table.filter(pyarrow.array(rows)), data / f"episode_{episode:06d}.parquet")
    return folder
