"""The whole story on a simulated SO-101: `python -m examples.so101.demo [--seed N] [--out FOLDER]`.

An SO-101 is drawn by the seed, with one effect hidden in it that the model does not have. Poses are drawn, measured
and fitted, what is missing is named and added, and goals that were never measured are visited: with commands of the arm
as drawn, corrected by the fitted model, and by that with the effect. What is simulated: the arm, its Feetech servos
(their real protocol on a real pty) and the tracker (real datagrams). What is real: every command.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from examples.demo.conclusion import DemoTruth, conclude
from examples.demo.options import run_in_folder
from examples.demo.steps import DemoSteps
from examples.so101.hidden_arm import HIDDEN, JOINTS, NAMED
from examples.so101.launch import SPEED, simulated_so101, simulated_tracker
from lrm_ident.cli.common import show
from lrm_ident.report.document import heading
from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.poses import roberts_sequence

ARM, POSES, GOALS = "so101", 70, 8
WIDEST = math.radians(75.0)
OFFSETS = tuple(f"offsets@joint{number}" for number in range(1, JOINTS + 1))
"""Base and tool are as drawn: the tracker's targets sit there."""
SPEED_DEG_S = "180"
TIME = f"""\
Time: the simulated servos' clock runs {SPEED:g} times as fast as the computer's, and the arm is driven at {SPEED_DEG_S}
deg/s; yours is driven at 30 unless you say otherwise. The tracker is simulated: it sends where the true tip is, with
noise."""


def run_demo(folder: Path, seed: int, poses: int = POSES, goals: int = GOALS) -> None:
    """Runs all steps and prints the table at the end. Raises `LrmError`."""
    began, effect = time.monotonic(), sorted(HIDDEN)[seed % len(HIDDEN)]
    show(heading(f"Seed {seed}: `make demo ARM=so101 SEED={seed}` runs the same demo again."), TIME)
    with (
        tempfile.TemporaryDirectory(prefix="lrm-so101-") as private,
        simulated_so101(Path(private), effect, seed) as link,
        simulated_tracker(link, seed) as tracker,
    ):
        driven = ("--robot", f"feetech:{link}", "--tracker", tracker, "--speed", SPEED_DEG_S)
        steps = DemoSteps(folder, driven, seed, goals)
        steps.write_poses(spread_poses(poses, seed))
        steps.measure()
        results = {"none, the arm as drawn": steps.verify("nominal")}
        steps.fit("--effects", ",".join([*OFFSETS, "compliance"]))
        results["fitted"] = steps.verify("fitted", "--model", steps.file("fitted.toml"))
        named, last = steps.diagnose(), "fitted.toml"
        if named.verdict == "effect_missing":
            steps.add(named.name)
            last = "better.toml"
            results["with the effect"] = steps.verify("better", "--model", steps.file(last))
        steps.report(last)
    conclude(folder, DemoTruth(seed, *NAMED[effect]), named, results, "commands corrected by", time.monotonic() - began)


def spread_poses(count: int, seed: int) -> str:
    """A pose file: so many poses, spread evenly over the middle of every joint's range, in random order."""
    rng, joints = np.random.default_rng([seed, 101]), load_arm(ARM).joints
    spread = rng.permutation((roberts_sequence(count, len(joints)) + rng.random(len(joints))) % 1.0)
    low, high = np.degrees([(max(j.lower, -WIDEST), min(j.upper, WIDEST)) for j in joints]).T
    rows = [",".join(f"{angle:.2f}" for angle in row) for row in low + spread * (high - low)]
    header = ",".join(["pose", *(f"q{i}_deg" for i in range(1, len(joints) + 1))])
    return "\n".join([header, *(f"{number},{row}" for number, row in enumerate(rows, start=1))]) + "\n"


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.so101.demo", __doc__ or "", run_demo, argv)


if __name__ == "__main__":
    sys.exit(main())
