"""One data set through the functions behind the tool's commands; the result as an outcome."""

from __future__ import annotations

import csv
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import AutoRun, run_auto
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.model import Model
from validation.hidden_effects.case import (
    FAULTS,
    FAULTS_BLIND,
    FAULTS_BLIND_REPORT,
    FAULTS_REPORT,
    NAMED,
    Case,
)
from validation.hidden_effects.catalogue import EVERY
from validation.hidden_effects.data import NOISE_M, dataset, spoiled, write_case, write_data
from validation.hidden_effects.outcome import FLOOR_MM, Outcome
from validation.hidden_effects.true_parameters import deviations

Task = tuple[str, int, str]
"""Key of a case, seed, and another arm than the case's, or ""."""
Found = dict[str, Any]
"""What is known of an outcome so far."""


def examine(task: Task, poses: int, keep: Path | None = None) -> Outcome:
    """Makes a data set and runs the tool on it; the files stay in the folder keep if one is given. Never raises."""
    key, seed, arm = task
    case, found = EVERY[key], Found()
    with TemporaryDirectory(prefix="hidden-") as scratch:
        folder = Path(scratch) if keep is None else keep / f"{key.replace('/', '-').replace(' ', '-')}-{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        try:
            WAYS.get(case.part, followed)(replace(case, arm=arm or case.arm), seed, poses, folder, found)
        except Exception as problem:  # one failure must not end a run of hours; it is in the table
            found["trouble"] = f"{type(problem).__name__}: {problem}"
        return Outcome(key, seed, arm=arm, **found)


def diagnosed(case: Case, seed: int, poses: int, folder: Path, found: Found) -> None:
    """By the functions behind fit, diagnose, and add of the first name that is supported, or the first of a class."""
    study = _fitted(case, write_case(case, seed, poses, folder))
    began = time.perf_counter()
    report = study.diagnose()
    found |= {"seconds": time.perf_counter() - began, "verdict": str(report.verdict), "ratio": _held_out(study)}
    if not report.verdict.adds:
        return
    kinds = (Support.SUPPORTED, Support.INDISTINGUISHABLE)
    first = min((one for one in report.ranking if one.verdict in kinds), key=lambda one: kinds.index(one.verdict))
    found["steps"] = (tuple(dict.fromkeys([first.name, *first.equivalent])),)
    found["findings"] = (report.verdict is Verdict.EFFECT_MISSING and not first.equivalent,)
    found["ratio"] = _held_out(study.add(first, report.diagnosis))


def followed(case: Case, seed: int, poses: int, folder: Path, found: Found) -> None:
    """By the functions behind fit and auto; the ratio at unseen poses, with the noise of a measurement added.

    Worlds with a memory are judged by the first name.
    """
    data, unseen = write_data(case, seed, poses, folder)
    study, began = _fitted(case, data), time.perf_counter()
    run, _ = study.auto()
    found |= {"seconds": time.perf_counter() - began, "right": case.truth if case.waits else None, **_of_run(run)}
    predicted = lrm.predict(
        run.model, replace(lrm.load_poses(unseen, str(case.arm_file)), sha256=None)
    )  # of the same sessions
    apart = 1e3 * predicted - _tcp_mm(unseen)
    found["ratio"] = over_noise(apart[1:])  # before the first pose the direction is not known
    found["z"] = tuple(z for _, z in deviations(run.steps[-1].fit, dataset(case, seed, poses)))


def searched(case: Case, seed: int, poses: int, _folder: Path, found: Found) -> None:
    """A measurement with a fault by the functions behind `auto`; the ratio of the residual."""
    data, right = spoiled(case, seed, poses)
    run = run_auto(base_model(data, load_arm(str(case.arm_file))), data)
    found |= {"right": right, **_of_run(run), "ratio": float(run.steps[-1].fit.sigma / NOISE_M)}


def _of_run(run: AutoRun) -> Found:
    """What `auto` ended with."""
    shown = zip(run.steps[1:], run.attributions, strict=True)
    added = [(step, one.kind == "finding") for step, one in shown if step.added]
    return {
        "steps": tuple(tuple(step.names) for step, _ in added),
        "findings": tuple(finding for _, finding in added),
        "verdict": run.verdict,
    }


WAYS: dict[str, Callable[[Case, int, int, Path, Found], None]] = {
    NAMED: diagnosed,
    **dict.fromkeys((FAULTS, FAULTS_REPORT, FAULTS_BLIND, FAULTS_BLIND_REPORT), searched),
}
"""By part; of all others `followed`."""


def base_model(data: Measurements, arm: Arm) -> Model:
    """Offsets and compliances, fitted as far as the data determine them."""
    model = nominal_model(arm)
    return fit_identifiable(model, data, model.keys).fit.model


def over_noise(apart_mm: Array) -> float:
    """RMS of errors (P, 3) without noise, that of a measurement added, over that noise."""
    return float(np.sqrt((apart_mm**2).sum(axis=1).mean() + FLOOR_MM**2) / FLOOR_MM)


def _tcp_mm(path: Path) -> Array:
    with path.open(encoding="utf-8", newline="") as file:
        return np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in csv.DictReader(file)])


def _fitted(case: Case, data: Path) -> lrm.Study:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the arm is named by its file
        return lrm.Study.of(lrm.load(data, str(case.arm_file))).fit(loss="huber" if case.outliers else "squared")


def _held_out(study: lrm.Study) -> float | None:
    """Held-out RMS over the noise."""
    error = study.held_out.error
    return None if error is None else 1e3 * error.rms / FLOOR_MM
