"""The last screen of a demo, and the same as `demo.json`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from examples.demo.steps import NamedEffect
from lrm_ident.cli.common import show
from lrm_ident.report.document import ResultTable


@dataclass(frozen=True)
class DemoTruth:
    """Hidden effect of a seed: its name by the tool's name, and in words. `simpler`: the same cause with less in it."""

    seed: int
    effect: str
    words: str
    simpler: str = ""

    def verdict(self, named: NamedEffect) -> str:
        """Whether it was named, in words."""
        if named.agrees(self.effect):
            return "right"
        return "the same cause in a simpler form" if named.agrees(self.simpler) else "NOT what was hidden"


def conclude(
    folder: Path,
    truth: DemoTruth,
    named: NamedEffect,
    results: Mapping[str, Any],
    model: str,
    tracker_mm: float,
    seconds: float,
    reported: str,
) -> None:
    """Prints and writes what `verify` measured with each model, what was hidden and named.

    `model`: column's head. `reported`: verdict of the last report, of the model with what was named.
    `tracker_mm`: noise of the tracker in a position (mm, RMS).
    """
    rows = []
    for name, result in results.items():
        error, floor = result["error"], math.hypot(tracker_mm, result["rounding_rms_mm"])
        rows.append((name, error["mean_mm"], error["rms_mm"], error["max_mm"], floor, result["model_sha256"][:12]))
    columns = (model, "mean|.2f", "RMS|.2f", "worst|.2f", "floor, RMS|.2f", "sha256")
    goals = len(next(iter(results.values()))["goals"])
    right = named.agrees(truth.effect)
    show(
        "",
        ResultTable(columns, rows, f"How far the tip lands from {goals} goals that were never measured, mm"),
        "Floor: noise of the tracker, and commands in whole counts; no model can do better.",
        f"Hidden by seed {truth.seed}: {truth.words} ({truth.effect}).",
        f"Named by diagnose: {named.words}: {truth.verdict(named)}.",
        f"With that in the model, the report says: {reported}",
        f"Report: {folder / 'report.html'}. All in {seconds:.0f} s.",
    )
    document = {
        "schema": "lrm/demo/1", "seed": truth.seed, "hidden": truth.effect, "verdict": named.verdict,
        "named": named.name, "indistinguishable_from": named.rivals, "right": right, "reported": reported,
        "seconds": seconds,
        "rms_mm": {row[0]: row[2] for row in rows}, "floor_rms_mm": {row[0]: row[4] for row in rows},
    }  # fmt: skip
    (folder / "demo.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
