"""LeRobot: rests of a v3 dataset with joint feedback."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from tests.support.commands import stderr_of, stdout_of

FPS, REST_S, MOVE_S = 30, 2.0, 1.0


@pytest.fixture(scope="module")
def so101() -> Arm:
    return load_arm("so101")


def written(folder: Path, arm: Arm, poses: Array, droop_deg: Array) -> Path:
    """Two episodes in which the arm rests at every pose (R, n) in deg, its servos `droop_deg` (R, n) off."""
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")
    parquet = pytest.importorskip("pyarrow.parquet")
    rng = np.random.default_rng(0)
    names = [*(f"{joint.name}.pos" for joint in arm.joints), "gripper.pos"]
    rows: list[dict[str, object]] = []
    for episode, half in enumerate(np.array_split(np.arange(len(poses)), 2)):
        frame = 0
        for before, pose in zip([half[0], *half[:-1]], half, strict=True):
            for step in range(int(FPS * MOVE_S)):
                share = (step + 1) / (FPS * MOVE_S)
                q = poses[before] + share * (poses[pose] - poses[before])
                rows.append(row_of(q, q + droop_deg[pose], frame, episode))
                frame += 1
            for _ in range(int(FPS * REST_S)):
                read = poses[pose] + droop_deg[pose] + rng.normal(0, 0.05, poses.shape[1])
                rows.append(row_of(poses[pose], read, frame, episode))
                frame += 1
    (folder / "meta").mkdir(parents=True)
    features = {name: {"dtype": "float32", "shape": [6], "names": names} for name in ("action", "observation.state")}
    info = {"codebase_version": "v3.0", "fps": FPS, "robot_type": "so101_follower", "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    half = len(rows) // 2
    for number, part in enumerate((rows[:half], rows[half:])):
        table = pyarrow.Table.from_pylist(part)
        parquet.write_table(table, folder / "data" / "chunk-000" / f"file-{number:03d}.parquet")
    return folder


def row_of(command: Array, read: Array, frame: int, episode: int) -> dict[str, object]:
    return {
        "action": [*command.tolist(), 10.0],
        "observation.state": [*read.tolist(), 11.0],
        "timestamp": frame / FPS,
        "episode_index": episode,
    }


def test_rests_are_found_with_their_feedback(so101: Arm, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses, droop = rng.uniform(-60, 60, (12, 5)), rng.normal(0, 1.0, (12, 5))
    folder = written(tmp_path / "dataset", so101, poses, droop)
    out = tmp_path / "poses.csv"
    said = stdout_of("import", "lerobot", folder, "--arm", "so101", "-o", out)
    assert "12 stops of 2 episodes" in said
    read = load_poses(out, so101)
    np.testing.assert_allclose(np.degrees(read.q), poses, atol=0.02)
    assert read.session is not None
    table = np.genfromtxt(out, delimiter=",", names=True)
    feedback = np.stack([table[f"q{i}_meas_deg"] for i in range(1, 6)], axis=1)
    np.testing.assert_allclose(feedback, poses + droop, atol=0.05)
    assert "feedback_sd_deg = 0.0" in out.with_suffix(".toml").read_text()


def test_what_is_no_such_dataset(so101: Arm, tmp_path: Path) -> None:
    folder = written(tmp_path / "dataset", so101, np.zeros((2, 5)), np.zeros((2, 5)))
    out = tmp_path / "poses.csv"
    assert "no joint 'joint1'" in stderr_of("import", "lerobot", folder, "--arm", "ur5", "-o", out)
    refusal = stderr_of("import", "lerobot", folder, "--dwell", "60", "-o", out)
    assert "no stop of 60 s; state a shorter one (--dwell)" in refusal
    info = folder / "meta" / "info.json"
    info.write_text(info.read_text().replace("v3.0", "v1.6"))
    assert "v1.6; v2.1 or v3.0" in stderr_of("import", "lerobot", folder, "-o", out)
    assert "no such file" in stderr_of("import", "lerobot", tmp_path / "none", "-o", out)
    assert not out.exists()
