"""One data set through the tool: by its commands, or by the functions behind them; the result as an outcome."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
import tomllib
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
from lrm_ident.fitting.executors import ONE_THREAD
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects.reference import EffectRef
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
from validation.hidden_effects.intervals import deviations
from validation.hidden_effects.outcome import FLOOR_MM, Outcome

ROOT = Path(__file__).resolve().parents[2]
COMMAND_TIMEOUT_S = 900.0
TO_ADD = ("effect_missing", "effect_describes")
Task = tuple[str, int, str]
"""Key of a case, seed, and another arm than the case's, or ""."""
Found = dict[str, Any]
"""What is known of an outcome so far."""


class CommandFailed(Exception):
    """A command of the tool failed."""


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
    """By the commands fit, diagnose, and add of the first name."""
    model, better, diagnosis = folder / "model.toml", folder / "m2.toml", folder / "d.json"
    for stale in (model, diagnosis, better):
        stale.unlink(missing_ok=True)
    data = write_case(case, seed, poses, folder)
    run_tool("fit", data, "-o", model)
    found["ratio"] = _held_out(model)
    found["seconds"] = run_tool("diagnose", model, data, "--json", diagnosis)
    said = json.loads(diagnosis.read_text(encoding="utf-8"))
    found["verdict"] = said["verdict"]
    if said["verdict"] not in TO_ADD:
        return
    first = first_supported(said)
    if first is None:
        raise CommandFailed(f"verdict {said['verdict']}, but the ranking supports nothing")
    name = str(EffectRef(first["effect"], first["place"]))
    found["steps"] = (tuple(dict.fromkeys([name, *first["indistinguishable_from"]])),)
    found["findings"] = (said["verdict"] == "effect_missing" and not first["indistinguishable_from"],)
    run_tool("add", model, data, name, "-o", better, "--json", folder / "a.json")
    found["ratio"] = _held_out(better)


def followed(case: Case, seed: int, poses: int, folder: Path, found: Found) -> None:
    """By the functions behind fit and auto; the ratio at unseen poses, with the noise of a measurement added.

    Worlds with a memory are judged by the first name.
    """
    data, unseen = write_data(case, seed, poses, folder)
    arm = str(case.arm_file)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the arm is named by its file
        study = lrm.Study.of(lrm.load(data, arm)).fit(loss="huber" if case.outliers else "squared")
    began = time.perf_counter()
    run, _ = study.auto()
    found |= {"seconds": time.perf_counter() - began, "right": case.truth if case.waits else None, **_of_run(run)}
    predicted = lrm.predict(run.model, replace(lrm.load_poses(unseen, arm), sha256=None))  # of the same sessions
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


def first_supported(diagnosis: dict[str, Any]) -> dict[str, Any] | None:
    """The first entry of the ranking that is supported; where none is, the first of those that cannot be told apart."""
    ranking = sorted(diagnosis["ranking"], key=lambda entry: int(entry["rank"]))
    for verdict in ("supported", "indistinguishable"):
        for entry in ranking:
            if entry["verdict"] == verdict:
                return dict(entry)
    return None


def _held_out(model: Path) -> float | None:
    """Held-out RMS in the last entry of a model's history, over the noise."""
    history = tomllib.loads(model.read_text(encoding="utf-8")).get("history", [])
    value = history[-1].get("held_out_rms_mm") if history else None
    return None if value is None else float(value) / FLOOR_MM


def run_tool(command: str, *arguments: object) -> float:
    """Runs one command of lrm-ident; returns the seconds it took. Raises `CommandFailed`."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "lrm_ident", command, *map(str, arguments)],
        cwd=ROOT,
        env=os.environ | ONE_THREAD,
        capture_output=True,
        text=True,
        timeout=COMMAND_TIMEOUT_S,
        check=False,
    )
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).replace("│", " ").splitlines()
        printed = [line.strip() for line in lines if any(letter.isalnum() for letter in line)]
        raise CommandFailed(f"{command}: exit code {done.returncode}: {printed[-1] if printed else 'no message'}")
    return time.perf_counter() - start
