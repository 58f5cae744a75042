"""Distances between lines of finite length, and from them to boxes, many at once.

Lengths in m; every array may have any leading shape that broadcasts with the others'.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array

PARALLEL = 1e-14
"""sin² of the angle below which two lines count as parallel; the distance is then wrong by less than 1e-7 lengths."""


def segment_to_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least distance between the line from a to b and the line from c to d, each (..., 3), -> (...).

    The point nearest on the one, clipped to it, then the nearest to that on the other, then back (Ericson 2005, 5.1.9).
    Points (a = b) are lines of length zero.
    """
    u, v, r = b - a, d - c, a - c
    uu, vv, uv, ur, vr = dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)
    area = uu * vv - uv * uv
    s = np.clip((uv * vr - ur * vv) / np.where(area > PARALLEL * uu * vv, area, np.inf), 0.0, 1.0)
    t = np.clip((uv * s + vr) / np.where(vv > 0, vv, np.inf), 0.0, 1.0)
    s = np.clip((uv * t - ur) / np.where(uu > 0, uu, np.inf), 0.0, 1.0)
    gap = r + s[..., None] * u - t[..., None] * v
    return np.sqrt(dot(gap, gap))


def segment_to_box(a: Array, b: Array, half: Array) -> Array:
    """Least distance between the line from a to b and a solid box about the origin, along the axes; 0 if they meet.

    a, b (..., 3); half (..., 3), half the edges; -> (...). Along the line the squared distance is convex, and its
    slope never falls and is straight between the places where the line crosses a plane of the box: from the last place
    where it is below zero and the first where it is not, the place of the least distance follows exactly.
    """
    ends = [(a[..., i], b[..., i] - a[..., i], half[..., i]) for i in range(3)]
    shape = np.broadcast_shapes(a.shape[:-1], half.shape[:-1])
    at = np.empty((8, *shape))
    at[6], at[7] = 0.0, 1.0
    for i, (x, way, h) in enumerate(ends):
        along = np.where(way == 0.0, 1.0, way)
        at[2 * i], at[2 * i + 1] = (-h - x) / along, (h - x) / along
    np.minimum(np.maximum(at, 0.0, out=at), 1.0, out=at)
    slope = np.asarray(sum(way * _outside(x + at * way, h) for x, way, h in ends))
    falls = slope < 0.0
    t0, t1 = np.where(falls, at, 0.0).max(axis=0), np.where(falls, 1.0, at).min(axis=0)
    g0, g1 = np.where(falls, slope, -np.inf).max(axis=0), np.where(falls, np.inf, slope).min(axis=0)
    turns = np.isfinite(g0) & np.isfinite(g1)
    share = np.divide(-g0, g1 - g0, out=np.where(np.isfinite(g1), 0.0, 1.0), where=turns)
    nearest = t0 + share * (t1 - t0)
    return np.asarray(np.sqrt(sum(_outside(x + nearest * way, h) ** 2 for x, way, h in ends)))


def _outside(x: Array, h: Array) -> Array:
    """From the nearest point of the span from -h to h to x."""
    return np.asarray(x - np.minimum(np.maximum(x, -h), h))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))
