"""Picture of an arm: its axes, links and masses from the side, from above and in space."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, figure_file
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.model.model import model_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXIS_LENGTH = 0.12  # of the arm's size
VIEWS = ((0, 2, "from the side"), (1, 2, "from the front"), (0, 1, "from above"))


def draw_arm(arm: Arm, q: Array, path: Path) -> None:
    """Draws an arm at joint angles q (n,), rad. Raises `FileError` for an unknown format or place."""
    chain = model_of(arm, ()).chain
    geometry = chain_geometry(chain, chain.values([float(angle) for angle in q]), 1)
    slots = [chain.index[f"{place}.theta"] for place in arm.link_places]
    names = [place.removeprefix("joint") for place in arm.link_places]
    axes, points = geometry.axis[slots, :, 0], 1e3 * geometry.origin[slots, :, 0]
    line = 1e3 * np.concatenate([np.zeros((1, 3)), geometry.origin[:, :, 0], geometry.tcp.T])
    size = float(np.ptp(line, axis=0).max())
    heavy = [(1e3 * geometry.body[k, :, 0], body.mass) for k, body in enumerate(chain.bodies) if body.mass]
    with figure_file(path, 13.5, 4.8) as figure:
        for panel, (i, j, title) in zip(figure.subplots(1, 3), VIEWS, strict=True):
            _draw_view(panel, i, j, line, points, axes * AXIS_LENGTH * size, names, heavy)
            panel.set(xlabel=f"{'xyz'[i]}, mm", ylabel=f"{'xyz'[j]}, mm", title=f"{arm.name} {title}")


def _draw_view(
    panel: Axes,
    i: int,
    j: int,
    line: Array,
    points: Array,
    arrows: Array,
    names: list[str],
    heavy: list[tuple[Array, float]],
) -> None:
    panel.plot(line[:, i], line[:, j], color=NOMINAL, lw=5, solid_capstyle="round", alpha=0.6, zorder=1)
    for name, point, arrow in zip(names, points, arrows, strict=True):
        ends = np.stack([point - arrow, point + arrow])
        panel.plot(ends[:, i], ends[:, j], color=MODEL, lw=1.5, zorder=3)
        panel.annotate(name, (point[i], point[j]), color=MODEL, xytext=(4, 4), textcoords="offset points", fontsize=9)
    panel.scatter(points[:, i], points[:, j], s=28, color=MODEL, zorder=4, label="joint axes")
    if heavy:
        centres, masses = np.array([where for where, _ in heavy]), np.array([mass for _, mass in heavy])
        sizes = 140 * masses / masses.max()
        panel.scatter(centres[:, i], centres[:, j], s=sizes, color=HELD_OUT, alpha=0.7, zorder=3, label="masses")
    panel.plot(*line[-1, [i, j]], marker="*", ms=13, color=GREEN, ls="", label="TCP", zorder=5)
    panel.set_aspect("equal", adjustable="datalim")
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
