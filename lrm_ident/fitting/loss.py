"""Robust losses (M-estimators): the weight of a pose as a function of its residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lrm_ident.data.error_stats import CHI1_MEDIAN, CHI3_MEDIAN
from lrm_math.arrays import Array
from lrm_math.errors import UnknownName


class Loss(Protocol):
    """M-estimator: loss ρ and weight as functions of the distance in units of the robust scale."""

    @property
    def name(self) -> str:
        """Name on the command line."""

    def rho(self, t: Array) -> Array:
        """Loss of scaled distances t (N,); ½ t² for small ones."""

    def weight(self, t: Array) -> Array:
        """ρ′(t)/t, between 0 and 1."""


@dataclass(frozen=True)
class Squared:
    """Least squares: equal weights."""

    name: str = "squared"

    def rho(self, t: Array) -> Array:
        """½ t²."""
        return 0.5 * t * t

    def weight(self, t: Array) -> Array:
        """1."""
        return np.ones_like(t)


@dataclass(frozen=True)
class Huber:
    """Quadratic up to `knee` scales, linear beyond (Huber 1964)."""

    knee: float = 2.5
    name: str = "huber"

    def rho(self, t: Array) -> Array:
        """½ t² up to the knee, then knee (t − ½ knee)."""
        return np.where(t <= self.knee, 0.5 * t * t, self.knee * (t - 0.5 * self.knee))

    def weight(self, t: Array) -> Array:
        """1 up to the knee, then knee / t."""
        return np.minimum(1.0, self.knee / np.maximum(t, 1e-300))


@dataclass(frozen=True)
class Cauchy:
    """Logarithmic growth, redescending weight (Holland & Welsch 1977)."""

    knee: float = 3.5
    name: str = "cauchy"

    def rho(self, t: Array) -> Array:
        """½ knee² ln(1 + (t/knee)²)."""
        return np.asarray(0.5 * self.knee**2 * np.log1p((t / self.knee) ** 2))

    def weight(self, t: Array) -> Array:
        """1 / (1 + (t/knee)²)."""
        return 1.0 / (1.0 + (t / self.knee) ** 2)


SQUARED: Loss = Squared()
LOSSES: tuple[Loss, ...] = (SQUARED, Huber(), Cauchy())


def loss_named(name: str) -> Loss:
    """The loss of that name. Raises `UnknownName`."""
    by_name = {loss.name: loss for loss in LOSSES}
    if name not in by_name:
        raise UnknownName("loss", name, list(by_name))
    return by_name[name]


def robust_scale(distance: Array, measured: Array | float = 3.0) -> float:
    """Standard deviation per axis from the median of distances (N,); breakdown point 50 %.

    `measured`: (N,), how many numbers each is of, one where only the length of a string was read.
    """
    return float(np.median(distance * (1.0 / np.where(np.asarray(measured) == 1.0, CHI1_MEDIAN, CHI3_MEDIAN))))
