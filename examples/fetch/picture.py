"""Picture of a run, where stones lay and tips were: `python -m examples.fetch.picture out/fetch.json FILE.png`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from examples.fetch.places import areas
from lrm_ident.report.plots.style import MODEL, NOMINAL, figure_file, finish, plain_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"as drawn": NOMINAL, "calibrated": MODEL}
WORDS = {"as drawn": "nominal", "calibrated": "calibrated"}


def draw(source: Path, path: Path) -> None:
    """Draws the result of a run. Raises `FileError`."""
    found: dict[str, Any] = json.loads(source.read_text(encoding="utf-8"))
    with figure_file(path, 10.0, 4.4) as figure:
        left, right = figure.subplots(1, 2)
        _from_above(left, found)
        _errors(right, found)


def _from_above(axes: Axes, found: dict[str, Any]) -> None:
    """Each stone, with lines to where the tips were."""
    for name, area in areas().items():
        (x, y), (x_end, y_end) = 1e3 * np.array(area.low[:2]), 1e3 * np.array(area.high[:2])
        axes.fill([x, x_end, x_end, x], [y, y, y_end, y_end], color="#eeeeee", zorder=0)
        axes.text(x + 2, y_end - 3, name, fontsize=9, color="#555555", verticalalignment="top")
    places = 1e3 * np.array([entry["place_m"] for entry in found["calibrated"]])
    for model, colour in COLOURS.items():
        lines = [(e["place_m"], e["tip_m"]) for e in found[model] if e["tip_m"] is not None]
        for place, tip in 1e3 * np.array(lines)[:, :, :2]:
            axes.plot(*np.array([place, tip]).T, color=colour, linewidth=1.5)
        axes.plot(*(1e3 * np.array([tip for _, tip in lines])[:, :2].T), "o", color=colour, markersize=3)
    axes.plot(places[:, 0], places[:, 1], "o", markersize=11, mfc="none", mec="black", label="stone")
    axes.set_aspect("equal")
    finish(
        axes, "x (mm)", "y (mm)", "From above: lines lead from a stone to the tip when the gripper closed", legend=False
    )


def _errors(axes: Axes, found: dict[str, Any]) -> None:
    """How far each tip was off, over the slope."""
    for model, colour in COLOURS.items():
        there = [entry for entry in found[model] if entry["missed_mm"] is not None]
        inside = sum(entry["outcome"] == "in the basket" for entry in found[model])
        label = f"{WORDS[model]}: {inside} of {len(found[model])} in the basket"
        off = [entry["missed_mm"] for entry in there]
        axes.semilogy([entry["slope_deg"] for entry in there], off, "o", color=colour, label=label)
    axes.axhline(found["grasp_mm"], color="black", linestyle="--", linewidth=1)
    axes.text(0.0, 1.08 * found["grasp_mm"], "a stone is grasped below this line", fontsize=9)
    axes.yaxis.set_major_formatter(plain_number)
    finish(axes, "slope of the ground (deg)", "tip off the stone's middle (mm)", "Error when the gripper closes")


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
