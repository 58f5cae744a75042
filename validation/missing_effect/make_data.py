"""The data sets of the benchmark, from the independent generator: `python -m validation.missing_effect.make_data`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from validation.hidden_effects.case import Case
from validation.hidden_effects.cases import DOUBLE, NOTHING, SINGLE
from validation.hidden_effects.data import dataset
from validation.synthetic import write

FOLDER = Path(__file__).with_name("data")
TRUTH = FOLDER / "truth.json"
SEED, POSES = 66, 200
SETS: Mapping[str, Case] = {
    "play": SINGLE["play3"],
    "two": DOUBLE["warm2+coupled3-2"],
    "nothing": NOTHING,
}
SOURCE = "synthetic: validation.missing_effect.make_data; the truth file says what is hidden"
CARD = """
[card]
title = "Benchmark 'which effect is missing', set {name}: {poses} random poses, two loads"
arm = "simulated: lrm-lab, printed, six hobby servos, with random errors of assembly and soft joints"
instrument = "simulated tracker"
noise = "as simulated: normal, independent, the same for all axes"
date = "2026-11-28"
authors = ["The lrm-arm developers"]
licence = "CC0-1.0"
"""


def main() -> None:
    """Writes the three data sets, and the names of what is hidden in them."""
    FOLDER.mkdir(exist_ok=True)
    for name, case in SETS.items():
        _, metadata, _ = write(FOLDER / name, dataset(case, SEED, POSES), SOURCE)
        card = CARD.format(name=name, poses=POSES)
        metadata.write_text(metadata.read_text(encoding="utf-8") + card, encoding="utf-8")
    truth = {name: [[effect] for effect in case.truth or ()] for name, case in SETS.items()}
    TRUTH.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
