"""Elementwise functions of a float (by `math`, faster for one number) or an array (by numpy); linear combinations."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from lrm_math.kinematics.chain import Number, is_zero

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


FEW_TERMS = 2


def linear_combination(p: Sequence[Number], basis: Sequence[tuple[Number, ...]], targets: int) -> tuple[Number, ...]:
    """Σ p_i f_i for each of so many targets, a float or (N,) each, in the unit of p_i f_i.

    Args:
        p: the coefficients. basis: the functions f_i of each at each target, zero or (N,) over N poses, say.
    """
    acting = [(value, functions) for value, functions in zip(p, basis, strict=True) if not is_zero(value)]
    return tuple(
        _sum_of_products([(value, f[k]) for value, f in acting if f[k].__class__ is not float or f[k] != 0.0])
        for k in range(targets)
    )


def _sum_of_products(terms: Sequence[tuple[Number, Number]]) -> Number:
    """Σ p_i f_i; of many arrays by numbers as one product."""
    if len(terms) > FEW_TERMS and all(isinstance(p, float) and isinstance(f, np.ndarray) for p, f in terms):
        total: Number = np.array([p for p, _ in terms]) @ np.array([f for _, f in terms])
        return total
    return reduce(operator.add, [p * f for p, f in terms]) if terms else 0.0
