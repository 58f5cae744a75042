"""Figure of `reach`: two cuts through a capability map, and the variants beside each other (thesis Figure 3.1)."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lrm_ident.design.workspace.capability_map import CapabilityMap
from lrm_ident.design.workspace.voxel_grid import bounding_ball
from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file
from lrm_ident.report.workspace import VariantComparison
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

MM_PER_M = 1e3
ROW, SHORTEST = 0.27, 4.6
"""Height of one variant's bar, and of the figure at least (inches)."""


def draw_reach(comparison: VariantComparison, path: Path) -> None:
    """Draws the first map, cut twice, and all variants. Raises `FileError` for an unknown format or place."""
    compared = len(comparison.maps) > 1
    size = (16.5, max(SHORTEST, 1.2 + ROW * len(comparison.maps))) if compared else (10.5, SHORTEST)
    widths = (1, 1, 0.6) if compared else (1, 1)
    first, level = comparison.maps[0], _height(comparison)
    middle = float(bounding_ball(comparison.variants[0].arm)[0][1])
    most = 100 * max(float(_layer(first, k, at).max()) for k, at in ((1, middle), (2, level))) or 1.0
    with figure_file(path, *size) as figure:
        axes = figure.subplots(1, len(widths), width_ratios=widths)
        _draw_cut(axes[0], comparison, (0, 2), middle, most)
        mesh = _draw_cut(axes[1], comparison, (0, 1), level, most)
        figure.colorbar(mesh, ax=axes[:2], label="orientations that can be taken, %", shrink=0.8)
        if compared:
            _draw_variants(axes[2], comparison)


def _height(comparison: VariantComparison) -> float:
    """Heights to cut level (m): through the middle of the first area, or where the map holds most."""
    first = comparison.maps[0]
    if comparison.areas:
        return 0.5 * (comparison.areas[0].low[2] + comparison.areas[0].high[2])
    best = int(np.argmax(first.grid.by_axis(first.index).sum(axis=(0, 1))))
    return float(first.grid.axis(2)[best])


def _draw_cut(axes: Axes, comparison: VariantComparison, plane: tuple[int, int], at: float, most: float) -> QuadMesh:
    """The mean of the two layers of cells on either side of `at` (m) along the axis that `plane` leaves out."""
    from matplotlib.patches import Rectangle

    arm, first = comparison.variants[0].arm, comparison.maps[0]
    i, j = plane
    k = 3 - i - j
    seen = 100 * _layer(first, k, at)
    edges = [MM_PER_M * first.grid.step * (first.grid.first[a] + np.arange(first.grid.count[a] + 1)) for a in plane]
    shown = np.ma.masked_equal(seen, 0.0)
    mesh = axes.pcolormesh(*edges, shown.T, cmap="viridis", vmin=0.0, vmax=most, rasterized=True)
    x, y = (axis[np.nonzero(seen.any(axis=1 - number))[0]] for number, axis in enumerate(edges))
    _draw_boxes(axes, arm, plane, k, at)
    _draw_arm(axes, arm, plane)
    for area in comparison.areas:
        if area.low[k] <= at <= area.high[k]:
            low, high = (MM_PER_M * np.array(corner)[[i, j]] for corner in (area.low, area.high))
            style: Any = {"fill": False, "edgecolor": HELD_OUT, "linewidth": 2, "linestyle": "--"}
            axes.add_patch(Rectangle(tuple(low), *(high - low), **style))
            axes.annotate(area.name, tuple(high), color=HELD_OUT, ha="right", va="bottom", weight="bold")
    step = MM_PER_M * first.grid.step
    if len(x) and len(y):
        axes.set(xlim=(x.min() - 2 * step, x.max() + 3 * step), ylim=(y.min() - 2 * step, y.max() + 3 * step))
    title = f"Reach of {arm.name}, cut at {'xyz'[k]} = {MM_PER_M * at:.0f} mm"
    axes.set(xlabel=f"{'xyz'[i]}, mm", ylabel=f"{'xyz'[j]}, mm", aspect="equal", title=title)
    return mesh


def _layer(capability: CapabilityMap, k: int, at: float) -> Array:
    """The map's mean of the two layers nearest to `at` along axis k."""
    nearest = np.argsort(np.abs(capability.grid.axis(k) - at), kind="stable")[:2]
    return np.asarray(capability.grid.by_axis(capability.index).take(nearest, axis=k).mean(axis=k))


def _draw_boxes(axes: Axes, arm: Arm, plane: tuple[int, int], k: int, at: float) -> None:
    """Outlines of what stands around the arm, where the cut goes through it."""
    if not arm.shapes.capsules:
        return
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    scene = Scene.of(arm)
    signs = np.array(list(product((-1, 1), repeat=3)))
    for turn, centre, half in zip(scene.box_rotation, scene.box_centre, scene.box_half, strict=True):
        corners = centre + (signs * half) @ turn.T
        if corners[:, k].min() <= at <= corners[:, k].max():
            flat = MM_PER_M * corners[:, plane]
            outline = flat[ConvexHull(flat).vertices]
            axes.add_patch(Polygon(outline, facecolor=NOMINAL, edgecolor="black", alpha=0.35, hatch="//"))


def _draw_arm(axes: Axes, arm: Arm, plane: tuple[int, int]) -> None:
    """The lines between the arm's frames with all joints at zero."""
    chain = chain_of(arm)
    points = MM_PER_M * frames(chain, chain.values([0.0] * arm.dof), 1)[0, :, :3, 3][:, plane]
    axes.plot(*points.T, color="black", marker="o", markersize=4, linewidth=2, label="arm, joints at 0°")
    axes.legend(loc="upper left")


def _draw_variants(axes: Axes, comparison: VariantComparison) -> None:
    ranked = comparison.ranked[::-1]
    scale = 100.0 if comparison.areas else 1e3
    values = [scale * comparison.criterion(capability) for _, capability in ranked]
    colours = [MODEL if variant is comparison.variants[0] else NOMINAL for variant, _ in ranked]
    bars = axes.barh([variant.name.replace(",", ", ") for variant, _ in ranked], values, color=colours)
    axes.bar_label(bars, fmt="%.2f" if comparison.areas else "%.0f", padding=3, fontsize=9)
    axes.tick_params(axis="y", labelsize=9)
    what = "mean index in all areas, %" if comparison.areas else "volume, L"
    axes.set(xlabel=what, xlim=(0, 1.2 * max(values) or 1.0), title="Variants of the arm, best first")
