"""Names of the variables that an error may depend on, and of the free functions of them."""

from __future__ import annotations

from collections.abc import Mapping

from lrm_ident.residual.covariates import ExplanatoryVariable
from lrm_ident.residual.free_functions import CommonMode, FreeFunction
from lrm_math.arm.place_names import place_words

NAMES: Mapping[str, str] = {
    "angle": "angle of joint {}",
    "motion": "last motion of joint {}",
    "torque": "torque of joint {}",
    "thrust": "force along the axis of joint {}",
    "order": "order of measurement",
    "total torque": "sum of the joints' torques",
    "region": "region of the workspace",
    **{axis: f"{axis} of the tip" for axis in "xyz"},
}
IN_SENTENCES: Mapping[str, str] = {
    "angle": "the angle of joint {}",
    "motion": "the last motion of the angle of joint {}",
    "torque": "the torque of joint {}",
    "direction": "direction of approach of joint {}",
    "order": "the order of measurement",
    "time": "the time",
    "load": "the load",
    "force": "the force across its axis",
    **{axis: f"{axis} of the tip" for axis in "xyz"},
}
UNITS: Mapping[str, str] = {
    "angle": "deg",
    "motion": "deg",
    "torque": "N·m",
    "moment": "N·m",
    "thrust": "N",
    **dict.fromkeys("xyz", "mm"),
    "load": "g",
    "time": "min",
    "temperature": "°C",
    "total torque": "N·m",
}
MODES = {
    CommonMode.GAIN: "the gain of all joints",
    CommonMode.YIELDING: "the yielding of all joints",
    CommonMode.SCALE: "the scale of all lengths",
}


ANGLES = {"alpha": "x", "beta": "y", "gamma": "z"}
"""The axis that an angle of base or tool turns about."""


def variable_name(one: ExplanatoryVariable) -> str:
    """Name, for instance `angle of joint 2`, `moment on link 2 about its x`, `moment on the base about x`."""
    if one.kind != "moment":
        return _of(NAMES, one)
    place, _, axis = one.slot.partition(".")
    turned = f"the {place} about {ANGLES[axis]}" if axis in ANGLES else f"{place_words(place)} about its {axis}"
    return f"moment on {turned}"


def axis_label(one: ExplanatoryVariable) -> str:
    """Name and unit, for an axis."""
    return ", ".join(filter(None, (variable_name(one), UNITS.get(one.kind))))


def in_a_sentence(one: ExplanatoryVariable) -> str:
    """Name in a sentence, for instance `the angle of joint 2`; `before`: at the poses measured before."""
    return f"{_of(IN_SENTENCES, one)}{' before' if one.before else ''}"


def _of(names: Mapping[str, str], one: ExplanatoryVariable) -> str:
    return names.get(one.kind, one.kind).format("" if one.joint is None else one.joint + 1)


def place_of(function: FreeFunction) -> str:
    """What a free function moves: a joint, or what all joints share."""
    return MODES[function.common] if function.common is not None else f"joint {(function.joint or 0) + 1}"


ONGOING = frozenset({"order", "time"})


def what_may_change(function: FreeFunction) -> str:
    """A question on what may have changed meanwhile, where all joints yield otherwise as time goes on; else empty."""
    if function.common is not CommonMode.YIELDING or ONGOING.isdisjoint(one.kind for one in function.covariates):
        return ""
    return "Was a load changed meanwhile (payload_g), or did the supply sag (supply_v)?"


def function_name(function: FreeFunction) -> str:
    """Description, for instance `a free function of the angle of joint 1 at joint 3`."""
    followed = " and ".join(map(in_a_sentence, function.covariates))
    return f"a free function of {followed} {'at' if function.common is None else 'in'} {place_of(function)}"
