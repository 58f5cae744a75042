"""The columns of measurement files: other names that they may have, what their numbers can be, which go together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.pose_quantity import DATES, NumberRule, PoseQuantity
from lrm_ident.data.observations.kinds import KINDS
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM
from lrm_math.arm.plausible_arm import total_mass
from lrm_math.arrays import Array
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.plausibility import PlausibleSize, times

ANGLE, FEEDBACK, SIDE = "q{}_deg", "q{}_meas_deg", "approach{}"
"""Columns of each joint, by its number from 1."""
TIME = PlausibleSize("time since the start", "s", 0.0, 1e10, times(milliseconds=1e-3), DATES)
HOLD = PlausibleSize("time to stand before the reading", "s", 0.0, 1e5, times(milliseconds=1e-3))
TEMPERATURE = PlausibleSize("temperature", "degC", 0.0, 150.0, {"kelvin": (1.0, -273.15)})
SUPPLY = PlausibleSize("supply voltage", "V", 0.5, 500.0, times(millivolts=1e-3))
JOINT_ANGLE = PlausibleSize("angle of a joint", "deg", 0.0, 1e6)
NOT_BELOW_ZERO = NumberRule(lambda values: values < 0.0, "a negative load")
NO_NEGATIVE_TIME = NumberRule(lambda values: values < 0.0, "a negative time")
WHOLE = NumberRule(lambda values: np.nan_to_num(values) % 1.0 != 0.0, "not a whole number")
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


LEAST_LOAD, MOST_LOAD = 1e-3, 10.0
"""Loads over the mass of the arm."""
NO_MASSES = (0.5, 1e5)  # g
NO_LOAD = "write 0 where the tool carried nothing, and the load in every row where it carried one"
NO_COLUMN = "write it in every row, or delete the column"


NUMBERS = ("nr", "no", "num", "number", "index", "idx", "id", "posenumber", "poseid", "posenr", "sample")
KNOWN = (
    PoseQuantity("pose", ("pose",), NUMBERS, WHOLE, commanded=True),
    PoseQuantity("t", ("t_s",), ("t", "time", "timestamp", "stamp"), size=TIME, commanded=True),
    PoseQuantity("session", ("session",), if_empty="write the session in every row", commanded=True),
    PoseQuantity(
        "temperature", ("temp_c",), ("temp", "temperature"), size=TEMPERATURE, if_empty=NO_COLUMN, commanded=True
    ),
    PoseQuantity(
        "payload", ("payload_g",), ("payload", "load", "mass"), NOT_BELOW_ZERO, if_empty=NO_LOAD, commanded=True
    ),
    PoseQuantity("approach", ("approach",), ("direction",), SIDES, commanded=True),
    PoseQuantity("hold", ("hold_s",), (), NO_NEGATIVE_TIME, size=HOLD, commanded=True),
    PoseQuantity("gravity", DOWN, (), OF_GRAVITY, commanded=True),
    PoseQuantity("tilt", TILT, (), LEANING, commanded=True),
    PoseQuantity("repeat_of", ("repeat_of",), ("repeatof", "repeat"), WHOLE, may_be_empty=True),
    PoseQuantity("supply", ("supply_v",), ("supply", "voltage"), size=SUPPLY, may_be_empty=True),
    *(quantity for kind in KINDS for quantity in kind.quantities),
)
"""All quantities but those of single joints."""
ALIASES = {alias: quantity.columns[0] for quantity in KNOWN for alias in quantity.aliases} | {
    column: column for quantity in KNOWN for column in quantity.columns if "_" not in column
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
    quantities = (replace(each, size=_load(arm)) if each.name == "payload" else each for each in KNOWN)
    return (replace(angles, limits=limits), *others, *quantities)


def commanded_quantities(arm: Arm, how: Reading = AS_NAMED) -> tuple[PoseQuantity, ...]:
    """Quantities that a file of poses states."""
    return tuple(quantity for quantity in measured_quantities(arm, how) if quantity.commanded)


def _load(arm: Arm) -> PlausibleSize:
    """Sizes that a load has on an arm: of one much lighter than the arm nothing can be seen, so zero says it better."""
    mass = total_mass(arm) / GRAM
    low, high = (LEAST_LOAD * mass, MOST_LOAD * mass) if mass else NO_MASSES
    return PlausibleSize(f"load of {arm.name}", "g", low, high, times(kg=1e3, mg=1e-3))
