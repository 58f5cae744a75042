"""The columns of measurement files: other names that they may have, what their numbers can be, which go together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arm.plausible_arm import total_mass
from lrm_math.arrays import Array
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.plausibility import PlausibleSize, times

DEG = float(np.radians(1.0))
SI = {"mm": MM, "deg": DEG, "g": GRAM, "mm2": MM**2, "deg2": DEG**2, "mmdeg": MM * DEG}
"""SI units in the units at the end of columns' names; numbers in others stay as they are."""
ANGLE, FEEDBACK, SIDE = "q{}_deg", "q{}_meas_deg", "approach{}"
"""Columns of each joint, by its number from 1."""
AXES, TURNS = "xyz", "uvw"
"""Coordinates of a pose's error: along x, y, z (mm), and the rotation vector about them (deg)."""
POSITION = ("x_mm", "y_mm", "z_mm")
QUATERNION = ("qw", "qx", "qy", "qz")
DISTANCE = "distance_mm"
POINT, PLACEMENT = "point", "placement"
"""Columns of names, not of numbers: the touched point, and where what carries it stands."""
POSITION_COVARIANCE = tuple(f"c{a}{b}_mm2" for a, b in combinations_with_replacement(AXES, 2))
CROSS_COVARIANCE = tuple(f"c{a}{u}_mmdeg" for a in AXES for u in TURNS)
TURN_COVARIANCE = tuple(f"c{u}{w}_deg2" for u, w in combinations_with_replacement(TURNS, 2))
DATES = "seconds since the start, or dates as 2024-07-15T10:15:00"
TIME = PlausibleSize("time since the start", "s", 0.0, 1e10, times(milliseconds=1e-3), DATES)
HOLD = PlausibleSize("time to stand before the reading", "s", 0.0, 1e5, times(milliseconds=1e-3))
TEMPERATURE = PlausibleSize("temperature", "degC", 0.0, 150.0, {"kelvin": (1.0, -273.15)})
SUPPLY = PlausibleSize("supply voltage", "V", 0.5, 500.0, times(millivolts=1e-3))
COORDINATE = PlausibleSize("a coordinate of a position", "mm", 0.0, 1e7)
JOINT_ANGLE = PlausibleSize("angle of a joint", "deg", 0.0, 1e6)
SD = PlausibleSize("standard deviation of a position", "mm", 0.0, 100.0, times(micrometres=1e-3))
TURN_SD = PlausibleSize("standard deviation of an angle", "deg", 0.0, 45.0)
LEAST_LOAD, MOST_LOAD = 1e-3, 10.0
"""Loads over the mass of the arm."""
NO_MASSES = (0.5, 1e5)  # g


@dataclass(frozen=True)
class NumberRule:
    """A rule for numbers (N, k): which of them, or of their rows (N, 1), are `wrong`, `what` then, what is `right`."""

    wrong: Callable[[Array], NDArray[np.bool_]]
    what: str
    right: str = ""


ABOVE_ZERO = NumberRule(lambda values: values <= 0.0, "not above zero")
NOT_BELOW_ZERO = NumberRule(lambda values: values < 0.0, "a negative load")
NO_NEGATIVE_TIME = NumberRule(lambda values: values < 0.0, "a negative time")
WHOLE = NumberRule(lambda values: np.nan_to_num(values) % 1.0 != 0.0, "not a whole number")
UNIT_LENGTH = NumberRule(
    lambda values: np.abs(np.linalg.norm(values, axis=1, keepdims=True) - 1.0) > 0.01,
    "the quaternion's length is not one",
)
DOWN, TILT = ("gx", "gy", "gz"), ("roll_deg", "pitch_deg")
"""Direction of gravity in the frame of the positions; attitude of that frame: a turn about x, then about level y."""
OF_GRAVITY = NumberRule(
    lambda values: ~_as_gravity(np.linalg.norm(values, axis=1, keepdims=True)),
    "the length of gx, gy, gz is not that of gravity",
    "a direction (length 1), or 9.3 to 10.3 m/s2",
)
LEANING = NumberRule(lambda values: np.abs(values) > 90.0, "beyond 90 deg", "roll and pitch of the base, in deg")
SIDES = NumberRule(lambda values: ~np.isin(values, (-1.0, 0.0, 1.0)), "not a side", "1, -1, or 0 if unknown")


def _as_gravity(length: Array) -> NDArray[np.bool_]:
    """Whether lengths are those of a direction, or of gravity on Earth with the error of a cheap accelerometer."""
    return np.asarray((np.abs(length - 1.0) <= 0.02) | ((length >= 9.3) & (length <= 10.3)))


@dataclass(frozen=True)
class PoseQuantity:
    """A quantity of a pose as measurement files state it.

    Attributes:
        columns: all stated or none; a unit, if there is one, ends their names.
        aliases: other names of its only column, without unit and signs.
        rule, size: of the numbers.
        may_be_empty: whether cells may be. whole: whether a row then states all of them or none.
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
    required: bool = False
    unless: tuple[str, ...] = ()
    commanded: bool = False
    signs: tuple[int, ...] = (1,)
    limits: tuple[tuple[float, float], ...] = ()

    @property
    def si(self) -> float:
        """SI units in one unit of the columns."""
        return SI.get(self.columns[0].rpartition("_")[2], 1.0)


NUMBERS = ("nr", "no", "num", "number", "index", "idx", "id", "posenumber", "poseid", "posenr", "sample")
LENGTHS = ("distance", "dist", "wire", "string", "ballbar")
KNOWN = (
    PoseQuantity("pose", ("pose",), NUMBERS, WHOLE, commanded=True),
    PoseQuantity("t", ("t_s",), ("t", "time", "timestamp"), size=TIME, commanded=True),
    PoseQuantity("session", ("session",), commanded=True),
    PoseQuantity("temperature", ("temp_c",), ("temp", "temperature"), size=TEMPERATURE, commanded=True),
    PoseQuantity("payload", ("payload_g",), ("payload", "load", "mass"), NOT_BELOW_ZERO, commanded=True),
    PoseQuantity("approach", ("approach",), ("direction",), SIDES, commanded=True),
    PoseQuantity("hold", ("hold_s",), (), NO_NEGATIVE_TIME, size=HOLD, commanded=True),
    PoseQuantity("gravity", DOWN, (), OF_GRAVITY, commanded=True),
    PoseQuantity("tilt", TILT, (), LEANING, commanded=True),
    PoseQuantity("repeat_of", ("repeat_of",), ("repeatof", "repeat"), WHOLE, may_be_empty=True),
    PoseQuantity("supply", ("supply_v",), ("supply", "voltage"), size=SUPPLY),
    PoseQuantity("position", POSITION, size=COORDINATE, whole=True, required=True, unless=(DISTANCE, POINT)),
    PoseQuantity("sd", ("sd_mm",), ("sd", "std", "sigma"), ABOVE_ZERO, SD),
    PoseQuantity("sd_per_axis", ("sx_mm", "sy_mm", "sz_mm"), (), ABOVE_ZERO, SD),
    PoseQuantity("position_covariance", POSITION_COVARIANCE),
    PoseQuantity("cross_covariance", CROSS_COVARIANCE),
    PoseQuantity("turn_covariance", TURN_COVARIANCE),
    PoseQuantity("turn_sd", ("srot_deg",), (), ABOVE_ZERO, TURN_SD),
    PoseQuantity("quaternion", QUATERNION, (), UNIT_LENGTH, may_be_empty=True, whole=True),
    PoseQuantity("distance", (DISTANCE,), LENGTHS, ABOVE_ZERO, may_be_empty=True),
    PoseQuantity("distance_sd", ("distance_sd_mm",), ("distancesd",), ABOVE_ZERO, SD),
)
"""All quantities but those of single joints."""
ALIASES = {alias: known.columns[0] for known in KNOWN for alias in known.aliases} | {
    column: column for known in KNOWN for column in known.columns if "_" not in column
}
"""Columns by the other names that they may have, and by their own where that has no unit."""


def quantities_of_joints(dof: int, how: Reading = AS_NAMED) -> tuple[PoseQuantity, PoseQuantity, PoseQuantity]:
    """The angles of so many joints, the readings of their encoders, and the sides from which they came.

    In the order and with the signs of the arm's joints, as `how` says them.
    """
    angles, feedback, sides = (
        tuple(form.format(theirs) for theirs in how.joint_order or range(1, dof + 1))
        for form in (ANGLE, FEEDBACK, SIDE)
    )
    signs = tuple(how.joint_sign or (1,))
    return (
        PoseQuantity("angles", angles, size=JOINT_ANGLE, required=True, commanded=True, signs=signs),
        PoseQuantity("feedback", feedback, size=JOINT_ANGLE, may_be_empty=True, signs=signs),
        PoseQuantity("sides", sides, (), SIDES, commanded=True, signs=signs),
    )


def measured_quantities(arm: Arm, how: Reading = AS_NAMED) -> tuple[PoseQuantity, ...]:
    """Quantities that a measurement file of an arm states, read as `how` says."""
    angles, *others = quantities_of_joints(arm.dof, how)
    limits = tuple((joint.lower, joint.upper) for joint in arm.joints)
    known = (replace(each, size=_load(arm)) if each.name == "payload" else each for each in KNOWN)
    return (replace(angles, limits=limits), *others, *known)


def commanded_quantities(arm: Arm, how: Reading = AS_NAMED) -> tuple[PoseQuantity, ...]:
    """Quantities that a file of poses states."""
    return tuple(quantity for quantity in measured_quantities(arm, how) if quantity.commanded)


def _load(arm: Arm) -> PlausibleSize:
    """Sizes that a load has on an arm: of one much lighter than the arm nothing can be seen, so zero says it better."""
    mass = total_mass(arm) / GRAM
    low, high = (LEAST_LOAD * mass, MOST_LOAD * mass) if mass else NO_MASSES
    return PlausibleSize(f"load of {arm.name}", "g", low, high, times(kg=1e3, mg=1e-3))
