"""The board as a closed surface of triangles, and as a binary STL file.

The plate is made of tiles; each has the same points on its edges as its neighbours, so that the surface has no gap.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence

import numpy as np

from lrm_ident.measuring.sockets.board import COLUMNS, ROWS, SocketBoard
from lrm_math.arrays import Array

OF_A_SIDE = 12
"""Points on a side of a tile; a circle has four times as many."""
MARK_MM = 2.0
"""Height of the bumps beside A (one) and B (two)."""
WALL_MM = 2.5
"""Of the post around its socket."""
Ring = Sequence[tuple[float, float, float]]


def triangles(board: SocketBoard) -> Array:
    """(T, 3, 3), corners of the triangles of its surface (mm), seen from outside counterclockwise."""
    tiles = [triangle for row in range(ROWS) for column in range(COLUMNS) for triangle in _tile(board, column, row)]
    return np.array([*tiles, *_sides(board)])


def stl(board: SocketBoard) -> bytes:
    """The board as a binary STL file, in mm."""
    corners = triangles(board)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = [b"sockets; lengths in mm".ljust(80), struct.pack("<I", len(corners))]
    for normal, triangle in zip(normals, corners, strict=True):
        out.append(struct.pack("<12fH", *normal, *triangle.ravel(), 0))
    return b"".join(out)


def _tile(board: SocketBoard, column: int, row: int) -> Iterator[Array]:
    """Triangles of the upper and the lower face of one tile."""
    width, height = board.tile
    x, y = column * width, row * height
    top, below = _boundary(board, column, row, 0.0), _boundary(board, column, row, -board.thickness_mm)
    yield from _fan([*reversed(below)], (x, y, -board.thickness_mm))
    radius = board.opening_mm / 2.0
    if (column, row) in _sockets():
        yield from _cone(_band(top, (circle := _circle(x, y, radius, 0.0))), circle, (x, y, -radius))
    elif (column, row) == (COLUMNS // 2, ROWS // 2) and board.raised_mm:
        outer = min(radius + WALL_MM, 0.49 * min(board.tile))
        foot, rim = _circle(x, y, outer, 0.0), _circle(x, y, outer, board.raised_mm)
        opening = _circle(x, y, radius, board.raised_mm)
        faces = [*_band(top, foot), *_band(foot, rim), *_band(rim, opening)]
        yield from _cone(faces, opening, (x, y, board.raised_mm - radius))
    else:
        yield from _fan(top, (x, y, MARK_MM if (column, row) in _marks() else 0.0))


def _sockets() -> set[tuple[int, int]]:
    return {(0, 0), (COLUMNS - 1, 0), (COLUMNS - 1, ROWS - 1), (0, ROWS - 1)}


def _marks() -> set[tuple[int, int]]:
    """Tiles with a bump: one beside A, two beside B."""
    return {(1, 0), (COLUMNS - 2, 0), (COLUMNS - 1, 1)}


def _boundary(board: SocketBoard, column: int, row: int, z: float) -> Ring:
    """Points around a tile, counterclockwise from its lower left corner."""
    width, height = board.tile
    steps = [k / OF_A_SIDE for k in range(OF_A_SIDE)]
    around = [(s, 0.0) for s in steps] + [(1.0, s) for s in steps]
    around += [(1.0 - s, 1.0) for s in steps] + [(0.0, 1.0 - s) for s in steps]
    return [((column - 0.5 + a) * width, (row - 0.5 + b) * height, z) for a, b in around]


def _circle(x: float, y: float, radius: float, z: float) -> Ring:
    """Points on a circle, as many as around a tile and in the same order."""
    count = 4 * OF_A_SIDE
    angles = (2.0 * math.pi * k / count - 0.75 * math.pi for k in range(count))
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle), z) for angle in angles]


def _fan(ring: Ring, centre: tuple[float, float, float]) -> Iterator[Array]:
    for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
        yield np.array([a, b, centre])


def _band(outer: Ring, inner: Ring) -> list[Array]:
    """Triangles between two rings of as many points."""
    faces = []
    following = zip([*outer[1:], outer[0]], [*inner[1:], inner[0]], strict=True)
    for (a, c), (b, d) in zip(zip(outer, inner, strict=True), following, strict=True):
        faces += [np.array([a, b, c]), np.array([b, d, c])]
    return faces


def _cone(faces: Sequence[Array], opening: Ring, apex: tuple[float, float, float]) -> Iterator[Array]:
    yield from faces
    yield from _fan(opening, apex)


def _sides(board: SocketBoard) -> Iterator[Array]:
    """Triangles of the plate's four sides."""
    for column in range(COLUMNS):
        for row in range(ROWS):
            top, below = (_boundary(board, column, row, z) for z in (0.0, -board.thickness_mm))
            outside = (row == 0, column == COLUMNS - 1, row == ROWS - 1, column == 0)
            for side in (side for side, is_outside in enumerate(outside) if is_outside):
                for k in range(side * OF_A_SIDE, (side + 1) * OF_A_SIDE):
                    following = (k + 1) % len(top)
                    yield np.array([below[k], below[following], top[k]])
                    yield np.array([below[following], top[following], top[k]])
