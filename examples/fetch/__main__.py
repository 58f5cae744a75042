"""A stone at a measured place into the basket: `python -m examples.fetch [--stones 8] [--seed N] [--out FOLDER]`.

A rover is simulated whose arm has hidden errors: board (real bytes on a real pty), daemon and zenoh are real. Stones
lie in the author's ground area. Each is fetched with the arm as drawn, then with a model fitted to measurements. There
is no contact in the simulation: where the tip is when the gripper closes decides whether the stone is in it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from examples.fetch.places import stones
from examples.fetch.skills import GRASP, Fetched, fetch
from examples.fetch.world import calibration, simulated_rover
from lrm_math.errors import LrmError


def main(argv: list[str] | None = None) -> int:
    """Runs the example. Exit code 0, or 2 with one line that says what failed."""
    p = argparse.ArgumentParser("examples.fetch", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--stones", type=int, default=8)
    p.add_argument("--seed", type=int, default=1, help="of the hidden errors and the stones")
    p.add_argument("--out", type=Path, default=Path("out"), help="where fetch.json goes (default: %(default)s)")
    options = p.parse_args(argv)
    try:
        found = run(options.stones, options.seed)
        options.out.mkdir(parents=True, exist_ok=True)
        path = options.out / "fetch.json"
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    except (LrmError, OSError) as error:
        print(f"examples.fetch: {error}", file=sys.stderr)
        return 2
    return 0


def run(count: int, seed: int) -> dict[str, object]:
    """Fetches every stone with both models; the values of the result."""
    result: dict[str, object] = {"seed": seed, "stones": count}
    with tempfile.TemporaryDirectory(prefix="lrm-fetch-") as private, simulated_rover(Path(private), seed) as world:
        for model in ("as drawn", "calibrated"):
            if model == "calibrated":
                world.rover.deploy(calibration(Path(private), seed), accept=True)
            outcomes = []
            for number, stone in enumerate(stones(count, seed), start=1):
                outcomes.append(fetch(world, stone))
                print(_line(model, number, stone.mass, outcomes[-1]), flush=True)
            result[model] = _summary(model, outcomes)
    return result


def _line(model: str, number: int, mass: float, outcome: Fetched) -> str:
    missed = "" if outcome.missed is None else f", tip {outcome.missed * 1e3:.1f} mm off"
    return f"{model}: stone {number}, {mass * 1e3:.0f} g: {outcome.what}{missed}"


def _summary(model: str, outcomes: list[Fetched]) -> dict[str, object]:
    there = [outcome.missed * 1e3 for outcome in outcomes if outcome.missed is not None]
    inside = sum(outcome.in_basket for outcome in outcomes)
    middle = sorted(there)[len(there) // 2] if there else float("nan")
    print(f"{model}: {inside} of {len(outcomes)} in the basket; tip {middle:.1f} mm off in the median")
    print(f"(a stone is grasped within {GRASP * 1e3:.0f} mm)\n", flush=True)
    return {"in_basket": inside, "missed_mm": there, "outcomes": [outcome.what for outcome in outcomes]}


if __name__ == "__main__":
    sys.exit(main())
