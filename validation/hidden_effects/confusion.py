"""One data set through the tool's own commands: fit, diagnose, add; the result against the truth."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lrm_ident.fitting.executors import ONE_THREAD
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.data import NOISE_M, write_case

ROOT = Path(__file__).resolve().parents[2]
COMMAND_TIMEOUT_S = 900.0
FLOOR_MM = NOISE_M * 1000.0 * math.sqrt(3.0)
NOTHING_MISSING, UNEXPLAINED = "nothing_missing", "unexplained_structure"
TO_ADD = ("effect_missing", "effect_describes")


@dataclass(frozen=True)
class CaseOutcome:
    """The tool's result on one data set.

    first_class: "effect@place" of the first in the ranking, and all that it says it cannot tell from that; empty unless
    an effect predicts better. held_out_mm: RMS of the last fit that came about, before and after add.
    trouble: what failed, with the last line that the tool printed.
    """

    case: str
    seed: int
    verdict: str = ""
    first_class: tuple[str, ...] = ()
    before_mm: float | None = None
    after_mm: float | None = None
    diagnose_s: float | None = None
    trouble: str = ""

    @property
    def named(self) -> str:
        """The first name, or the verdict."""
        return self.first_class[0] if self.first_class else self.verdict or "failed"

    @property
    def confident(self) -> bool:
        """Whether it named one effect at one place and no other."""
        return len(self.first_class) == 1

    @property
    def hit(self) -> bool:
        """The truth, or one of the truths, is in the first class; or rightly nothing, or nothing known, is missing."""
        truth = CASES[self.case].truth
        if truth is None:
            return self.verdict == UNEXPLAINED
        return bool(set(truth) & set(self.first_class)) if truth else self.verdict == NOTHING_MISSING

    @property
    def confidently_wrong(self) -> bool:
        """One name, and a wrong one."""
        return self.confident and not self.hit

    @property
    def ratio(self) -> float | None:
        """Held-out RMS at the end over the floor that the noise sets."""
        last = self.before_mm if self.after_mm is None else self.after_mm
        return None if last is None else last / FLOOR_MM


class CommandFailed(Exception):
    """A command of the tool failed."""


def examine(case_and_seed: tuple[str, int], poses: int, keep: Path | None = None) -> CaseOutcome:
    """Make a data set and run the tool on it; the files stay in the folder keep if one is given. Never raises."""
    name, seed = case_and_seed
    with TemporaryDirectory(prefix="hidden-") as scratch:
        folder = Path(scratch) if keep is None else keep / f"{name}-{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        found: dict[str, Any] = {}
        try:
            data = write_case(CASES[name], seed, poses, folder)
            _fit_and_name(data, folder, found)
        except Exception as problem:  # one failure must not end a run of hours; it is in the table
            found["trouble"] = f"{type(problem).__name__}: {problem}"
        return CaseOutcome(name, seed, **found)


def _fit_and_name(data: Path, folder: Path, found: dict[str, Any]) -> None:
    model, diagnosis = folder / "model.toml", folder / "d.json"
    for stale in (model, diagnosis, folder / "m2.toml"):
        stale.unlink(missing_ok=True)
    run_tool("fit", data, "-o", model)
    found["before_mm"] = last_held_out_mm(model)
    found["diagnose_s"] = run_tool("diagnose", model, data, "--json", diagnosis)
    diagnosed = json.loads(diagnosis.read_text(encoding="utf-8"))
    found["verdict"] = diagnosed["verdict"]
    if diagnosed["verdict"] not in TO_ADD:
        return
    first = first_supported(diagnosed)
    if first is None:
        raise CommandFailed(f"verdict {diagnosed['verdict']}, but the ranking supports nothing")
    found["first_class"] = tuple(dict.fromkeys([_name(first), *first["indistinguishable_from"]]))
    run_tool("add", model, data, _name(first), "-o", folder / "m2.toml", "--json", folder / "a.json")
    found["after_mm"] = last_held_out_mm(folder / "m2.toml")


def first_supported(diagnosis: dict[str, Any]) -> dict[str, Any] | None:
    """The first entry of the ranking that is supported; where none is, the first of those that cannot be told apart."""
    ranking = sorted(diagnosis["ranking"], key=lambda entry: int(entry["rank"]))
    for verdict in ("supported", "indistinguishable"):
        for entry in ranking:
            if entry["verdict"] == verdict:
                return dict(entry)
    return None


def _name(entry: dict[str, Any]) -> str:
    return f"{entry['effect']}@{entry['place']}"


def last_held_out_mm(model: Path) -> float | None:
    """Held-out RMS in the last entry of a model's history."""
    history = tomllib.loads(model.read_text(encoding="utf-8")).get("history", [])
    value = history[-1].get("held_out_rms_mm") if history else None
    return None if value is None else float(value)


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
