"""Distances between line segments, and from segments to boxes, vectorised.

Lengths in m; leading shapes of all arrays broadcast.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array

PARALLEL = 1e-14
"""sin² of the angle below which two segments count as parallel; the error is then below 1e-7 lengths."""


def segment_to_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least distance between the segments a-b and c-d, each (..., 3), -> (...) (Ericson 2005, section 5.1.9).

    The nearest point on the first, clipped to it, then the nearest to that on the second, then back. A segment may have
    length zero.
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
    """Least distance between the segment a-b and a solid axis-aligned box about the origin; 0 if they intersect.

    a, b (..., 3); half (..., 3), half the edges; -> (...). The squared distance is convex along the segment, and its
    slope is piecewise linear with knots where the segment crosses a plane of the box: the minimum follows exactly from
    the last knot with a negative slope and the first with another.
    """
    ends = [(a[..., i], b[..., i] - a[..., i], half[..., i]) for i in range(3)]
    shape = np.broadcast_shapes(a.shape[:-1], half.shape[:-1])
    at = np.empty((8, *shape))
    at[6], at[7] = 0.0, 1.0
    for i, (x, d, h) in enumerate(ends):
        along = np.where(d == 0.0, 1.0, d)
        at[2 * i], at[2 * i + 1] = (-h - x) / along, (h - x) / along
    np.minimum(np.maximum(at, 0.0, out=at), 1.0, out=at)
    slope = np.asarray(sum(d * _outside(x + at * d, h) for x, d, h in ends))
    falls = slope < 0.0
    t0, t1 = np.where(falls, at, 0.0).max(axis=0), np.where(falls, 1.0, at).min(axis=0)
    g0, g1 = np.where(falls, slope, -np.inf).max(axis=0), np.where(falls, np.inf, slope).min(axis=0)
    inside = np.isfinite(g0) & np.isfinite(g1)
    share = np.divide(-g0, g1 - g0, out=np.where(np.isfinite(g1), 0.0, 1.0), where=inside)
    nearest = t0 + share * (t1 - t0)
    return np.asarray(np.sqrt(sum(_outside(x + nearest * d, h) ** 2 for x, d, h in ends)))


def depth_in_box(a: Array, b: Array, half: Array) -> Array:
    """Penetration depth of the segment a-b in an axis-aligned box about the origin; 0 if they do not intersect.

    a, b (..., 3); half (..., 3), half the edges; -> (...), m: how far some point of the segment is from the box's
    surface, at most. The depth of a point is the least over the six faces, linear along the segment in each, so the
    largest depth lies at an end or where two faces are equally far (a linear programme in one variable).
    """
    along = np.concatenate([a - b, b - a], axis=-1)
    at_start = np.concatenate([half - a, half + a], axis=-1)
    first, second = np.triu_indices(6, 1)
    slope = along[..., first] - along[..., second]
    crossing = (at_start[..., second] - at_start[..., first]) / np.where(slope == 0.0, np.inf, slope)
    ends = np.broadcast_to([0.0, 1.0], (*crossing.shape[:-1], 2))
    t = np.clip(np.concatenate([crossing, ends], axis=-1), 0.0, 1.0)[..., None]
    depth = (at_start[..., None, :] + t * along[..., None, :]).min(axis=-1).max(axis=-1)
    return np.asarray(np.maximum(depth, 0.0))


def _outside(x: Array, h: Array) -> Array:
    """x minus the nearest point of the interval [-h, h]."""
    return np.asarray(x - np.minimum(np.maximum(x, -h), h))


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))
