"""Random single changes of a LeRobot dataset, and what `import lerobot` makes of its angles."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from validation.lerobot_dataset import Recording, write_dataset
from validation.newcomer_files.outcome import ChangeOutcome, outcome_of, said_by

ARMS = "so101", "so100", "lekiwi"
RESTS, FPS, REST_S, MOVE_S = 16, 10, 2.0, 0.5
NEAR_DEG = 0.3
SAID = {
    "sign": "turns against its command", "turn": "reads a full turn", "swapped": "follows the command of",
    "frozen": "stands still",
}  # fmt: skip
"""How a checkup names what happens to one joint, after its name."""
PREFIXES = "", "arm_", "left_", "right_", "main_", "follower_", "wing_"


def recording(rng: np.random.Generator) -> ChangeOutcome:
    """Changes a dataset of an arm, imports it, and compares the angles of its stops with those that were recorded."""
    arm = load_arm(str(rng.choice(ARMS)))
    low, high = np.degrees([(joint.lower, joint.upper) for joint in arm.joints]).T
    poses = rng.uniform(0.9 * low, 0.9 * high, (RESTS, arm.dof))
    poses[0, 1:3] = 0.95 * low[1], 0.95 * high[2]
    commanded, read, names, what, words = changed(arm, poses, rng)
    with tempfile.TemporaryDirectory() as scratch:
        folder, out = Path(scratch) / "recorded", Path(scratch) / "poses.csv"
        write(folder, commanded, read, names)
        code, said = said_by("import", "lerobot", folder, "--arm", arm.name, "-o", out)
        apart = None
        if code == 0:
            table = np.genfromtxt(out, delimiter=",", names=True)
            found = np.stack([table[f"q{k + 1}_deg"] for k in range(arm.dof)], axis=1)
            apart = float(np.sqrt(((found - poses) ** 2).mean())) if found.shape == poses.shape else np.inf
        wrong = apart is not None and apart > NEAR_DEG
        if code == 0 and not wrong and not np.array_equal(read, commanded):  # what the encoders say is wrong
            code, said = said_by("checkup", folder, "--arm", arm.name)
            wrong = True
        named = any(word.lower() in said.lower() for word in words)
    return ChangeOutcome("recording", arm.name, what, outcome_of(code, named, wrong), said[:300], apart)


def changed(arm: Arm, poses: Array, rng: np.random.Generator) -> tuple[Array, Array, list[str], str, tuple[str, ...]]:
    """Angles (R, n) as commanded and as read (deg), names of the joints, what was changed, and words that name it.

    A unit or a zero is that of both; what happens to one joint is what its encoder says.
    """
    names, k = [str(joint.name) for joint in arm.joints], int(rng.integers(arm.dof))
    kind = str(rng.choice(["older zeros", "prefix", "radians", "counts", "sign", "turn", "swapped", "frozen", "NaN"]))
    words: tuple[str, ...] = (f"{names[k]} {SAID.get(kind, '')}", "limits", "beyond")
    read = poses.copy()
    if kind == "older zeros":
        read[:, 1], read[:, 2] = 90.0 - poses[:, 1], poses[:, 2] + 90.0
        words = ("before June 2025",)
    elif kind == "prefix":
        before = str(rng.choice(PREFIXES))
        return poses, poses, [before + name for name in names], f"names with '{before}'", ("no joint", "prefix")
    elif kind == "radians":
        read, words = np.radians(poses), ("--angle-unit rad",)
    elif kind == "counts":
        read, words = 2048.0 + poses * 4096.0 / 360.0, ("counts",)
    elif kind == "sign":
        read[:, k] *= -1.0
    elif kind == "turn":
        read[:, k] += 360.0
    elif kind == "swapped":
        other = (k + 1) % arm.dof
        read[:, [k, other]] = read[:, [other, k]]
        words = (f"{names[k]} {SAID[kind]} {names[other]}", *words[1:])
    elif kind == "frozen":
        read[:, k] = poses[0, k]
    else:
        read[int(rng.integers(RESTS)), k], words = np.nan, ("frames", "nan", "without a number")
    both = kind in ("older zeros", "radians", "counts")
    return read if both else poses, read, names, f"{kind} ({names[k]})", words


def write(folder: Path, commanded: Array, read: Array, names: list[str]) -> None:
    """A dataset of one episode that stops at each pose (R, n), deg, as commanded and as read."""
    action, state = _frames(commanded), _frames(read)
    made = Recording(action, state, np.arange(len(action)) / FPS, np.zeros(len(action), dtype=int))
    write_dataset(folder, made, "v3.0", [f"{name}.pos" for name in (*names, "gripper")], FPS)


def _frames(poses: Array) -> Array:
    """(N, n), angles of every frame: a move to each pose (R, n), and a stop there."""
    each = int(FPS * (REST_S + MOVE_S))
    share = np.tile(np.minimum((np.arange(each) + 1.0) / (FPS * MOVE_S), 1.0), len(poses))[:, None]
    before = np.concatenate([poses[:1], poses[:-1]]).repeat(each, axis=0)
    return np.asarray(before + share * (np.repeat(poses, each, axis=0) - before))
