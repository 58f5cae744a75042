"""The example data set lrm_ident/data/examples/hidden-play."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from .arm_description import load_arm
from .chain import base_displacement_to_deviations
from .files import write
from .generate import Dataset, random_poses, simulate
from .ground_truth import GroundTruth
from .hidden_joints import SoftPlay

NAME = "hidden-play"
SOURCE = "synthetic: validation.synthetic.write_example; play hidden in one joint, see the truth file"
SEED = 20240715
PROJECT = Path(__file__).resolve().parents[2]
ARM_FILE = PROJECT / "config" / "arms" / "lrm-lab.toml"


def example(arm_file: str | Path = ARM_FILE) -> Dataset:
    """300 random poses of the lab arm in four blocks of 75, in turn without and with 66.3 g; noise 0.3 mm per axis."""
    arm = load_arm(arm_file)
    play = SoftPlay(joint=2, width_rad=round(math.radians(2.3), 6), softness_nm=0.04)
    truth = base_displacement_to_deviations(arm, GroundTruth.random(arm, SEED, (play,)))
    payload = np.where(np.arange(300) // 75 % 2 == 0, 0.0, 0.0663)
    q = random_poses(arm, 300, SEED + 1, floor_m=0.1)  # the floor leaves room for sag
    return simulate(arm, truth, q, payload, noise_m=0.0003, seed=SEED + 2)


def write_example(directory: str | Path, arm_file: str | Path = ARM_FILE) -> tuple[Path, Path, Path]:
    """Write the three files of the shipped data set into a directory."""
    return write(Path(directory) / NAME, example(arm_file), SOURCE)
