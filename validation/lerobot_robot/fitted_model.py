"""A model file for a hidden SO-101, fitted by the offline tool to what a tracker measures of it."""

from __future__ import annotations

from pathlib import Path

import lrm_ident as lrm
from examples.so101.hidden_arm import ARM_FILE, JOINTS, NAMED
from validation.synthetic import GroundTruth, load_arm, random_poses, simulate, write

POSES, NOISE_M = 120, 0.0002
LIMIT_DEG = 75.0


def fit_hidden(truth: GroundTruth, effect: str, seed: int, folder: Path) -> Path:
    """Measures random poses, fits, and writes model.toml; its path."""
    arm = load_arm(ARM_FILE)
    q = random_poses(arm, POSES, seed, LIMIT_DEG)
    table, _, _ = write(folder / "measured", simulate(arm, truth, q, 0.0, NOISE_M, seed), "validation.lerobot_robot")
    data = lrm.load(table, "so101")
    joints = [f"offsets@joint{number}" for number in range(1, JOINTS + 1)]
    model = folder / "model.toml"
    lrm.save(lrm.fit(data, [*joints, "compliance", NAMED[effect][0]]), data, model)
    return model
