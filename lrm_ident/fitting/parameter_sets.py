"""Sets of parameters to fit: named ones, bounds, and checks that the poses determine them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effect_of
from lrm_math.effects.reference import BASE_OFFSETS
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model

TABLE_4_5 = (
    *(f"offsets.joint{i}.alpha_rad" for i in (2, 3, 4, 5)),
    "compliance.base.k_rad_per_Nm",
    *(f"compliance.joint{i}.k_rad_per_Nm" for i in range(1, 7)),
    *(f"offsets.joint{i}.a_mm" for i in (3, 4, 5)),
    *(f"offsets.joint{i}.theta_rad" for i in range(1, 7)),
    *(f"offsets.joint{i}.d_mm" for i in (4, 5)),
    *(f"offsets.base.{axis}_mm" for axis in "xyz"),
    *(f"offsets.tool.{axis}_mm" for axis in "yz"),
    "offsets.joint2.extra_z_mm",
)
"""The 28 parameters that the thesis calls strongly independent (Conenna 2024, Table 4.5)."""

_BASE = "compliance.base.k_rad_per_Nm"
THESIS_OPTIONS: dict[str, tuple[str, ...]] = {
    "option1": TABLE_4_5,
    "option2": tuple(key for key in TABLE_4_5 if ParameterRef.parse(key).id == "offsets" and "extra_z" not in key),
    "option3": tuple(key for key in TABLE_4_5 if ParameterRef.parse(key).id == "compliance"),
    "option4": tuple(key for key in TABLE_4_5 if key != _BASE),
    "option5": tuple(key for key in TABLE_4_5 if ParameterRef.parse(key).id == "compliance" and key != _BASE),
}
"""Options of Conenna 2024, section 4.6: all, kinematic, elastic, all without k0, elastic without k0.

Option 2 is announced with 21 parameters, but Table B.1 holds δdd3 at zero in it: 20 are fitted."""


def select_parameters(model: Model, choice: str) -> tuple[str, ...]:
    """Keys of a named set: an option of the thesis, or keys and patterns (`*`, `?`) separated by commas.

    Raises `UnknownName`: a pattern that matches no parameter of the model.
    """
    patterns = THESIS_OPTIONS.get(choice) or tuple(part.strip() for part in choice.split(","))
    for pattern in patterns:
        if not any(fnmatchcase(key, pattern) for key in model.keys):
            more = f"{choice} is of an arm of six joints; identifiable is of any" if choice in THESIS_OPTIONS else ""
            raise UnknownName("parameter", pattern, (*THESIS_OPTIONS, *model.keys), more)
    return tuple(key for key in model.keys if any(fnmatchcase(key, pattern) for pattern in patterns))


def fittable(model: Model) -> tuple[str, ...]:
    """Keys of all parameters except shape parameters."""
    return tuple(key for key, p in zip(model.keys, model.parameters, strict=True) if p.fixed is None)


def default_keys(model: Model, data: Measurements) -> tuple[str, ...]:
    """Keys that `fit` fits where none are chosen: touched points that are unknown hold the base."""
    return tuple(
        key for key in fittable(model) if not (data.touched and ParameterRef.parse(key).effect == BASE_OFFSETS)
    )


def nuisance_shapes(model: Model) -> tuple[str, ...]:
    """Keys of the nuisance parameters: shapes, held at their best values, of effects of which a parameter is free."""
    begun = {effect_of(key) for key in model.free}
    return tuple(
        key
        for key, p in zip(model.keys, model.parameters, strict=True)
        if p.scan and key not in model.free and effect_of(key) in begun
    )


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bound of each fitted parameter (SI), (P,) each."""

    lower: Array
    upper: Array


def bounds_of(model: Model, keys: Sequence[str]) -> Bounds:
    """The physical bounds that the effects state, for instance compliances ≥ 0, for the parameters `keys`."""
    chosen = [model.parameter(key) for key in keys]
    return Bounds(np.array([p.lower for p in chosen]), np.array([p.upper for p in chosen]))


def no_bounds(keys: Sequence[str]) -> Bounds:
    """Infinite bounds, for instance for the thesis's unconstrained options."""
    return Bounds(np.full(len(keys), -np.inf), np.full(len(keys), np.inf))


def check_distinct_poses(model: Model, poses: Poses, kept: int, candidates: int) -> None:
    """Raises `LrmError` for fewer distinct poses than `kept`; the message recommends `candidates`."""
    angles, count = len(np.unique(np.round(poses.q, 6), axis=0)), len(poses)
    sides = [] if poses.direction is None else [poses.direction]
    distinct = len(np.unique(np.round(np.column_stack([poses.q, poses.payload, *sides]), 6), axis=0))
    if distinct >= kept and (angles > 1 or count == 1):
        return
    few = f"{count} poses, and all are equal" if angles == 1 < count else f"{distinct} distinct poses"
    raise LrmError(
        f"{few}: too few; measure at least {kept}, better {candidates}, spread over the joints' ranges "
        f"({model.arm.name} has {candidates} parameters), or fit fewer (fit --parameters)"
    )
