"""A model file for a hidden arm, fitted by the offline tool to what a tracker measures of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import lrm_ident as lrm
from examples.so101.hidden_arm import ARM_FILE, JOINTS, NAMED
from validation.synthetic import ArmDescription, GroundTruth, load_arm, random_poses, simulate, write

POSES, NOISE_M = 120, 0.0002
LIMIT_DEG = 75.0


def fit_hidden(truth: GroundTruth, effect: str, seed: int, folder: Path) -> Path:
    """The model of an SO-101 with an effect at one joint."""
    joints = [f"offsets@joint{number}" for number in range(1, JOINTS + 1)]
    names = [*joints, "compliance", NAMED[effect][0]]
    return fitted_model("so101", load_arm(ARM_FILE), truth, names, seed, folder, LIMIT_DEG)


def fitted_model(
    arm: str,
    description: ArmDescription,
    truth: GroundTruth,
    names: Sequence[str],
    seed: int,
    folder: Path,
    limit_deg: float | None = None,
) -> Path:
    """Measures random poses within limits (deg), fits effects by their names, and writes model.toml; its path.

    `arm`: the description's shipped name, or its file. Raises `LrmError`.
    """
    q = random_poses(description, POSES, seed, limit_deg)
    measured = simulate(description, truth, q, 0.0, NOISE_M, seed)
    data = lrm.load(write(folder / "measured", measured, "validation.lerobot_robot")[0], arm)
    model = folder / "model.toml"
    lrm.save(lrm.fit(data, names), data, model)
    return model
