"""A stone at a measured place into the basket: `python -m examples.fetch [--stones 20] [--seed N] [--out FOLDER]`.

A rover is simulated whose arm has hidden errors: board (real bytes on a real pty), daemon and zenoh are real. Stones
lie in the author's ground area. Each is fetched with the arm as drawn, then with a model fitted to measurements. There
is no contact in the simulation: where the tip is when the gripper closes decides whether the stone is in it, and a
switch in the fingers that tells of the ground does so where the true tip is below it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from examples.fetch.picture import draw
from examples.fetch.places import Stone, stones
from examples.fetch.skills import GRASP, Fetched, fetch
from examples.fetch.world import calibration, simulated_rover
from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError

MODELS = ("as drawn", "calibrated")


def main(argv: list[str] | None = None) -> int:
    """Runs the example. Exit code 0, or 2 with one line that says what failed."""
    p = OneLineParser("python -m examples.fetch", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--stones", type=int, default=20)
    p.add_argument("--seed", type=int, default=1, help="of the hidden errors and the stones")
    p.add_argument("--out", type=Path, default=Path("out"), help="for fetch.json, .png and .mcap (default: out)")
    try:
        options = p.parse_args(argv)
        found, recording = run(options.stones, options.seed)
        options.out.mkdir(parents=True, exist_ok=True)
        path = options.out / "fetch.json"
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        draw(path, path.with_suffix(".png"))
        path.with_suffix(".mcap").write_bytes(recording)
    except (LrmError, OSError) as error:
        print(f"examples.fetch: {error}", file=sys.stderr)
        return 2
    return 0


def run(count: int, seed: int) -> tuple[dict[str, object], bytes]:
    """Fetches every stone with both models; the values of the result, and the run as an MCAP file."""
    result: dict[str, object] = {"seed": seed, "grasp_mm": GRASP * 1e3}
    with tempfile.TemporaryDirectory(prefix="lrm-fetch-") as private, simulated_rover(Path(private), seed) as world:
        found = stones(count, seed)
        for model in MODELS:
            if model == "calibrated":
                world.rover.deploy(calibration(Path(private), seed), accept=True)
            outcomes = []
            for number, stone in enumerate(found, start=1):
                outcomes.append(fetch(world, stone))
                said = _line(model, number, stone, outcomes[-1])
                world.note(said)
                print(said, flush=True)
            result[model] = [_values(*pair) for pair in zip(found, outcomes, strict=True)]
            _summary(model, found, outcomes)
        distances, recording = world.distances(), world.recording(found)
        result |= {"distances": asdict(distances), "asked_again": world.again}
    print(
        f"{len(world.again)} skills were asked for again, as the computer was too busy\n"
        f"independent distance check: {distances.ticks} ticks, {distances.violations} nearer than is required; least "
        f"spare {distances.least_spare * 1e3:.2f} mm, {distances.pair} (rounding to counts: "
        f"{distances.tolerance * 1e3:.2f} mm at most)"
    )
    return result, recording


def _line(model: str, number: int, stone: Stone, outcome: Fetched) -> str:
    missed = "" if outcome.missed is None else f", tip {outcome.missed * 1e3:.1f} mm off"
    ground = f"slope {np.degrees(stone.slope):.0f} deg" if stone.slope else "level"
    return f"{model}: stone {number}, {stone.mass * 1e3:.0f} g, {ground}: {outcome.what}{missed}"


def _values(stone: Stone, outcome: Fetched) -> dict[str, object]:
    missed = None if outcome.missed is None else outcome.missed * 1e3
    return {
        "place_m": stone.place.tolist(), "mass_g": stone.mass * 1e3, "slope_deg": float(np.degrees(stone.slope)),
        "outcome": outcome.what, "tip_m": outcome.tip, "missed_mm": missed,
    }  # fmt: skip


def _summary(model: str, found: list[Stone], outcomes: list[Fetched]) -> None:
    for ground, sloped in (("level", False), ("slopes", True)):
        here = [o for s, o in zip(found, outcomes, strict=True) if bool(s.slope) == sloped]
        missed = [o.missed * 1e3 for o in here if o.missed is not None]
        inside = sum(o.in_basket for o in here)
        off = f"; tip off by {np.median(missed):.1f} mm in the median, {max(missed):.1f} at most" if missed else ""
        print(f"{model}, {ground}: {inside} of {len(here)} in the basket{off}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
