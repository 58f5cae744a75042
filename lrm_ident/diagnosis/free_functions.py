"""Free functions of what the arm does, at one joint: what the residual would be if nobody had to name its cause.

A turn of joint j that is any smooth function of one or two quantities (joint angles, the joint's own torque, order).
They serve two ends: a named effect must not be far worse than a free function at its own place, and structure without a
name still gets an anatomy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array

SINGLE_DEGREE, PRODUCT_DEGREE, SIZE = 6, 5, 0.02  # of Legendre polynomials; typical size in rad


@dataclass(frozen=True, eq=False)
class Quantity:
    """Something that an error may follow: `name`, its values (N,) scaled to −1 … 1, how many levels it has."""

    name: str
    values: Array
    levels: int

    def waves(self, degree: int) -> Array:
        """(N, ≤ degree), Legendre polynomials 1 … degree, no more than its levels can tell."""
        top = min(degree, self.levels - 1)
        return np.asarray(np.polynomial.legendre.legvander(self.values, max(top, 0))[:, 1:], dtype=np.float64)


def quantities(data: Measurements, torque: Array) -> tuple[list[Quantity], list[Quantity]]:
    """Quantities that any joint may follow (angles, order, load), and each joint's own torque (N, n in N·m)."""
    n = data.poses.q.shape[1]
    shared = [_quantity(f"q{i + 1}", data.poses.q[:, i]) for i in range(n)]
    shared.append(_quantity("order", np.arange(len(data), dtype=np.float64)))
    own = [_quantity(f"tau{i + 1}", torque[:, i]) for i in range(n)]
    return [quantity for quantity in shared if quantity.levels > 1], own


def _quantity(name: str, values: Array) -> Quantity:
    span = np.ptp(values)
    scaled = np.zeros_like(values) if span == 0 else 2.0 * (values - values.min()) / span - 1.0
    return Quantity(name, scaled, len(np.unique(np.round(scaled, 3))))


@dataclass(frozen=True)
class FreeFunction:
    """A turn of joint `joint` (number from 0) that follows `follows`, one or two names; `columns`: (3 N, m), in m."""

    joint: int
    follows: tuple[str, ...]
    columns: Array

    @property
    def has_a_name(self) -> bool:
        """Whether effects of the catalogue can be such a function: of the joint's own angle or torque, or of order."""
        return self.follows in ((f"q{self.joint + 1}",), (f"tau{self.joint + 1}",), ("order",))

    @property
    def name(self) -> str:
        """For people."""
        return f"a free function of {' and '.join(self.follows)} at joint {self.joint + 1}"


def single_functions(turns: Array, shared: list[Quantity], own: list[Quantity]) -> Iterator[FreeFunction]:
    """Every joint, every quantity. `turns`: (n, 3, N), TCP's motion for a unit turn of each joint (m/rad)."""
    for joint in range(len(turns)):
        for quantity in (*shared, own[joint]):
            yield FreeFunction(joint, (quantity.name,), _columns(turns[joint], quantity.waves(SINGLE_DEGREE)))


def product_functions(turns: Array, shared: list[Quantity], own: list[Quantity]) -> Iterator[FreeFunction]:
    """Every joint, every pair of quantities: products of their waves only, without what either does alone.

    Degrees of the two waves of a product sum up to one more than `PRODUCT_DEGREE` at most.
    """
    for joint in range(len(turns)):
        for a, b in combinations((*shared, own[joint]), 2):
            left, right = a.waves(PRODUCT_DEGREE), b.waves(PRODUCT_DEGREE)
            degrees = product(range(left.shape[1]), range(right.shape[1]))
            waves = [left[:, i] * right[:, j] for i, j in degrees if i + j < PRODUCT_DEGREE]
            if waves:
                yield FreeFunction(joint, (a.name, b.name), _columns(turns[joint], np.stack(waves, axis=1)))


def _columns(turn: Array, waves: Array) -> Array:
    moved = turn.T[:, :, None] * waves[:, None, :] * SIZE
    return moved.reshape(-1, waves.shape[1])
