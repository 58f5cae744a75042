"""`python -m validation.lerobot_robot`: three hidden effects, three seeds; needs LeRobot and the plug-in installed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from examples.so101.hidden_arm import HIDDEN
from validation.lerobot_robot.closed_loop import closed_loop

SEEDS = (1, 2, 3)


def main() -> None:
    """Prints a table."""
    print("| hidden | seed | without (mm) | calibrated (mm) | perfect (mm) | ratio | observed off wish (deg) |")
    print("|---|---|---|---|---|---|---|")
    for effect in HIDDEN:
        for seed in SEEDS:
            with tempfile.TemporaryDirectory(prefix="lrm-") as folder:
                found = closed_loop(effect, seed, Path(folder))
            numbers = [1e3 * error for error in (found.without, found.calibrated, found.floor)]
            ratio, seen = found.calibrated / found.floor, 57.29578 * found.observed
            columns = " | ".join(f"{number:.2f}" for number in (*numbers, ratio, seen))
            print(f"| {effect} | {seed} | {columns} |", flush=True)


if __name__ == "__main__":
    main()
