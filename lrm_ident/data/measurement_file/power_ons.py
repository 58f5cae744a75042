"""When the servos got power, as the metadata of a measurement say: joints warm up since then."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from lrm_math.arrays import Array
from lrm_math.toml_file import StrictSchema


class PowerOnTime(StrictSchema):
    """`t_s` at which the servos got power for a `session`; `temp_c`: temperature of the hottest then, if known."""

    session: Annotated[int, Field(ge=1)]
    t_s: float
    temp_c: float | None = None


def running(power: Sequence[PowerOnTime], t: Array, session: Array) -> Array:
    """(N,), time since the power-on of the session (s); since its first pose where the power-on is not known."""
    power_times, began = {power_on.session: power_on.t_s for power_on in power}, np.empty(len(t))
    for number in np.unique(session).tolist():
        rows = session == number
        began[rows] = power_times.get(number, t[rows].min())
    return np.asarray(t - began)


def powered(power: Sequence[PowerOnTime], t: Array) -> Array | None:
    """(N,), time since the first power-on (s); None where it is not known."""
    first = next((power_on for power_on in power if power_on.session == 1), None)
    return None if first is None else t - first.t_s


def warmed(power: Sequence[PowerOnTime], temperature: Array | None) -> Array | None:
    """(N,), temperature less that at the first power-on (K); None where either is not known."""
    first = next((power_on.temp_c for power_on in power if power_on.session == 1), None)
    return None if temperature is None or first is None else temperature - first
