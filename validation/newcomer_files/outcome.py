"""Outcomes of `fit` on changed files: refused by name, said, healthy all the same, or silently wrong."""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from lrm_ident.cli.app import main
from lrm_ident.data.error_stats import error_stats
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_model
from validation.newcomer_files.changes import FileChange
from validation.newcomer_files.healthy import POSES, NewcomerFiles

HEALTHY, SAID, REFUSED = "healthy result", "notice that names it", "refused by name"
VAGUE, SILENT, TRACEBACK = "refused, not by name", "silent wrong result", "traceback"
OUTCOMES = (HEALTHY, SAID, REFUSED, VAGUE, SILENT, TRACEBACK)
TOLERANCE = 3e-4
"""m RMS: the noise per axis; predictions of fits to two halves of a healthy data set differ by as much."""


@dataclass(frozen=True)
class ChangeOutcome:
    """Outcome of a change; `difference`: of the result from the healthy one (m, or deg of angles)."""

    kind: str
    arm: str
    what: str
    outcome: str
    said: str
    difference: float | None = None


def fit_files(files: NewcomerFiles, folder: Path) -> tuple[int, str, Path]:
    """Exit code (−1: a traceback), what was said, and the model's path."""
    data, arm = files.write(folder)
    model = folder / "model.toml"
    model.unlink(missing_ok=True)
    return *said_by("fit", data, "--arm", arm, "-o", model, "--all"), model


def said_by(*command: object) -> tuple[int, str]:
    """Exit code (−1: a traceback) of a command of `lrm-ident`, and what it said."""
    stdout, stderr, code = io.StringIO(), io.StringIO(), 0
    words = ["lrm-ident", *map(str, command)]
    with mock.patch.object(sys, "argv", words), contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception as error:  # what a person would see as a traceback is what is counted here
            code = -1
            stderr.write(f"{type(error).__name__}: {error}")
    return code, " ".join(f"{stderr.getvalue()} {stdout.getvalue()}".split())


def outcome_of(code: int, named: bool, wrong: bool) -> str:
    """The outcome by a command's exit code, whether it named the change, and whether its result is a wrong one.

    `checkup` ends with 1 where it found something.
    """
    if code < 0:
        return TRACEBACK
    if code == 2:
        return REFUSED if named else VAGUE
    return HEALTHY if not wrong else SAID if named else SILENT


def predictions(model: Path, angles: Array) -> Array:
    """(N, 3), where a model sees the tip at angles (N, n) without load (m)."""
    return solve_equilibrium(load_model(model), poses_of(angles)).tcp


def probes(arm: Arm) -> Array:
    """(N, n), angles at which models are compared (rad)."""
    low, high = 0.9 * np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    return np.random.default_rng(1).uniform(low, high, (POSES, arm.dof))


def classify(kind: str, change: FileChange, healthy: Array) -> ChangeOutcome:
    """The outcome of one change. `healthy`: predictions of the fit to the files before it."""
    with tempfile.TemporaryDirectory() as scratch:
        code, said, model = fit_files(change.files, Path(scratch))
        named = any(word.lower() in said.lower() for word in change.words)
        difference = None
        if code == 0:
            try:
                q = probes(load_arm(change.files.arm_name))
                difference = error_stats(predictions(model, q) - healthy).rms
            except LrmError:
                difference = float("inf")
        outcome = outcome_of(code, named, difference is not None and not difference < TOLERANCE)
    return ChangeOutcome(kind, change.files.arm_name, change.what, outcome, said[:300], difference)
