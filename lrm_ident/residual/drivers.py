"""What an error may follow: joint angles, torques, load, order, time, temperature."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class Driver:
    """A quantity that an error may follow: values (N,) in its `unit`; `joint` from 0 of an angle or torque."""

    kind: Literal["angle", "torque", "load", "order", "time", "temperature"]
    name: str
    unit: str
    values: Array
    joint: int | None = None

    @property
    def label(self) -> str:
        """Of an axis."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


def drivers(data: Measurements, torque: Array) -> tuple[Driver, ...]:
    """The quantities that vary. `torque`: (N, n), gravity's on every joint (N·m)."""
    return tuple(driver for driver in _all(data, torque) if np.ptp(driver.values) > 0)


def _all(data: Measurements, torque: Array) -> Iterator[Driver]:
    poses = data.poses
    for i, angle in enumerate(np.degrees(poses.q).T):
        yield Driver("angle", f"angle of joint {i + 1}", "deg", angle, i)
    for i, load in enumerate(torque.T):
        yield Driver("torque", f"torque of joint {i + 1}", "N·m", load, i)
    yield Driver("load", "load", "g", poses.payload * 1e3)
    yield Driver("order", "order of measurement", "", np.arange(1.0, len(data) + 1.0))
    if poses.t is not None:
        yield Driver("time", "time", "min", poses.t / 60.0)
    if poses.temperature is not None:
        yield Driver("temperature", "temperature", "°C", poses.temperature)
