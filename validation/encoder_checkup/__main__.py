"""`python -m validation.encoder_checkup [FIRST]`: 20 recordings with one hidden cause and 20 of sound arms."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from lrm_ident.measuring.recordings.encoder_checkup import EncoderFinding, checkup
from lrm_ident.measuring.recordings.lerobot import read_frames
from lrm_math.arm.arm_file import load_arm
from validation.encoder_checkup.teleoperation import (
    CAUSES,
    FollowingArm,
    ailing_arm,
    recorded,
    sound_arm,
)
from validation.lerobot_dataset import VERSIONS, write_dataset

OFFSETS_DEG = (17.0, 2.0, None, None)
DWELL_S = 0.5


def named(arm: FollowingArm, seed: int, version: str) -> tuple[EncoderFinding, ...]:
    """Effects named in a recording of an arm, through its files."""
    with tempfile.TemporaryDirectory(prefix="lrm-") as folder:
        data = write_dataset(Path(folder) / "data", recorded(arm, np.random.default_rng([seed, 1])), version)
        return checkup(read_frames(data, load_arm("so101")), load_arm("so101"), DWELL_S).findings


def main() -> None:
    """Prints a line for each recording, and the counts."""
    hits = false = 0
    first = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    for number in range(20):
        cause, case, seed = CAUSES[number // 4], number % 4, first + number
        arm, joint = ailing_arm(cause, np.random.default_rng([seed, 0]), OFFSETS_DEG[case])
        found = named(arm, seed, VERSIONS[number % 2])
        right = [(one.cause, one.joint) for one in found] == [(cause, joint)]
        hits += right
        print(f"{cause} at joint {joint + 1}: {'named' if right else 'MISSED'}; {_words(found)}", flush=True)
    for seed in range(first + 100, first + 120):
        found = named(sound_arm(np.random.default_rng([seed, 0])), seed, VERSIONS[seed % 2])
        false += bool(found)
        print(f"sound: {_words(found)}", flush=True)
    print(f"{hits} of 20 named alone and at their joint, {false} of 20 sound arms with a name")


def _words(found: tuple[EncoderFinding, ...]) -> str:
    return (
        ", ".join(f"{one.cause} at joint {one.joint + 1} {np.degrees(one.size):.2f} deg" for one in found) or "nothing"
    )


if __name__ == "__main__":
    main()
