"""Elementwise functions of a float, by `math`, which is faster for one number, or of an array, by numpy."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from lrm_math.kinematics.chain import Number

Elementwise: TypeAlias = Callable[[Number], Number]


def _elementwise(of_float: Callable[[float], float], of_array: Callable[[Any], Any]) -> Elementwise:
    def function(x: Number) -> Number:
        return of_float(x) if isinstance(x, float) else of_array(x)

    return function


sin, cos = _elementwise(math.sin, np.sin), _elementwise(math.cos, np.cos)
"""Of an angle (rad)."""
exp, tanh = _elementwise(math.exp, np.exp), _elementwise(math.tanh, np.tanh)
magnitude = _elementwise(abs, np.abs)
positive_part = _elementwise(lambda x: max(x, 0.0), lambda x: np.maximum(x, 0.0))
negative_part = _elementwise(lambda x: min(x, 0.0), lambda x: np.minimum(x, 0.0))


def maximum(x: Number) -> float:
    """The largest of all poses; zero where there are none."""
    return x if isinstance(x, float) else float(x.max(initial=0.0))


def ends_of(x: Number) -> tuple[float, float]:
    """The smallest and the largest of all poses; an empty interval where there are none."""
    return (x, x) if isinstance(x, float) else (float(x.min(initial=math.inf)), float(x.max(initial=-math.inf)))
