"""The whole story on a simulated arm: `python -m examples.demo [--seed N] [--out FOLDER]`.

A true arm is drawn by the seed, with one effect hidden in it that the model does not have. It is measured, fitted,
and diagnosed; the effect is added, and the model deployed. What is simulated: the arm, its servo board (real bytes on
a real pty) and the tracker (real datagrams). What is real: the daemon, zenoh, and every command.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from examples.demo.hidden import hidden_arm
from examples.demo.simulated_tracker import FRAME_SD_M, REST_SD_M
from examples.demo.steps import DemoSteps, NamedEffect
from examples.demo.world import SPEED, STEP_US, simulated_world
from lrm_ident.cli.common import show
from lrm_ident.report.document import ResultTable, heading
from lrm_math.errors import LrmError
from validation.synthetic import load_arm
from validation.synthetic.example import ARM_FILE

TIME = f"""\
Time: the simulated board's clock runs {SPEED:g} times as fast as the computer's, and pulses change by {STEP_US:g} us
a tick in place of 1 us, so that a pose takes about half a second in place of 15 s. The servos warm
up by the computer's clock."""


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    p = argparse.ArgumentParser("examples.demo", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--seed", type=int, help="of what is hidden; drawn and printed if not given")
    p.add_argument("--out", type=Path, default=Path("out"), help="where the files go (default: %(default)s)")
    options = p.parse_args(argv)
    seed = int.from_bytes(os.urandom(2), "big") if options.seed is None else options.seed
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        for name in ("measured.csv", "measured.toml"):
            (options.out / name).unlink(missing_ok=True)
        run_demo(options.out, seed)
    except (LrmError, OSError) as error:
        print(f"examples.demo: {error}", file=sys.stderr)
        return 2
    return 0


def run_demo(folder: Path, seed: int) -> None:
    """Runs all steps and prints the table at the end. Raises `LrmError`."""
    began = time.monotonic()
    show(heading(f"Seed {seed}: `make demo SEED={seed}` runs the same demo again."), TIME)
    with tempfile.TemporaryDirectory(prefix="lrm-demo-") as private, simulated_world(Path(private), seed) as world:
        steps = DemoSteps(folder, world, seed)
        steps.measure()
        results = {"nominal": steps.verify("nominal")}
        steps.fit()
        steps.compare()
        steps.deploy("fitted.toml")
        results["fitted"] = steps.verify("fitted")
        named = steps.diagnose()
        last = "fitted.toml"
        if named.verdict == "effect_missing":
            steps.add(named.name)
            steps.deploy("better.toml")
            results["with the effect"], last = steps.verify("better"), "better.toml"
        steps.report(last)
    conclude(folder, seed, named, results, time.monotonic() - began)


def conclude(folder: Path, seed: int, named: NamedEffect, results: Mapping[str, Any], seconds: float) -> None:
    """The last screen, and the same as `demo.json`."""
    hidden = hidden_arm(load_arm(ARM_FILE), seed)
    tracker_mm = 1e3 * math.sqrt(3.0) * math.hypot(REST_SD_M, FRAME_SD_M / 3.0)
    rows = []
    for name, result in results.items():
        error, floor = result["error"], math.hypot(tracker_mm, result["rounding_rms_mm"])
        rows.append((name, error["mean_mm"], error["rms_mm"], error["max_mm"], floor, result["model_sha256"][:12]))
    columns = ("model in the daemon", "mean|.2f", "RMS|.2f", "worst|.2f", "floor, RMS|.2f", "sha256")
    goals = len(next(iter(results.values()))["goals"])
    title = f"How far the tip lands from {goals} goals that were never measured, mm"
    right = "right" if named.agrees(hidden.effect) else "NOT what was hidden"
    show(
        "",
        ResultTable(columns, rows, title),
        "Floor: noise of the tracker, and pulses in whole counts; no model can do better.",
        f"Hidden by seed {seed}: {hidden.words} ({hidden.effect}).",
        f"Named by diagnose: {named.words}: {right}.",
        f"Report: {folder / 'report.html'}. All in {seconds:.0f} s.",
    )
    document = {
        "schema": "lrm/demo/1", "seed": seed, "hidden": hidden.effect, "verdict": named.verdict, "named": named.name,
        "indistinguishable_from": named.rivals, "right": named.agrees(hidden.effect), "seconds": seconds,
        "rms_mm": {row[0]: row[2] for row in rows}, "floor_rms_mm": {row[0]: row[4] for row in rows},
    }  # fmt: skip
    (folder / "demo.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
