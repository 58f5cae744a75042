"""`python -m validation.json_numbers BEFORE AFTER`: do two checkouts print the same numbers in their JSON?

Both run the same commands on the shipped example. Every number is compared by its key. Texts may differ; dates, times
and provenance are left out. Exit code 1 if a number differs, or a key with one is missing.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from validation.readability.texts import lay_out, run

COMMANDS = (
    "fit DATA.csv -o model.toml",
    "compare model.toml DATA.csv",
    "diagnose model.toml DATA.csv",
    "add model.toml DATA.csv backlash@joint2 -o better.toml",
    "diagnose better.toml DATA.csv",
    "auto model.toml DATA.csv -o best.toml --no-nested --max-effects 1",
    "show better.toml",
    "report better.toml DATA.csv -o report.html",
    "predict better.toml FEW.csv -o predicted.csv",
    "transfer better.toml --to lrm-lab -o moved.toml",
    "identify-parameters lrm-lab FEW.csv",
    "choose-poses DATA.csv -n 40",
    "design lrm-lab -n 40 --levels 3",
    "selftest lrm-lab FEW.csv --only backlash@joint2",
    "reach lrm-lab --step-mm 80 --directions 12 --rolls 2 --no-collisions",
    "fit FEW.csv -o few.toml",
    "diagnose few.toml FEW.csv",
)
TOLERANCE = 1e-9
LEFT_OUT = {"date", "seconds", "version", "elapsed_s", "goals_per_s", "provenance"}


def numbers(value: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a JSON value, with its key."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, int | float):
        yield key, float(value)
    elif isinstance(value, dict):
        for name, each in value.items():
            if name not in LEFT_OUT:
                yield from numbers(each, f"{key}.{name}")
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from numbers(each, f"{key}[{index}]")


def found_by(tree: Path) -> dict[str, dict[str, float]]:
    """Numbers of every command of a checkout, by command and key."""
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        lay_out(tree, Path(folder))
        for words in COMMANDS:
            run(tree, [sys.executable, "-m", "lrm_ident", *words.split(), "--json", "out.json"], Path(folder))
            found[words] = dict(numbers(json.loads(Path(folder, "out.json").read_text(encoding="utf-8"))))
    return found


def differences(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """What a user of the numbers would notice, a line each."""
    lines = [f"{key} is gone ({value:g})" for key, value in before.items() if key not in after]
    lines += [
        f"{key}: {value:.9g} is now {after[key]:.9g}"
        for key, value in before.items()
        if key in after and abs(after[key] - value) > TOLERANCE * max(1.0, abs(value))
    ]
    return lines


def main() -> None:
    """Prints a line per command, and what differs."""
    before, after = (found_by(Path(word).resolve()) for word in sys.argv[1:3])
    different = 0
    for words in COMMANDS:
        lines = differences(before[words], after[words])
        new = len(after[words].keys() - before[words].keys())
        print(f"{len(before[words]):6d} numbers, {len(lines)} differ, {new} new: {words}")
        for line in lines[:20]:
            print(f"       {line}")
        different += len(lines)
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
