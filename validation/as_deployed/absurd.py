"""Worlds in which an estimate is absurd by construction: few poses, half ranges, ties, a cause that cannot be named."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from lrm_ident.fitting.executors import ONE_THREAD
from validation.as_deployed.catalogue import recording_of
from validation.as_deployed.leaning import Lean, leaning_recording
from validation.as_deployed.pose_choice import BetweenLevels, HalfRange, TiedJoints
from validation.as_deployed.recording import OngoingWorld, WorldRecording
from validation.hidden_effects.case import Case, of_part
from validation.hidden_effects.causes import coupled, gear_ripple
from validation.hidden_effects.examine import COMMAND_TIMEOUT_S, ROOT


def _of(case: Case, poses: int, choice: HalfRange | TiedJoints | BetweenLevels) -> OngoingWorld:
    def record(seed: int, count: int) -> WorldRecording:
        return recording_of(case, seed, count, choice)

    return OngoingWorld.of(f"{case.name}, {choice.words}", record, poses)


def _leaning(axis: str, tilt_deg: int, poses: int) -> OngoingWorld:
    lean = Lean(axis, tilt_deg, poses)
    return OngoingWorld.of(lean.words, lambda seed, _: leaning_recording(seed, lean), poses)


def _ripple(waves: int, degrees: float) -> Case:
    return gear_ripple("report", 2, waves, degrees)


LOWER, UPPER = HalfRange(2, -1), HalfRange(2, 1)
TIED = of_part("report", coupled(4, 2, 0.02))
ABSURD = {
    "4 waves, lower half": _of(_ripple(4, 0.3), 300, LOWER),
    "4 waves, upper half": _of(_ripple(4, 0.3), 300, UPPER),
    "3 waves, upper half": _of(_ripple(3, 0.6), 300, UPPER),
    "5 waves, lower half": _of(_ripple(5, 0.4), 300, LOWER),
    "4 waves, upper half, few": _of(_ripple(4, 0.3), 120, UPPER),
    "leans 5 about x": _leaning("x", 5, 300),
    "leans 5 about y": _leaning("y", 5, 300),
    "leans -3 about x, few": _leaning("x", -3, 80),
    "coupled, tied": _of(TIED, 100, TiedJoints(2, 4)),
    "3 waves, three angles": _of(replace(_ripple(3, 0.4), levels_deg=(-60.0, 0.0, 60.0)), 300, BetweenLevels()),
}


def said_by_auto(run: WorldRecording) -> list[str]:
    """Lines that `fit` and `auto` print on a recording, errors and notices among them."""
    with tempfile.TemporaryDirectory(prefix="as-deployed-") as scratch:
        folder = Path(scratch)
        run.load(folder)
        data, model, better = (str(folder / name) for name in ("measured.csv", "model.toml", "better.toml"))
        fit = ["fit", data, "--arm", str(run.arm_file), "--loss", run.loss, "-o", model]
        auto = ["auto", model, data, "--no-nested", "-o", better]
        return [line.replace(scratch, "") for words in (fit, auto) for line in _printed(words)]


def _printed(words: list[str]) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-m", "lrm_ident", *words],
        cwd=ROOT,
        env=os.environ | ONE_THREAD | {"COLUMNS": "160"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=COMMAND_TIMEOUT_S,
        check=False,
    )
    return [line.rstrip() for line in done.stdout.splitlines() if line.strip()]
