"""Linear combinations of amounts, each a float, an array over poses or a dual number: many arrays as one product."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import reduce

import numpy as np

from lrm_math.kinematics.chain import Number, is_zero

FEW_TERMS = 2


def linear_combination(p: Sequence[Number], basis: Sequence[tuple[Number, ...]], targets: int) -> tuple[Number, ...]:
    """Σ p_i f_i for each of so many targets, a float or (N,) each, in the unit of p_i f_i.

    Args:
        p: the coefficients. basis: the functions f_i of each at each target, zero or (N,) over N poses, say.
    """
    terms: list[list[tuple[Number, Number]]] = [[] for _ in range(targets)]
    for value, functions in zip(p, basis, strict=True):
        if not is_zero(value):
            for own, function in zip(terms, functions, strict=True):
                if not is_zero(function):
                    own.append((value, function))
    return tuple(map(_sum_of_products, terms))


def _sum_of_products(terms: Sequence[tuple[Number, Number]]) -> Number:
    """Σ p_i f_i; of many arrays by numbers as one product."""
    if len(terms) > FEW_TERMS and all(isinstance(p, float) and isinstance(f, np.ndarray) for p, f in terms):
        found: Number = np.array([p for p, _ in terms]) @ np.array([f for _, f in terms])
        return found
    return reduce(operator.add, [p * f for p, f in terms]) if terms else 0.0
