"""Covariates of an error: joint angles, last motions, torques, load, order, time, temperature."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array

Kind = Literal[
    "angle",
    "motion",
    "torque",
    "moment",
    "thrust",
    "load",
    "order",
    "time",
    "temperature",
    "total torque",
    "direction",
    "x",
    "y",
    "z",
    "force",
    "region",
]
"""What a variable is: among them the direction of approach, an axis of the tip, the weight across a joint's axis, the
moment on a base, link or tool, the force along a joint's axis."""
SYMBOLS: Mapping[str, str] = {
    "angle": "q{}",
    "motion": "the last motion of q{}",
    "torque": "tau{}",
    "direction": "direction of approach of joint {}",
    **{axis: f"position {axis}" for axis in "xyz"},
    "force": "the force across its axis",
}
"""Names in JSON of the kinds whose own name it is not, with the joint's number."""
REDUNDANT = 0.999  # correlation above which a quantity is redundant beside another
CONSTANT = 1e-9  # SI: a quantity that varies less is round-off


@dataclass(frozen=True)
class ExplanatoryVariable:
    """What an error may depend on; `joint`: from 0, of an angle, a motion, a torque; `before`: at the poses before.

    `slot`: key of the slot on which a moment or a thrust acts, `base.alpha`.
    """

    kind: Kind
    joint: int | None = None
    before: bool = False
    slot: str = ""

    @property
    def symbol(self) -> str:
        """Name in JSON, for instance `q2`, `tau2 before`, `load`."""
        name = SYMBOLS.get(self.kind, self.kind).format("" if self.joint is None else self.joint + 1)
        return f"{name}{' before' if self.before else ''}"


@dataclass(frozen=True, eq=False)
class Covariate:
    """A quantity of the poses that an error may depend on.

    Attributes:
        values: (N,), SI (rad, N·m, N, kg, m, s, °C), the order from 0. joint: from 0, of an angle, motion or torque.
        slot: key of the slot that a torque, moment or thrust loads.
    """

    kind: Kind
    values: Array
    joint: int | None = None
    slot: str = ""

    @property
    def variable(self) -> ExplanatoryVariable:
        """Its kind, and its joint or else its slot, without the values."""
        return ExplanatoryVariable(self.kind, self.joint, slot="" if self.joint is not None else self.slot)

    @cached_property
    def shown(self) -> Array:
        """(N,), values in deg, N·m, g, mm, min, °C; the order from 1."""
        if self.kind in ("angle", "motion"):
            return np.degrees(self.values)
        if self.kind == "time":
            return self.values / 60.0
        return self.values * 1e3 if self.kind in ("load", *"xyz") else self.values + (self.kind == "order")

    def take(self, rows: NDArray[np.int64]) -> Covariate:
        """The covariate at some poses."""
        return replace(self, values=self.values[rows])

    def legendre_basis(self, degree: int) -> Array:
        """(N, ≤ degree), Legendre polynomials of degrees 1 to `degree`, but fewer than there are levels."""
        values = scaled(self.values)
        top = min(degree, len(levels(values, 3)[0]) - 1)
        return np.asarray(np.polynomial.legendre.legvander(values, max(top, 0))[:, 1:], dtype=np.float64)


def covariates(data: Measurements, torque: Array) -> tuple[Covariate, ...]:
    """Covariates that vary over the poses. `torque`: (N, n), of gravity on the joints (N·m); (N, 0): unknown."""
    return tuple(covariate for covariate in _all(data, torque) if np.ptp(covariate.values) > 0)


def _all(data: Measurements, torque: Array) -> Iterator[Covariate]:
    poses = data.poses
    yield from (Covariate("angle", values, joint) for joint, values in enumerate(poses.q.T))
    if poses.direction is not None:  # the order is known
        moved = np.diff(poses.q, axis=0, prepend=poses.q[:1])
        yield from (Covariate("motion", values, joint) for joint, values in enumerate(moved.T))
    yield from (Covariate("torque", values, joint, f"joint{joint + 1}.theta") for joint, values in enumerate(torque.T))
    yield Covariate("load", poses.payload)
    yield Covariate("order", np.arange(len(data), dtype=np.float64))
    if poses.t is not None:
        yield Covariate("time", poses.t)
    if poses.temperature is not None:
        yield Covariate("temperature", poses.temperature)


def distinct(values: Mapping[ExplanatoryVariable, Array]) -> dict[ExplanatoryVariable, Array]:
    """Standardised values (N,) of variables, without constant ones and those that repeat an earlier one."""
    out: dict[ExplanatoryVariable, Array] = {}
    for variable, values_of_variable in values.items():
        if np.ptp(values_of_variable) > CONSTANT:
            x = (values_of_variable - values_of_variable.mean()) / values_of_variable.std()
            if all(abs(x @ other) < REDUNDANT * len(x) for other in out.values()):
                out[variable] = x
    return out


def scaled(values: Array) -> Array:
    """(N, …), each column scaled to −1 … 1; zero where it does not vary."""
    least, span = values.min(axis=0), np.ptp(values, axis=0)
    return np.where(span < CONSTANT, 0.0, 2.0 * (values - least) / np.where(span < CONSTANT, 1.0, span) - 1.0)


def levels(values: Array, decimals: int) -> tuple[Array, NDArray[np.int64]]:
    """Distinct values among (N,), rounded to so many decimals, ascending; and (N,), number of each value's level."""
    unique, number = np.unique(np.round(values, decimals), return_inverse=True)
    return unique, number.reshape(-1)
