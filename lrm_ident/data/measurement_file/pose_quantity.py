"""A quantity of a pose as measurement files state it: its columns, their units, and what their numbers can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array
from lrm_math.plausibility import PlausibleSize, times

DEG = float(np.radians(1.0))
SI = {"mm": MM, "deg": DEG, "g": GRAM, "mm2": MM**2, "deg2": DEG**2, "mmdeg": MM * DEG}
"""SI units in the units at the end of columns' names; numbers in others stay as they are."""
POSITION = ("x_mm", "y_mm", "z_mm")
QUATERNION = ("qw", "qx", "qy", "qz")
DISTANCE = "distance_mm"
POINT, PLACEMENT = "point", "placement"
"""Columns of names, not of numbers: the touched point, and where what carries it stands."""
DATES = "seconds since the start, or dates as 2024-07-15T10:15:00"
SD = PlausibleSize("standard deviation of a position", "mm", 0.0, 100.0, times(micrometres=1e-3))
TURN_SD = PlausibleSize("standard deviation of an angle", "deg", 0.0, 45.0)
StatedQuantity = tuple[str, ArrayLike | None, int]
"""Name of a known quantity; its values (N,), of joints or several columns (N, k), SI, None if unknown; decimals."""


@dataclass(frozen=True)
class NumberRule:
    """A rule for numbers (N, k): which of them, or of their rows (N, 1), are `wrong`, `what` then, what is `right`."""

    wrong: Callable[[Array], NDArray[np.bool_]]
    what: str
    right: str = ""


ABOVE_ZERO = NumberRule(lambda values: values <= 0.0, "not above zero")


@dataclass(frozen=True)
class PoseQuantity:
    """A quantity of a pose as measurement files state it.

    Attributes:
        columns: all stated or none; a unit, if there is one, ends their names.
        aliases: other names of its only column, without unit and signs.
        rule, size: of the numbers.
        may_be_empty: whether cells may be. whole: whether a row then states all of them or none.
        if_empty: what to write instead of nothing, where cells may not be empty.
        required: whether a file must state it. unless: columns beside which it may be missing, or its cells empty.
        commanded: whether it says what was commanded; files of poses have these alone.
        signs: of each column. limits: between which the numbers of each column are (SI).
    """

    name: str
    columns: tuple[str, ...]
    aliases: tuple[str, ...] = ()
    rule: NumberRule | None = None
    size: PlausibleSize | None = None
    may_be_empty: bool = False
    whole: bool = False
    if_empty: str = ""
    required: bool = False
    unless: tuple[str, ...] = ()
    commanded: bool = False
    signs: tuple[int, ...] = (1,)
    limits: tuple[tuple[float, float], ...] = ()

    @property
    def si(self) -> float:
        """SI units in one unit of the columns."""
        return SI.get(self.columns[0].rpartition("_")[2], 1.0)
