"""`python -m validation.json_numbers BEFORE AFTER [DATA.csv]`: do two checkouts print the same numbers and names?

Both run the same commands on the shipped example, or on other measurements, and write JSON. Every number and every name
(a text without a space: an effect, a verdict, a unit) is compared by its key. Sentences may differ; dates, times,
hashes and provenance are left out. Exit code 1 if a number or a name differs, or a key with one is missing.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from validation.options import asked
from validation.readability.texts import EXAMPLE, OUTPUTS, lay_out, run

COMMANDS = (
    *OUTPUTS,
    "show better.toml",
    "report better.toml DATA.csv -o report.html",
    "predict better.toml FEW.csv -o predicted.csv",
    "transfer better.toml --to lrm-lab -o moved.toml",
    "identify-parameters lrm-lab FEW.csv",
    "choose-poses DATA.csv -n 40",
    "design lrm-lab -n 40 --levels 3",
    "selftest lrm-lab FEW.csv --only backlash@joint2",
    "reach lrm-lab --step-mm 80 --directions 12 --rolls 2 --no-collisions",
)
TOLERANCE = 1e-9
HASH = re.compile("[0-9a-f]{64}")
LEFT_OUT = {"date", "seconds", "version", "elapsed_s", "goals_per_s", "provenance", "schema"}


def numbers_and_names(value: Any, key: str = "") -> Iterator[tuple[str, float | str]]:
    """Every number and every name of a JSON value, with its key."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, int | float):
        yield key, float(value)
    elif isinstance(value, str) and value and not any(map(str.isspace, value)) and not HASH.fullmatch(value):
        yield key, value
    elif isinstance(value, dict):
        for name, each in value.items():
            if name not in LEFT_OUT:
                yield from numbers_and_names(each, f"{key}.{name}")
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from numbers_and_names(each, f"{key}[{index}]")


def found_by(tree: Path, data: Path | None) -> dict[str, dict[str, float | str]]:
    """Numbers and names of every command of a checkout, by command and key."""
    found: dict[str, dict[str, float | str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        lay_out(data or tree / EXAMPLE, Path(folder))
        for words in COMMANDS:
            run(tree, [sys.executable, "-m", "lrm_ident", *words.split(), "--json", "out.json"], Path(folder))
            found[words] = dict(numbers_and_names(json.loads(Path(folder, "out.json").read_text(encoding="utf-8"))))
    return found


def differences(before: dict[str, float | str], after: dict[str, float | str]) -> list[str]:
    """What a user of the numbers and names would notice, a line each."""
    gone = [f"{key} is gone ({value})" for key, value in before.items() if key not in after]
    known = {key: (value, after[key]) for key, value in before.items() if key in after}
    return gone + [f"{key}: {old} is now {new}" for key, (old, new) in known.items() if not alike(old, new)]


def alike(one: float | str, other: float | str) -> bool:
    """Whether two names are the same, or two numbers to nine digits."""
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return abs(other - one) <= TOLERANCE * max(1.0, abs(one))


def main() -> None:
    """Prints a line per command, and what differs."""
    given = asked(__doc__, "before", "after", "data?")
    data = None if given.data is None else given.data.resolve()
    before, after = (found_by(tree.resolve(), data) for tree in (given.before, given.after))
    different = 0
    for words in COMMANDS:
        lines = differences(before[words], after[words])
        new = len(after[words].keys() - before[words].keys())
        print(f"{len(before[words]):6d} values, {len(lines)} differ, {new} new: {words}")
        for line in lines[:20]:
            print(f"       {line}")
        different += len(lines)
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
