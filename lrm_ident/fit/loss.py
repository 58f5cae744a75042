"""How much a pose counts in the fit, given how far the model misses it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import UnknownName

MEDIAN_TO_SCALE = 1.0 / 1.5381724  # of a 3-D distance: the median of a chi distribution with three degrees of freedom


class Loss(Protocol):
    """A robust loss: its value and the weight it gives, both of the distance in units of its robust scale."""

    @property
    def name(self) -> str:
        """Its name on the command line."""

    def rho(self, t: Array) -> Array:
        """Loss of scaled distances t, ½ t² for small ones."""

    def weight(self, t: Array) -> Array:
        """ρ′(t)/t, between 0 and 1."""


@dataclass(frozen=True)
class Squared:
    """Least squares: every pose counts alike."""

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
        """½ t² or knee (t − ½ knee)."""
        return np.where(t <= self.knee, 0.5 * t * t, self.knee * (t - 0.5 * self.knee))

    def weight(self, t: Array) -> Array:
        """1 or knee / t."""
        return np.minimum(1.0, self.knee / np.maximum(t, 1e-300))


@dataclass(frozen=True)
class Cauchy:
    """Grows like a logarithm: far poses hardly count."""

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
    """One of the losses. Raises `UnknownName`."""
    for loss in LOSSES:
        if loss.name == name:
            return loss
    raise UnknownName("loss", name, [loss.name for loss in LOSSES])


def robust_scale(distance: Array) -> float:
    """Standard deviation per axis that a median 3-D distance speaks of; half of the poses may be wrong."""
    return float(np.median(distance) * MEDIAN_TO_SCALE)
