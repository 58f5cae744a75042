"""Elementwise functions of a float, by `math`, which is faster for one number, or of an array, by numpy."""

from __future__ import annotations

import math

import numpy as np

from lrm_math.kinematics.chain import Number


def sin(x: Number) -> Number:
    """Sine of an angle (rad)."""
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def cos(x: Number) -> Number:
    """Cosine of an angle (rad)."""
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def exp(x: Number) -> Number:
    """Exponential."""
    return math.exp(x) if isinstance(x, float) else np.exp(x)


def tanh(x: Number) -> Number:
    """Hyperbolic tangent."""
    return math.tanh(x) if isinstance(x, float) else np.tanh(x)


def magnitude(x: Number) -> Number:
    """Magnitude."""
    return abs(x) if isinstance(x, float) else np.abs(x)


def positive_part(x: Number) -> Number:
    """max(x, 0)."""
    return max(x, 0.0) if isinstance(x, float) else np.maximum(x, 0.0)


def negative_part(x: Number) -> Number:
    """min(x, 0)."""
    return min(x, 0.0) if isinstance(x, float) else np.minimum(x, 0.0)


def select_by_sign(x: Number, above: float, below: float) -> Number:
    """One value where x is positive, another one elsewhere."""
    return (above if x > 0.0 else below) if isinstance(x, float) else np.where(x > 0.0, above, below)


def maximum(x: Number) -> float:
    """The largest of all poses; zero where there are none."""
    return x if isinstance(x, float) else float(x.max(initial=0.0))
