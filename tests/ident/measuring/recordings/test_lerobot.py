"""LeRobot: rests of a v3 dataset with joint feedback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from tests.support.commands import stderr_of, stdout_of
from validation.lerobot_dataset import Recording, write_dataset

FPS, REST_S, MOVE_S = 30, 2.0, 1.0


def written(folder: Path, poses: Array, droop_deg: Array) -> Path:
    """Two episodes in which the arm rests at every pose (R, n) in deg, its servos `droop_deg` (R, n) off."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")
    rng, parts = np.random.default_rng(0), list[Array]()
    move, rest = int(FPS * MOVE_S), int(FPS * REST_S)
    for episode, half in enumerate(np.array_split(np.arange(len(poses)), 2)):
        rows = []
        for before, pose in zip([half[0], *half[:-1]], half, strict=True):
            share = (np.arange(move)[:, None] + 1.0) / move
            q = np.concatenate([poses[before] + share * (poses[pose] - poses[before]), np.tile(poses[pose], (rest, 1))])
            trembling = np.concatenate([np.zeros((move, q.shape[1])), rng.normal(0, 0.05, (rest, q.shape[1]))])
            rows.append(np.concatenate([q, q + droop_deg[pose] + trembling], axis=1))
        angles = np.concatenate(rows)
        count = np.arange(len(angles))[:, None]
        parts.append(np.concatenate([angles, count / FPS, np.full(count.shape, episode)], axis=1))
    action, state, t, episodes = np.split(np.concatenate(parts), [5, 10, 11], axis=1)
    return write_dataset(folder, Recording(action, state, t[:, 0], episodes[:, 0].astype(int)))


def test_rests_are_found_with_their_feedback(so101: Arm, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses, droop = rng.uniform(-60, 60, (12, 5)), rng.normal(0, 1.0, (12, 5))
    folder = written(tmp_path / "dataset", poses, droop)
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


def test_what_is_no_such_dataset(tmp_path: Path) -> None:
    folder = written(tmp_path / "dataset", np.zeros((2, 5)), np.zeros((2, 5)))
    out = tmp_path / "poses.csv"
    assert "no joint 'joint1'" in stderr_of("import", "lerobot", folder, "--arm", "ur5", "-o", out)
    refusal = stderr_of("import", "lerobot", folder, "--dwell", "60", "-o", out)
    assert "no stop of 60 s; state a shorter one (--dwell)" in refusal
    info = folder / "meta" / "info.json"
    info.write_text(info.read_text().replace("v3.0", "v1.6"))
    assert "v1.6; v2.1 or v3.0" in stderr_of("import", "lerobot", folder, "-o", out)
    assert "no such file" in stderr_of("import", "lerobot", tmp_path / "none", "-o", out)
    assert not out.exists()
