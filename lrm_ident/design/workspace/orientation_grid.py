"""Uniform orientation grid: directions on a geodesic sphere, each with equally spaced roll angles of the tool."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

GOLDEN = 0.5 * (1.0 + math.sqrt(5.0))
NEAR_X = 0.9  # cosine to the x axis beyond which roll is measured from the z axis instead
EXAMPLES = (12, 42, 92, 162, 252)


def directions(count: int) -> Array:
    """(count, 3), unit vectors: vertices of a geodesic icosahedron with faces divided into f² triangles, 10 f² + 2.

    The set is symmetric about the coordinate planes, so that the map of a symmetric arm is symmetric.

    Raises `LrmError`: a count that is not 12, 42, 92, 162, …
    """
    f = math.isqrt(max(count - 2, 0) // 10)
    if f < 1 or count != 10 * f * f + 2:
        raise LrmError(f"{count} directions cannot be spread evenly; take one of {', '.join(map(str, EXAMPLES))}, …")
    signs = [(a, b * GOLDEN) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    corners = np.array([np.roll((0.0, a, b), turn) for turn in range(3) for a, b in signs])
    pairs = combinations(range(12), 2)
    edges = {(i, j) for i, j in pairs if math.isclose(math.dist(corners[i], corners[j]), 2.0)}
    faces = [corners[list(face)] for face in combinations(range(12), 3) if edges.issuperset(combinations(face, 2))]
    weights = [(i, j, f - i - j) for i in range(f + 1) for j in range(f + 1 - i)]
    points = np.array([(i * a + j * b + k * c) / f for a, b, c in faces for i, j, k in weights])
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    _, first = np.unique(np.round(unit, 9) + 0.0, axis=0, return_index=True)
    return np.asarray(unit[first])


def rotations(along: Array, rolls: int) -> Array:
    """(D, rolls, 3, 3), tool frames with z axes along the unit vectors (D, 3) and equally spaced rolls about z.

    Raises `LrmError`: `rolls` below one.
    """
    if rolls < 1:
        raise LrmError(f"{rolls} turns of the tool about its axis; there must be at least 1")
    start = np.where(np.abs(along[:, :1]) < NEAR_X, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    x = start - along * (start * along).sum(axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(along, x)
    angle = np.arange(rolls)[:, None] * (2.0 * np.pi / rolls)
    turned_x = np.cos(angle) * x[:, None] + np.sin(angle) * y[:, None]
    turned_y = np.cos(angle) * y[:, None] - np.sin(angle) * x[:, None]
    z = np.broadcast_to(along[:, None], turned_x.shape)
    return np.stack([turned_x, turned_y, z], axis=-1)
