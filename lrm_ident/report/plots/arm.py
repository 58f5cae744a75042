"""Picture of an arm: its links as solids, joint axes and masses, obliquely and from the side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, figure_file
from lrm_ident.residual.picture.arm_solids import arm_solids, placed
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import chain_geometry, frames
from lrm_math.model.model import model_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXIS_LENGTH, LABEL_AT = 0.14, 1.3
"""Half an axis in parts of the arm's size; how far from a joint its number stands, in parts of that."""
OBLIQUE, SIDE = (-120.0, 22.0), (-90.0, 0.0)
"""Azimuth and elevation (deg) that the arm is seen from."""
ROUND = 24


def draw_arm(arm: Arm, q: Array, path: Path) -> None:
    """Draws an arm at joint angles q (n,), rad. Raises `FileError` for an unknown format or place."""
    chain = model_of(arm, ()).chain
    slots = chain.values([float(angle) for angle in q])
    geometry, there = chain_geometry(chain, slots, 1), frames(chain, slots, 1)
    numbers = [chain.index[f"{place}.theta"] for place in arm.link_places]
    names = [place.removeprefix("joint") for place in arm.link_places]
    solids = arm_solids(arm, there[0])
    points = 1e3 * np.concatenate([there[0, :, :3, 3], placed(solids, there)[0]])
    links = [(points[i], points[j], 1e3 * radius) for i, j, radius in solids.links]
    size = float(np.ptp(points, axis=0).max())
    along = AXIS_LENGTH * size * geometry.axis[numbers, :, 0]
    axes = [(name, 1e3 * geometry.origin[k, :, 0], ray) for name, k, ray in zip(names, numbers, along, strict=True)]
    heavy = [(1e3 * geometry.body[k, :, 0], body.mass) for k, body in enumerate(chain.bodies) if body.mass]
    with figure_file(path, 12.5, 5.6) as figure:
        for panel, seen, title in zip(figure.subplots(1, 2), (OBLIQUE, SIDE), ("", " from the side"), strict=True):
            _draw_view(panel, _view(*seen), links, axes, heavy, 1e3 * geometry.tcp[:, 0])
            panel.set(title=f"{arm.name}{title}", xlabel="x, mm", ylabel="z, mm")
            panel.grid()
            panel.set_axis_on() if seen is SIDE else panel.set_axis_off()
        handles, labels = panel.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def _view(azimuth: float, elevation: float) -> Array:
    """(3, 3), rows: right, up, towards the viewer."""
    a, e = np.radians([azimuth, elevation])
    right = [-np.sin(a), np.cos(a), 0.0]
    up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
    return np.array([right, up, [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]])


def _draw_view(
    panel: Axes,
    view: Array,
    links: list[tuple[Array, Array, float]],
    axes: list[tuple[str, Array, Array]],
    heavy: list[tuple[Array, float]],
    tcp: Array,
) -> None:
    """Links from behind to front, the axes with their numbers on either side in turn, masses and tip before them."""
    from matplotlib.patches import Polygon

    for start, other, radius in sorted(links, key=lambda link: float(view[2] @ (link[0] + link[1]))):
        outline = _capsule(view[:2] @ start, view[:2] @ other, radius)
        panel.add_patch(Polygon(outline, facecolor="#c9d6e2", edgecolor="#57606a", linewidth=0.8))
    way = view[:2] @ (axes[-1][1] - axes[0][1]) if len(axes) > 1 else np.array([0.0, 1.0])
    beside = np.array([-way[1], way[0]]) / max(float(np.linalg.norm(way)), 1e-9)
    box: Any = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": MODEL, "linewidth": 0.8}
    leader: Any = {"arrowstyle": "-", "color": MODEL, "linewidth": 0.6}
    for number, (name, origin, ray) in enumerate(axes):
        ends, joint = np.stack([origin - ray, origin + ray]) @ view[:2].T, view[:2] @ origin
        panel.plot(*ends.T, color=MODEL, lw=1.5, zorder=3, label=None if number else "joint axes")
        at = joint + LABEL_AT * float(np.linalg.norm(ray)) * beside * (1 if number % 2 else -1)
        panel.plot(*at[:, None], " ")  # the number counts for what the panel shows
        style: Any = {"color": MODEL, "fontsize": 8, "ha": "center", "va": "center", "zorder": 6}
        panel.annotate(name, tuple(joint), tuple(at), bbox=box, arrowprops=leader, **style)
    if heavy:
        centres, masses = np.array([view[:2] @ where for where, _ in heavy]), np.array([mass for _, mass in heavy])
        shown: Any = {"facecolor": HELD_OUT, "alpha": 0.7, "zorder": 4, "edgecolor": NOMINAL}
        panel.scatter(centres[:, 0], centres[:, 1], s=110 * masses / masses.max(), label="masses", **shown)
    panel.plot(*(view[:2] @ tcp)[:, None], marker="*", ms=13, color=GREEN, ls="", label="TCP", zorder=5)
    panel.set_aspect("equal", adjustable="datalim")
    panel.autoscale_view()
    panel.margins(0.08)


def _capsule(start: Array, other: Array, radius: float) -> Array:
    """(2 ROUND, 2), the outline of a capsule between two places."""
    along = other - start
    turn = float(np.arctan2(along[1], along[0]))
    half = np.linspace(0.5, 1.5, ROUND) * np.pi + turn
    first = start + radius * np.column_stack([np.cos(half), np.sin(half)])
    second = other - radius * np.column_stack([np.cos(half), np.sin(half)])
    return np.concatenate([first, second])
