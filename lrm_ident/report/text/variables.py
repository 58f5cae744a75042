"""Names of the variables that an error may depend on, and of the free functions of them."""

from __future__ import annotations

from collections.abc import Mapping

from lrm_ident.residual.covariates import ExplanatoryVariable
from lrm_ident.residual.free_functions import CommonMode, FreeFunction
from lrm_math.arm.place_names import place_words

WORDS: Mapping[str, tuple[str, str, str]] = {
    "angle": ("angle of joint {}", "the angle of joint {}", "deg"),
    "motion": ("last motion of joint {}", "the last motion of the angle of joint {}", "deg"),
    "torque": ("torque of joint {}", "the torque of joint {}", "N·m"),
    "moment": ("moment", "moment", "N·m"),
    "thrust": ("force along the axis of joint {}", "thrust", "N"),
    "direction": ("direction", "direction of approach of joint {}", ""),
    **{axis: (f"{axis} of the tip", f"{axis} of the tip", "mm") for axis in "xyz"},
    "load": ("load", "the load", "g"),
    "order": ("order of measurement", "the order of measurement", ""),
    "time": ("time", "the time", "min"),
    "temperature": ("temperature", "temperature", "°C"),
    "total torque": ("sum of the joints' torques", "total torque", "N·m"),
    "force": ("force", "the force across its axis", ""),
    "region": ("region of the workspace", "region", ""),
}
"""Of each kind: its name, what a sentence calls it, its unit; {} is the number of its joint."""
MODES = {
    CommonMode.GAIN: "the gain of all joints",
    CommonMode.YIELDING: "the yielding of all joints",
    CommonMode.SCALE: "the scale of all lengths",
}


ANGLES = {"alpha": "x", "beta": "y", "gamma": "z"}
"""The axis that an angle of base or tool turns about."""


def variable_name(variable: ExplanatoryVariable) -> str:
    """Name, for instance `angle of joint 2`, `moment on link 2 about its x`, `moment on the base about x`."""
    name, _, _ = WORDS[variable.kind]
    if variable.kind != "moment":
        return _with_joint(name, variable)
    place, _, axis = variable.slot.partition(".")
    turned = f"the {place} about {ANGLES[axis]}" if axis in ANGLES else f"{place_words(place)} about its {axis}"
    return f"moment on {turned}"


def axis_label(variable: ExplanatoryVariable) -> str:
    """Name and unit, for an axis."""
    return ", ".join(filter(None, (variable_name(variable), WORDS[variable.kind][2])))


def in_a_sentence(variable: ExplanatoryVariable) -> str:
    """Name in a sentence, for instance `the angle of joint 2`; `before`: at the poses measured before."""
    _, words, _ = WORDS[variable.kind]
    return f"{_with_joint(words, variable)}{' before' if variable.before else ''}"


def _with_joint(words: str, variable: ExplanatoryVariable) -> str:
    return words.format("" if variable.joint is None else variable.joint + 1)


def place_of(function: FreeFunction) -> str:
    """What a free function moves: a joint, or what all joints share."""
    return MODES[function.common] if function.common is not None else f"joint {(function.joint or 0) + 1}"


ONGOING = frozenset({"order", "time"})


def what_may_change(function: FreeFunction) -> str:
    """A question on what may have changed meanwhile, where all joints yield otherwise as time goes on; else empty."""
    if function.common is not CommonMode.YIELDING or ONGOING.isdisjoint(
        covariate.kind for covariate in function.covariates
    ):
        return ""
    return "Was a load changed meanwhile (payload_g), or did the supply sag (supply_v)?"


def function_name(function: FreeFunction) -> str:
    """Description, for instance `a free function of the angle of joint 1 at joint 3`."""
    followed = " and ".join(map(in_a_sentence, function.covariates))
    return f"a free function of {followed} {'at' if function.common is None else 'in'} {place_of(function)}"
