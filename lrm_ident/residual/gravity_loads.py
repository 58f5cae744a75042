"""What effects of base, links, tool and tracker follow: loads of gravity, and the usual ones; the tip's position."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.residual.covariates import CONSTANT, Covariate, Kind, covariates
from lrm_math.arm.place_names import joint_number
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.kinematics.chain import Slot
from lrm_math.model.equilibrium import Equilibrium

AXES: tuple[Kind, ...] = ("x", "y", "z")
LOCAL: tuple[Kind, ...] = ("moment", "thrust", *AXES)
"""Kinds of covariates that only effects which follow them are drawn against."""
ENDS = "near_", "far_"
"""In the name of a slot at the end of a link, whose moment is nearly that in the middle."""
POWERS = {"rad_per_Nm": 1, "rad_per_Nm2": 2, "rad_per_Nm3": 3}
"""Unit of what a load makes a turn of, and the power of the load."""


def known_covariates(data: Measurements, rest: Equilibrium) -> tuple[Covariate, ...]:
    """All that an error or an effect may follow. `rest`: of the model at the poses of the data."""
    return *covariates(data, rest.joint_torque), *local_covariates(rest)


def local_covariates(rest: Equilibrium) -> tuple[Covariate, ...]:
    """What only some effects follow: moments on base, links, tool; forces along joints; the tip's position."""
    slots = [(k, slot) for k, slot in enumerate(rest.model.chain.slots) if _bent(slot) or _thrust(slot)]
    loads = rest.loads_on([k for k, _ in slots]).T
    tip = (Covariate(axis, values) for axis, values in zip(AXES, rest.tcp.T, strict=True))
    every = (*(_load(slot, load) for (_, slot), load in zip(slots, loads, strict=True)), *tip)
    return tuple(covariate for covariate in every if np.ptp(covariate.values) > CONSTANT)


def _bent(slot: Slot) -> bool:
    """Whether it is a turn of base, tool, or the middle of a link."""
    return slot.rotates and not slot.place.startswith("joint") and not slot.name.startswith(ENDS)


def _thrust(slot: Slot) -> bool:
    """Whether it is a shift along a joint's axis."""
    return slot.place.startswith("joint") and slot.name == "d"


def _load(slot: Slot, values: Array) -> Covariate:
    if _thrust(slot):
        return Covariate("thrust", values, joint_number(slot.place), slot.key)
    return Covariate("moment", values, slot=slot.key)


def loaded_slots(effect: Effect) -> tuple[str, ...]:
    """Keys of the slots whose loads an effect follows; of a link's ends, that of its middle."""
    return tuple(dict.fromkeys(key.replace(".near_", ".").replace(".far_", ".") for key in effect.load_slots))


def usual_turns(effect: Effect, rest: Equilibrium) -> dict[str, float]:
    """Turn (rad) that the RMS load over the poses makes of a compliance of 1, by the names of an effect's compliances.

    Of a quadratic or cubic compliance it is the square or cube of that load.
    """
    index = rest.model.chain.index
    powers = {p.name: POWERS[p.unit] for p in effect.parameters if p.unit in POWERS}
    slots = [index[key] for key in loaded_slots(effect) or (f"{effect.place}.theta",) if key in index]
    # one compliance is of all slots together; several are one of each, of both ends of a link, or all of one joint
    groups = [sorted(slots)] if len(powers) == 1 else [[slot] for slot in slots] * len(powers)
    loads = [float(np.sqrt(np.mean((rest.loads_on(group) ** 2).sum(axis=1)))) for group in groups if group]
    turns = zip(powers.items(), loads, strict=False)
    return {name: load**power for (name, power), load in turns if load > CONSTANT}
