"""One data set of the second catalogue through the tool's own commands fit and auto, against the truth."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import lrm_ident as lrm
from lrm_math.arm.arm_file import load_arm as load_tool_arm
from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.confusion import FLOOR_MM, NOTHING_MISSING, run_tool
from validation.hidden_effects.unfamiliar_cases import UNFAMILIAR
from validation.hidden_effects.unfamiliar_data import arm_file, write_data
from validation.hidden_effects.unfamiliar_effects import UnfamiliarCase

ALWAYS_TRUE = ("offsets", "compliance")  # every generated arm has these errors at all places
NEAR_FLOOR, ABOVE_FLOOR = 1.10, 1.15


@dataclass(frozen=True)
class AutoOutcome:
    """Outcome of `auto`.

    steps: for each step its name (a form counts as the effect that it refines) and all that the data cannot tell from
    it. findings: whether each is said to be a cause; the others only describe. ratio: RMS error at unseen poses with
    the noise of a measurement added, over that noise. trouble: what failed, with the last line that the tool printed.
    """

    case: str
    seed: int
    steps: tuple[tuple[str, ...], ...] = ()
    verdict: str = ""
    ratio: float | None = None
    auto_s: float | None = None
    trouble: str = ""
    findings: tuple[bool, ...] = ()

    @property
    def of(self) -> UnfamiliarCase:
        """Outcome of a case."""
        return UNFAMILIAR[self.case]

    @property
    def truths_named(self) -> int:
        """Number of the hidden effects that a step names, or has in its class."""
        return sum(any(right & set(step) for step in self.steps) for right in self.of.truths or ())

    @property
    def all_named(self) -> bool:
        """Whether every hidden effect is named."""
        return not self.trouble and self.truths_named == len(self.of.truths or ())

    @property
    def false_names(self) -> tuple[str, ...]:
        """First name of each step in whose class there is no truth."""
        return tuple(step[0] for step in self.steps if self._is_false(step))

    @property
    def false_findings(self) -> tuple[str, ...]:
        """Those of them that are said to be a cause."""
        said = zip(self.steps, self.findings, strict=True)
        return tuple(step[0] for step, finding in said if finding and self._is_false(step))

    def _is_false(self, step: tuple[str, ...]) -> bool:
        right = frozenset[str]().union(*(self.of.truths or ()))
        return not right & set(step) and not any(_kind(name) in ALWAYS_TRUE for name in step)

    @property
    def near_floor(self) -> bool:
        """Whether hardly any error above the noise is left."""
        return self.ratio is not None and self.ratio <= NEAR_FLOOR

    @property
    def wrong_form(self) -> bool:
        """All is named rightly, and yet error is left."""
        return self.all_named and not self.false_names and not self.near_floor

    @property
    def falsely_content(self) -> bool:
        """Whether it says that nothing is missing while much more than the noise is left."""
        return self.verdict == NOTHING_MISSING and self.ratio is not None and self.ratio > ABOVE_FLOOR


def examine_auto(case_and_seed: tuple[str, int], poses: int, keep: Path | None = None) -> AutoOutcome:
    """Makes a data set and runs the tool on it; the files stay in the folder keep if one is given. Never raises."""
    name, seed = case_and_seed
    case = UNFAMILIAR[name]
    with TemporaryDirectory(prefix="unfamiliar-") as scratch:
        folder = Path(scratch) if keep is None else keep / f"{name.replace('/', '-').replace(' ', '-')}-{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        try:
            return _run(name, case, seed, poses, folder)
        except Exception as problem:  # one failure must not end a run of hours; it is in the table
            return AutoOutcome(name, seed, trouble=f"{type(problem).__name__}: {problem}")


def _run(name: str, case: UnfamiliarCase, seed: int, poses: int, folder: Path) -> AutoOutcome:
    data, unseen = write_data(case, seed, poses, folder)
    model, better, course = (folder / name for name in ("model.toml", "better.toml", "course.json"))
    run_tool("fit", data, "--arm", arm_file(case), "-o", model, *(["--loss", "huber"] if case.outliers else []))
    seconds = run_tool("auto", model, data, "--no-nested", "-o", better, "--json", course)
    found = json.loads(course.read_text(encoding="utf-8"))
    added = [step for step in found["steps"] if step["added"]]
    steps, findings = tuple(map(_names, added)), tuple(step["is"] == "finding" for step in added)
    arm = load_tool_arm(arm_file(case))
    poses_then = replace(lrm.load_poses(unseen, arm), sha256=None)  # of the same sessions: what belongs to them holds
    predicted = 1e3 * lrm.predict(lrm.load_model(better), poses_then)
    apart = (predicted - _tcp_mm(unseen))[1:]  # before the first pose the direction is not known
    ratio = float(np.sqrt((apart**2).sum(axis=1).mean() + FLOOR_MM**2) / FLOOR_MM)
    return AutoOutcome(name, seed, steps, found["verdict"], ratio, seconds, findings=findings)


def _names(step: dict[str, Any]) -> tuple[str, ...]:
    """The causes that a step stands for: those whose other form it is, else its own name; then its class."""
    return (*(step["form_of"] or (step["added"],)), *step["indistinguishable_from"])


def _tcp_mm(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in csv.DictReader(file)]
    return np.array(rows)


def _kind(name: str) -> str:
    return EffectRef.parse(name).id
