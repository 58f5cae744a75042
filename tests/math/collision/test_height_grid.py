"""Heightfields: against dense points of segments over every column, and as obstacles of a scene against boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.collision_shapes import Box, HeightField
from lrm_math.arrays import Array
from lrm_math.collision.height_grid import FAR, HeightGrid
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError
from tests.support.sweep import examples

seeds = st.integers(0, 10_000)
DENSE = 401


def random_grid(rng: np.random.Generator, most: int = 40) -> HeightGrid:
    """Rough ground, with holes."""
    rows, columns = rng.integers(1, most, 2)
    heights = rng.normal(0.0, 10.0 ** rng.uniform(-2.5, -0.5), (rows, columns))
    heights[rng.random((rows, columns)) < rng.choice([0.0, 0.3])] = -np.inf
    return HeightGrid(heights, float(rng.uniform(0.01, 0.1)))


def random_segments(rng: np.random.Generator, grid: HeightGrid, count: int) -> tuple[Array, Array]:
    """Segments about the grid, (N, 3) each."""
    rows, columns = grid.heights.shape
    a = rng.uniform(-0.2, 0.2, (count, 3)) + rng.random((count, 3)) * (columns * grid.cell, rows * grid.cell, 0.3)
    return a, a + rng.normal(0.0, 0.15, (count, 3)) * (rng.random((count, 1)) < 0.9)


def gaps(grid: HeightGrid, points: Array) -> tuple[Array, Array]:
    """(P,), m: distance of points (P, 3) to the nearest column, and to the nearest place that no column fills."""
    to_solid, to_free = np.full(len(points), np.inf), np.full(len(points), np.inf)
    rows, columns = grid.heights.shape
    for i in range(-1, rows + 1):
        for j in range(-1, columns + 1):
            high = grid.heights[i, j] if 0 <= i < rows and 0 <= j < columns else -np.inf
            ends = [(j, columns, points[:, 0]), (i, rows, points[:, 1])]
            across = [
                np.maximum(
                    np.maximum(k * grid.cell - x if k >= 0 else 0.0, x - (k + 1) * grid.cell if k < n else 0.0), 0.0
                )
                for k, n, x in ends
            ]
            side = np.hypot(*across)
            to_free = np.minimum(to_free, np.hypot(side, np.maximum(high - points[:, 2], 0.0)))
            if high > -np.inf:
                to_solid = np.minimum(to_solid, np.hypot(side, np.maximum(points[:, 2] - high, 0.0)))
    return to_solid, to_free


@pytest.mark.long
@given(seeds)
@examples(20, 40)
def test_the_distance_is_that_of_the_nearest_point_and_column(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = random_grid(rng, 12)
    a, b = random_segments(rng, grid, 12)
    points = a[:, None] + np.linspace(0.0, 1.0, DENSE)[:, None] * (b - a)[:, None]
    sampled = gaps(grid, points.reshape(-1, 3))[0].reshape(-1, DENSE).min(axis=1)
    found, spacing = grid.distance(a, b), np.linalg.norm(b - a, axis=1) / (DENSE - 1)
    expected = np.minimum(sampled, FAR)
    assert (found <= expected + 1e-9).all()
    assert (found >= np.minimum(sampled - 0.5 * spacing, FAR) - 1e-9).all()


@pytest.mark.long
@given(seeds)
@examples(20, 40)
def test_the_depth_is_no_more_than_the_way_out_and_more_than_nothing_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = random_grid(rng, 30)
    a, _ = random_segments(rng, grid, 60)
    to_solid, to_free = gaps(grid, a)
    depth = grid.depth(a, a)
    assert (depth <= to_free + 1e-9).all()
    assert np.array_equal(depth > 0.0, (to_solid == 0.0) & (to_free > 0.0))


@given(seeds)
@examples(15, 30)
def test_distance_and_depth_change_no_faster_than_the_segment_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = random_grid(rng)
    a, b = random_segments(rng, grid, 60)
    moved = [x + rng.normal(0.0, 10.0 ** rng.uniform(-4, -1), x.shape) for x in (a, b)]
    most = np.maximum(*(np.linalg.norm(new - old, axis=1) for new, old in zip(moved, (a, b), strict=True)))
    for one in (grid.distance, grid.depth):
        assert (np.abs(one(*moved) - one(a, b)) <= most + 1e-9).all()


def test_a_heightfield_of_a_scene_is_as_far_as_the_boxes_that_it_is_made_of() -> None:
    """Turned and moved; only the depth below its surface may differ, which of a box counts its other sides, too."""
    arm, rng = load_arm("lrm-rover"), np.random.default_rng(3)
    bare = replace(arm, shapes=replace(arm.shapes, boxes=(), ignored=()))
    heights, cell, turn, origin = rng.uniform(-0.1, 0.25, (3, 4)), 0.15, (0.2, -0.1, 0.7), np.array([-0.2, -0.3, 0.1])
    field = HeightField("map", tuple(origin), cell, tuple(map(tuple, heights)), turn)
    scene = Scene.of(bare, around=[field])
    R = scene.grids[0].rotation
    boxes = []
    for i, row in enumerate(heights):
        for j, high in enumerate(row):
            centre = origin + R @ [(j + 0.5) * cell, (i + 0.5) * cell, high - 1.0]
            boxes.append(Box(f"{i} {j}", tuple(centre), (cell, cell, 2.0), turn))
    boxed = Scene.of(bare, around=boxes)
    placed = scene.frames(rng.uniform(-1.5, 1.5, (60, 6)))
    found, of_boxes = scene.distances(placed), boxed.distances(placed)
    for name in sorted({first for first, second in scene.names.tolist() if second == "map"}):
        mine = found[:, scene.names.tolist().index([name, "map"])]
        theirs = of_boxes[:, [first == name and second not in scene.names for first, second in boxed.names.tolist()]]
        radius = next(c.radius for c in arm.shapes.capsules if c.name == name)
        assert mine == pytest.approx(np.minimum(theirs.min(axis=1), FAR - radius), abs=1e-9)
    assert (found.min(axis=1) < 0.0).any()


@pytest.mark.parametrize(("cell", "heights"), [(0.0, ((0.1,),)), (0.1, ()), (0.1, ((),)), (0.1, ((0.1,), (0.1, 0.2)))])
def test_what_is_no_grid_is_refused(cell: float, heights: tuple[tuple[float, ...], ...]) -> None:
    with pytest.raises(LrmError, match="heightfield 'map'"):
        HeightField("map", (0.0, 0.0, 0.0), cell, heights)
