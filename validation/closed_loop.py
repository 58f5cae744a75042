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
from validation.options import asked

RATIO = 1.5


def demo_document(seed: int) -> dict[str, Any]:
    """The results of one demo. Raises `LrmError` if it fails."""
    with tempfile.TemporaryDirectory(prefix="lrm-loop-") as folder:
        command = [sys.executable, "-m", "examples.demo", "--seed", str(seed), "--out", folder]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode:
            raise LrmError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f"exit {done.returncode}")
        found: dict[str, Any] = json.loads((Path(folder) / "demo.json").read_text(encoding="utf-8"))
        return found


def main() -> int:
    """Prints one line a seed."""
    options = asked(__doc__, seeds=30, first=0)
    named = near = 0
    print("| seed | hidden | named | with it | nominal mm | fitted mm | deployed mm | floor mm | ratio | s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for seed in range(options.first, options.first + options.seeds):
        try:
            one = demo_document(seed)
        except LrmError as error:
            print(f"| {seed} | failed: {error} |", flush=True)
            continue
        last = list(one["rms_mm"])[-1]
        error, floor = one["rms_mm"][last], one["floor_rms_mm"][last]
        named += one["right"]
        near += error <= RATIO * floor
        figures = [one["rms_mm"]["nominal"], one["rms_mm"]["fitted"], error, floor, error / floor]
        cells = [seed, one["hidden"], one["named"] or one["verdict"], len(one["indistinguishable_from"])]
        print(
            "|",
            " | ".join([*map(str, cells), *(f"{v:.2f}" for v in figures), f"{one['seconds']:.0f}"]),
            "|",
            flush=True,
        )
    print(f"named: {named} of {options.seeds}; at most {RATIO:g} times the floor: {near} of {options.seeds}")
    return int(named < options.seeds * 14 / 15 or near < options.seeds)


if __name__ == "__main__":
    sys.exit(main())
