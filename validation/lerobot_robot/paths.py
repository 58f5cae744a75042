"""`python -m validation.lerobot_robot.paths`: 10 000 random paths over the models of three arms; needs no LeRobot."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import load_arm
from validation.lerobot_robot.continuity import PathFigures, figures, follow, random_model, random_path

ARMS = ("so101", "lrm-rover", str(Path(__file__).parents[1] / "hidden_effects" / "arms" / "seven-joint.toml"))


def main() -> None:
    """Prints a row for each arm and range."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=int, default=200, help="of all arms together")
    parser.add_argument("--paths", type=int, default=10_000, help="of all arms together")
    chosen = parser.parse_args()
    models = chosen.models // len(ARMS) + 1
    each = chosen.paths // (len(ARMS) * models) + 1
    print(
        "| arm | paths | commands | ratio | of joints without direction | largest step (deg) | farthest (deg) |", end=""
    )
    print(" bound bit | rests, wish sent: RMS (mm) | median | 90 % | worst | corrected: RMS | median | 90 % | worst |")
    print(f"|{'---|' * 16}")
    for name in ARMS:
        arm, rng, found = load_arm(name), np.random.default_rng(57), PathFigures()
        for _ in range(models):
            made = Correction.of(random_model(arm, rng))
            for _ in range(each):
                follow(made, random_path(*made.limits, rng), found)
        angles = " | ".join(f"{np.degrees(x):.1f}" for x in (found.largest_step, found.farthest))
        ratios = f"{found.ratio:.1f} | {found.undirected_ratio:.2f}"
        counts = f"{arm.name} | {models * each} | {found.steps}"
        rests = f"{figures(found.without)} | {figures(found.left)}"
        print(f"| {counts} | {ratios} | {angles} | {found.bounded} | {rests} |", flush=True)


if __name__ == "__main__":
    main()
