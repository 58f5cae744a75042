"""`python -m validation.lerobot_robot.paths`: 10 000 random paths over fitted models of three arms; needs no LeRobot.

Each model is fitted to simulated measurements of a hidden arm (`fitted_arms`), which shares no code with it. Rests are
those of the hidden arm at the ends of some paths: with the wish itself sent, corrected without bounds, and bounded.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from validation.lerobot_robot.continuity import PathFigures, figures, follow, followed_without_bounds, random_path
from validation.lerobot_robot.fitted_arms import FittedArm, fitted_arms

ARMS = ("so101", "lrm-rover", str(Path(__file__).parents[1] / "hidden_effects" / "arms" / "seven-joint.toml"))
RESTS = 10
"""The true arm is asked at the end of every tenth path: that takes longer than the path."""


def main() -> None:
    """Prints a row for each arm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=int, default=200, help="of all arms together")
    parser.add_argument("--paths", type=int, default=10_000, help="of all arms together")
    parser.add_argument("--arm", choices=ARMS, action="append", help="only this one; may be repeated")
    chosen = parser.parse_args()
    models = -(-chosen.models // len(ARMS))
    each = -(-chosen.paths // (len(ARMS) * models))
    print(
        "| arm | models | paths | commands | ratio | of joints without direction | largest step (deg) | farthest (deg)"
        " | bound bit | rests (mm): wish sent, RMS, median, 90 %, worst | corrected, no bounds | bounded |"
    )
    print(f"|{'---|' * 12}")
    for name in chosen.arm or ARMS:
        rng, found = np.random.default_rng(57), PathFigures()
        for fitted in fitted_arms(name, models):
            for number in range(each):
                _follow(fitted, rng, found, number % RESTS == 0)
        angles = " | ".join(f"{np.degrees(x):.1f}" for x in (found.largest_step, found.farthest))
        ratios = f"{found.ratio:.1f} | {found.undirected_ratio:.2f}"
        counts = f"{Path(name).stem} | {models} | {models * each} | {found.steps}"
        rests = " | ".join(figures(errors) for errors in (found.without, found.unbounded, found.left))
        print(f"| {counts} | {ratios} | {angles} | {found.bounded} | {rests} |", flush=True)


def _follow(fitted: FittedArm, rng: np.random.Generator, found: PathFigures, rests: bool) -> None:
    """One random path, and the rest at its end."""
    path = random_path(*fitted.correction.limits, rng)
    commands = follow(fitted.correction, path, found)
    unbounded = followed_without_bounds(fitted.correction, path) if rests else None
    if unbounded is None:
        return
    for errors, sent in ((found.without, path), (found.unbounded, unbounded), (found.left, commands)):
        errors.append(fitted.missed_mm(path[-1], sent))


if __name__ == "__main__":
    main()
