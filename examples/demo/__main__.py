"""The whole story on a simulated arm: `python -m examples.demo [--seed N] [--out FOLDER]`.

A true arm is drawn by the seed, with one effect hidden in it that the model does not have. It is measured, fitted,
and diagnosed; the effect is added, and the model deployed. What is simulated: the arm, its servo board (real bytes on
a real pty) and the tracker (real datagrams). What is real: the daemon, zenoh, and every command.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

from examples.demo.conclusion import DemoTruth, conclude
from examples.demo.hidden import hidden_arm
from examples.demo.options import run_in_folder
from examples.demo.pose_files import LOAD_G, pose_table
from examples.demo.simulated_tracker import FRAME_SD_M, REST_SD_M
from examples.demo.steps import DemoSteps
from examples.demo.world import ARM, SPEED, STEP_US, simulated_world
from lrm_ident.cli.common import show
from lrm_ident.report.document import heading
from lrm_math.arm.arm_file import load_arm as load_nominal
from validation.synthetic import load_arm
from validation.synthetic.example import ARM_FILE

POSES, REPEATS, GOALS = 80, 8, 12
NOISE_MM = 1e3 * math.sqrt(3.0) * math.hypot(REST_SD_M, FRAME_SD_M / 3.0)
"""RMS, of the tracker in a position."""
TIME = f"""\
Time: the simulated board's clock runs {SPEED:g} times as fast as the computer's, and pulses change by {STEP_US:g} us
a tick in place of 1 us, so that a pose takes about half a second in place of 15 s. The servos warm
up by the computer's clock."""


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.demo", __doc__ or "", run_demo, argv)


def run_demo(folder: Path, seed: int) -> None:
    """Runs all steps and prints the table at the end. Raises `LrmError`."""
    began = time.monotonic()
    show(heading(f"Seed {seed}: `make demo SEED={seed}` runs the same demo again."), TIME)
    hidden = hidden_arm(load_arm(ARM_FILE), seed)
    with tempfile.TemporaryDirectory(prefix="lrm-demo-") as private, simulated_world(Path(private), seed) as world:
        steps = DemoSteps(folder, (*world.daemon, "--tracker", f"dtrack:{world.tracker_port}"), seed, str(GOALS))
        load = ("--payload-g", str(LOAD_G))  # still on, from measuring
        steps.write_poses(pose_table(load_nominal(ARM), POSES, REPEATS, seed))
        steps.measure("--load-command", world.load_command)
        results = {"nominal": steps.verify("nominal", *load)}
        steps.fit()
        steps.compare()
        steps.deploy("fitted.toml", *world.daemon)
        results["fitted"] = steps.verify("fitted", *load)
        named, last = steps.diagnose(), "fitted.toml"
        if named.to_add:
            steps.add(named.name)
            steps.deploy("better.toml", *world.daemon)
            results["with the effect"], last = steps.verify("better", *load), "better.toml"
        reported = steps.report(last)
    truth = DemoTruth(seed, hidden.effect, hidden.words)
    conclude(folder, truth, named, results, "model in the daemon", NOISE_MM, time.monotonic() - began, reported)


if __name__ == "__main__":
    sys.exit(main())
