"""The picture of docs/sockets.md: `python -m validation.touched_points.guide_picture`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.solid import triangles
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.touched_points.simulated_arms import ARM, TOUCHES, planned

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "sockets.png"
COLOURS = ("#3b6ea5", "#c1752c", "#5b8c5a")


def main() -> None:
    """Draws the board, and the arm that touches it at three placements."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(10, 4.2))
    board = SocketBoard()
    left = figure.add_subplot(1, 2, 1, projection="3d")
    _draw_board(left, triangles(board), "#c8c2b4", 1.0)
    for name, (x, y, z) in board.points.items():
        left.text(x, y, z + 9, name, fontsize=11, ha="center")
    _limits(left, np.array([80.0, 65.0, 20.0]), 92.0)
    left.view_init(35, -60)
    left.set_title("the board: A to D flat, E on a post", fontsize=10)
    right = figure.add_subplot(1, 2, 2, projection="3d")
    plan = planned(TOUCHES)
    for number, (placement, colour) in enumerate(zip(plan.placements, COLOURS, strict=True), start=1):
        T = placement.motion(board.points)
        moved = triangles(board) * 1e-3 @ T[:3, :3].T + T[:3, 3]
        _draw_board(right, moved * 1e3, colour, 0.5)
        goal = T[:3, :3] @ (np.array(board.points["E"]) * 1e-3) + T[:3, 3]
        row = next(k for k, at in enumerate(zip(plan.points, plan.placement, strict=True)) if at == ("E", number))
        joints = _skeleton(plan.q[row]) * 1e3
        right.plot(*joints.T, "o-", color=colour, markersize=3, linewidth=2)
        right.text(*(goal * 1e3 + [0, 0, 25]), f"placement {number}", fontsize=9, color=colour)
    _limits(right, np.array([150.0, 0.0, 150.0]), 230.0)
    right.view_init(25, -120)
    right.set_title("an arm touches it at three placements", fontsize=10)
    figure.tight_layout()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=110)


def _draw_board(axes: Any, faces: Array, colour: str, alpha: float) -> None:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=colour, alpha=alpha, shade=True, lightsource=LightSource(315, 45))
    )


def _skeleton(q: Array) -> Array:
    """(n + 2, 3), origins of the arm's frames (m)."""
    settled = solve_equilibrium(model_of(ARM, ()), poses_of(q))
    return np.asarray(frames(settled.model.chain, settled.slots, 1)[0, :, :3, 3])


def _limits(axes: Any, centre: Array, half: float) -> None:
    for name, middle in zip("xyz", centre, strict=True):
        getattr(axes, f"set_{name}lim")(middle - half, middle + half)
        getattr(axes, f"set_{name}label")(f"{name} (mm)", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.set_box_aspect((1, 1, 1))


if __name__ == "__main__":
    main()
