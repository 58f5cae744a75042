"""Figure of a story: how the error fell from the nominal arm, by what, and what it is where the model is used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from lrm_ident.data.wording import UNSEEN
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, figure_file
from lrm_ident.report.story import Kind, Story

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS: Mapping[Kind, str] = {
    "nominal": NOMINAL,
    "fit": "#57606a",
    "identified cause": MODEL,
    "indistinguishable cause": GREEN,
    "candidate cause": GREEN,
    "empirical term": HELD_OUT,
    "effect": "#57606a",
    "end": "black",
}
BESIDE: Any = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
ROW, LABEL = 0.36, 34
"""Inches of a row; letters of a line."""


def draw_story(story: Story, path: Path | None = None) -> Figure:
    """Draws the waterfall. Raises `FileError` for an unknown format or place."""
    scale, rows = story.longest, (*story.steps, *story.ends)
    with figure_file(path, 8.5, 1.3 + ROW * len(rows)) as figure:
        axes = figure.subplots()
        for row, step in enumerate(rows):
            height = 0.4 if step.kind == "end" else 0.8
            colour, error_left, before = COLOURS[step.kind], min(step.rms_mm, scale), min(step.before_rms_mm, scale)
            axes.barh(row, error_left, height, color=colour, alpha=0.3)
            axes.barh(row, before - error_left, height, left=error_left, color=colour)
            cut = " (bar cut short)" if step.rms_mm > scale else ""
            axes.annotate(f"{step.left}{cut}", (before, row), **BESIDE)
        if story.noise is not None:
            words = f"{story.noise.title} {story.noise.left} mm"
            axes.axvline(story.noise.rms_mm, color="black", linestyle=":", label=words)
            axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.16 - 0.3 / len(rows)), frameon=False)
        kinds = [f"\n{step.kind}" if step.number and step.kind != "effect" else "" for step in rows]
        names = [fill(step.title, LABEL) + kind for step, kind in zip(rows, kinds, strict=True)]
        axes.set_yticks(range(len(rows)), names, fontsize=9)
        axes.set(xlim=(0, 1.18 * scale), ylim=(len(rows) - 0.4, -0.6))
        title = "How the error fell" + (f", {UNSEEN}" if story.held_out else "")
        axes.set(title=title, xlabel="RMS error of the tip, mm: pale what remains, solid what was taken away")
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    return figure
