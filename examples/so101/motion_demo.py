"""The end of `make demo ARM=so101`, how the arm moves: `python -m examples.so101.motion_demo`.

Two minutes of teleoperation are recorded of an SO-101 whose joints are drawn by the seed, one of them with a cause of
motion that the model does not have. What is simulated: hand, servos, links and encoders, by the generator of
`validation.motion`, which shares no code with the model. What is real: every command, and the dataset's format.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.demo.options import run_in_folder
from examples.demo.steps import DemoSteps, MotionFit, NamedEffect
from lrm_ident.cli.common import show
from lrm_ident.report.document import ResultTable, heading
from lrm_ident.report.plain_names import plain_name
from validation.lerobot_dataset import write_dataset
from validation.motion.cases import FIRST, LATER, MotionCase, arm_of
from validation.motion.world import recorded

SHOWN = ("dead time", "speed limit", "coulomb friction", "play", "swing", "acceleration limit")
"""Causes that may hide."""
CASES = tuple(case for name in SHOWN for case in (*FIRST, *LATER) if case.name == name)
RECORDING, VERSION = "motion-recording", "v3.0"


@dataclass(frozen=True)
class MotionTruth:
    """What a seed hides: the joint from 0, and ids of effects that are right names of it."""

    seed: int
    joint: int
    true: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """`id@jointN` of each."""
        return tuple(f"{kind}@joint{self.joint + 1}" for kind in self.true)

    def verdict(self, named: NamedEffect) -> str:
        """Whether it was named, in words."""
        return "right" if any(named.agrees(name) for name in self.names) else "NOT what was hidden"


def case_of(seed: int) -> MotionCase:
    """What a seed hides."""
    return CASES[int(np.random.default_rng([seed, 64]).integers(len(CASES)))]


def write_recording(folder: Path, seed: int) -> MotionTruth:
    """Writes a LeRobot dataset of the arm of a seed."""
    case, rng = case_of(seed), np.random.default_rng([seed, 65])
    arm, joint = arm_of(case, rng)
    shutil.rmtree(folder, ignore_errors=True)
    write_dataset(folder, recorded([arm], rng)[0], VERSION)
    return MotionTruth(seed, joint, case.true)


def show_motion(folder: Path, seed: int) -> None:
    """Records, fits, diagnoses and adds, and prints how the error falls. Raises `LrmError`."""
    began = time.monotonic()
    show("", heading("The same arm in motion: two minutes of teleoperation, simulated"))
    truth, steps = write_recording(folder / RECORDING, seed), DemoSteps(folder, (), seed, "")
    fits = {"response of the servos": steps.fit_motion(RECORDING)}
    named = steps.diagnose_motion(RECORDING)
    if named.to_add:
        fits[f"with {named.name}"] = steps.add_motion(RECORDING, named.name)
    conclude_motion(folder, truth, named, fits, time.monotonic() - began)


def conclude_motion(
    folder: Path, truth: MotionTruth, named: NamedEffect, fits: dict[str, MotionFit], seconds: float
) -> None:
    """Prints the errors of moves that no fit used, what was hidden and named; adds them to `demo.json`."""
    joint, first = truth.joint, next(iter(fits.values()))
    rows = [
        ("the commands alone", first.command_deg[joint]),
        *((name, fit.held_out_deg[joint]) for name, fit in fits.items()),
    ]
    title = (
        f"How far the encoder of joint {joint + 1} is from the prediction, at moves that the fit did not use, deg RMS"
    )
    show(
        "",
        ResultTable(("model of motion", "held out, RMS|.3f"), rows, title),
        f"Noise of its encoder: {first.noise_deg[joint]:.3f} deg; no model can do better.",
        f"Hidden by seed {truth.seed}: {plain_name(truth.names[0])} ({truth.names[0]}).",
        f"Named by motion diagnose: {named.words}: {truth.verdict(named)}.",
        f"Motion in {seconds:.0f} s.",
    )
    known, file = folder / "demo.json", {"schema": "lrm/demo/1", "seed": truth.seed}
    if known.is_file():
        file = json.loads(known.read_text(encoding="utf-8"))
    file["motion"] = {
        "hidden": truth.names, "named": named.name, "indistinguishable_from": named.rivals,
        "right": truth.verdict(named) == "right", "seconds": seconds,
        "rms_deg": dict(rows), "noise_deg": first.noise_deg[joint],
    }  # fmt: skip
    known.write_text(json.dumps(file, indent=1) + "\n", encoding="utf-8")


def main(argv: list[str] | None = None) -> int:
    """Runs this part of the demo alone. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.so101.motion_demo", __doc__ or "", show_motion, argv)


if __name__ == "__main__":
    sys.exit(main())
