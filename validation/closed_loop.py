"""The demo over many seeds: is the hidden effect named, and how far from its goals does the tip land after deployment.

`python -m validation.closed_loop --seeds 30` (a minute or two a seed). Exit code 1 unless the effect is named, alone
or in a group, in all but one of fifteen seeds, and the error at goals is at most 1.5 times the floor in all.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from lrm_math.errors import LrmError
from validation.options import Count, asked
from validation.runner import run_cases
from validation.tables import markdown_table, table_row

RATIO = 1.5
COLUMNS = ("seed", "hidden", "named", "with it", "nominal mm", "fitted mm", "deployed mm", "floor mm", "ratio", "s")


def demo_document(seed: int) -> dict[str, Any]:
    """The results of one demo. Raises `LrmError` if it fails."""
    with tempfile.TemporaryDirectory(prefix="lrm-loop-") as folder:
        command = [sys.executable, "-m", "examples.demo", "--seed", str(seed), "--out", folder]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode:
            raise LrmError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"exit {done.returncode}")
        found: dict[str, Any] = json.loads((Path(folder) / "demo.json").read_text(encoding="utf-8"))
        return found


def demo_or_failure(seed: int) -> dict[str, Any]:
    """The results of one demo, or why it failed."""
    try:
        return demo_document(seed)
    except LrmError as error:
        return {"failed": str(error)}


def row(key: str, one: dict[str, Any]) -> tuple[object, ...]:
    """A seed's line of the table."""
    if "failed" in one:
        return key, f"failed: {one['failed']}", *[""] * (len(COLUMNS) - 2)
    error, floor = deployed_and_floor(one)
    figures = [one["rms_mm"]["nominal"], one["rms_mm"]["fitted"], error, floor, error / floor]
    words = (one["hidden"], one["named"] or one["verdict"], len(one["indistinguishable_from"]))
    return key, *words, *(f"{value:.2f}" for value in figures), f"{one['seconds']:.0f}"


def deployed_and_floor(one: dict[str, Any]) -> tuple[float, float]:
    """Errors (mm RMS) at goals by the model that was deployed last, and with all causes known."""
    last = list(one["rms_mm"])[-1]
    return one["rms_mm"][last], one["floor_rms_mm"][last]


def main() -> int:
    """Prints one line a seed."""
    options = asked(__doc__, seeds=Count(30), first=0)
    seeds = range(options.first, options.first + options.seeds)
    found = run_cases({str(seed): seed for seed in seeds}, demo_or_failure, lambda *of: table_row(row(*of)))
    print(markdown_table(COLUMNS, [row(key, one) for key, one in found.items()]))
    done = [one for one in found.values() if "failed" not in one]
    named = sum(bool(one["right"]) for one in done)
    near = sum(error <= RATIO * floor for error, floor in map(deployed_and_floor, done))
    print(f"named: {named} of {options.seeds}; at most {RATIO:g} times the floor: {near} of {options.seeds}")
    return int(named < options.seeds * 14 / 15 or near < options.seeds)


if __name__ == "__main__":
    sys.exit(main())
