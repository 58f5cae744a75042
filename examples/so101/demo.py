"""The whole story on a simulated SO-101: `python -m examples.so101.demo [--seed N] [--out FOLDER]`.

An SO-101 is drawn by the seed, with one effect hidden in it that the model does not have. Poses are chosen, measured
and fitted, what is missing is named and added, and goals that were never measured are visited: with commands of the arm
as drawn, corrected by the fitted model, and by that with the effect. What is simulated: the arm, its Feetech servos
(their real protocol on a real pty) and the tracker (real datagrams). What is real: every command.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from examples.demo.conclusion import DemoTruth, conclude
from examples.demo.options import run_in_folder
from examples.demo.steps import DemoSteps
from examples.so101.hidden_arm import HIDDEN, NAMED
from examples.so101.launch import SPEED, simulated_so101, simulated_tracker
from lrm_ident.cli.common import show
from lrm_ident.report.document import heading

ARM, POSES, GOALS = "so101", 40, 8
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
        steps.design(ARM, poses)
        steps.measure()
        results = {"none, the arm as drawn": steps.verify("nominal")}
        steps.fit()
        results["fitted"] = steps.verify("fitted", "--model", steps.file("fitted.toml"))
        named, last = steps.diagnose(), "fitted.toml"
        if named.verdict == "effect_missing":
            steps.add(named.name)
            last = "better.toml"
            results["with the effect"] = steps.verify("better", "--model", steps.file(last))
        steps.report(last)
    conclude(folder, DemoTruth(seed, *NAMED[effect]), named, results, "commands corrected by", time.monotonic() - began)


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.so101.demo", __doc__ or "", run_demo, argv)


if __name__ == "__main__":
    sys.exit(main())
