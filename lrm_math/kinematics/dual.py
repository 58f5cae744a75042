"""Dual numbers: values that carry their derivatives, for numpy's elementwise functions (Wengert 1964).

A function written for floats and arrays, evaluated on duals, gives its derivative exactly. What is not in `RULES`
raises `TypeError`; nothing turns a dual into a plain number, so no derivative is lost silently.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Rule = Callable[..., Any]

RULES: Mapping[np.ufunc, Sequence[Rule]] = {
    np.add: (lambda *_: 1.0, lambda *_: 1.0),
    np.subtract: (lambda *_: 1.0, lambda *_: -1.0),
    np.multiply: (lambda _, y: y, lambda x, _: x),
    np.true_divide: (lambda _, y: 1.0 / y, lambda x, y: -x / (y * y)),
    np.power: (lambda x, y: y * x ** (y - 1.0), lambda x, y: np.log(x) * x**y),
    np.negative: (lambda *_: -1.0,),
    np.positive: (lambda *_: 1.0,),
    np.absolute: (lambda x: np.where(x < 0.0, -1.0, 1.0),),
    np.square: (lambda x: 2.0 * x,),
    np.sqrt: (lambda x: 0.5 / np.sqrt(x),),
    np.exp: (np.exp,),
    np.expm1: (np.exp,),
    np.log: (lambda x: 1.0 / x,),
    np.log1p: (lambda x: 1.0 / (1.0 + x),),
    np.sin: (np.cos,),
    np.cos: (lambda x: -np.sin(x),),
    np.tan: (lambda x: 1.0 / np.cos(x) ** 2,),
    np.arctan: (lambda x: 1.0 / (1.0 + x * x),),
    np.arctan2: (lambda y, x: x / (x * x + y * y), lambda y, x: -y / (x * x + y * y)),
    np.sinh: (np.cosh,),
    np.cosh: (np.sinh,),
    np.tanh: (lambda x: 1.0 - np.tanh(x) ** 2,),
    np.hypot: (lambda x, y: x / np.hypot(x, y), lambda x, y: y / np.hypot(x, y)),
    np.maximum: (lambda x, y: np.where(x > y, 1.0, 0.0), lambda x, y: np.where(x > y, 0.0, 1.0)),
    np.minimum: (lambda x, y: np.where(x < y, 1.0, 0.0), lambda x, y: np.where(x < y, 0.0, 1.0)),
    np.sign: (lambda *_: 0.0,),
    np.floor: (lambda *_: 0.0,),
    np.rint: (lambda *_: 0.0,),
}
"""∂f/∂argument of each elementwise function."""
COMPARISONS = {np.greater, np.greater_equal, np.less, np.less_equal, np.equal, np.not_equal, np.isfinite, np.isnan}


class Dual(NDArrayOperatorsMixin):
    """`value`, a float or array, and `slope`, (D, …): its derivatives by D quantities."""

    def __init__(self, value: Any, slope: NDArray[np.float64]) -> None:
        self.value, self.slope = value, slope

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return np.shape(self.value)

    @property
    def ndim(self) -> int:
        """Number of the value's axes."""
        return np.ndim(self.value)

    def min(self, initial: float) -> float:
        """The smallest of the values, at most `initial`."""
        return float(np.min(self.value, initial=initial))

    def max(self, initial: float) -> float:
        """The largest of the values, at least `initial`."""
        return float(np.max(self.value, initial=initial))

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Dual:
        inner = index if isinstance(index, tuple) else (index,)
        return Dual(self.value[index], self.slope[(slice(None), *inner)])

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise TypeError("a dual number is no plain number")

    def __array_ufunc__(self, function: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            return NotImplemented
        values = [x.value if isinstance(x, Dual) else x for x in inputs]
        if function in COMPARISONS:
            return function(*values)
        if function not in RULES:
            return NotImplemented
        slopes = [r(*values) * x.slope for r, x in zip(RULES[function], inputs, strict=True) if isinstance(x, Dual)]
        return Dual(function(*values), reduce(operator.add, slopes))

    def __array_function__(self, function: Any, _: Any, args: Sequence[Any], options: Mapping[str, Any]) -> Any:
        if function is not np.where or options or isinstance(args[0], Dual) or len(args) != 3:
            return NotImplemented
        chosen, sides = args[0], [x if isinstance(x, Dual) else Dual(x, np.zeros((1, 1))) for x in args[1:]]
        return Dual(np.where(chosen, *(x.value for x in sides)), np.where(chosen, *(x.slope for x in sides)))
