"""A model of motion: the effects of every joint and their values, and its file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arm.arm_file import arm_of
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.effects import EffectRef
from lrm_math.errors import FileError, UnknownName
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.effects import MOTION_EFFECTS, GravitySag, InertialCoupling, LinkInertia
from lrm_math.toml_file import StrictSchema, read_toml

SCHEMA: Final = "lrm/motion/2"
VERSION_1 = "lrm/motion/1"
"""Of files in which each of `INERTIAL` counted a part of its own."""
INERTIAL = (GravitySag, InertialCoupling, LinkInertia)
"""Effects that count the inertia of the links."""
MOST_EFFECTS = 1000
MotionCatalogue = tuple[type[MotionEffect], ...]


@dataclass(frozen=True, eq=False)
class MotionModel:
    """Effects of motion of an arm's joints.

    Attributes:
        effects: in the order in which they act on a joint. values, sigma: by key (SI); standard errors.
    """

    arm: Arm
    effects: tuple[MotionEffect, ...]
    values: Mapping[str, float]
    sigma: Mapping[str, float] = field(default_factory=dict)

    @staticmethod
    def nominal(arm: Arm, catalogue: MotionCatalogue = MOTION_EFFECTS) -> MotionModel:
        """Every joint with a servo of usual response and nothing else."""
        basic = [kind(arm, place) for place in arm.joint_names for kind in catalogue if kind.basic]
        values = {
            key: 0.0 if "rad" in parameter.unit else parameter.typical
            for effect in basic
            for key, parameter in zip(effect.keys, effect.parameters, strict=True)
        }
        return MotionModel(arm, tuple(basic), values)

    def of_joint(self, joint: int) -> tuple[MotionEffect, ...]:
        """The effects of a joint from 0."""
        return tuple(effect for effect in self.effects if effect.joint == joint)

    def drawn(self, rng: np.random.Generator) -> MotionModel:
        """A model as far from this one as its standard errors leave open: normal, each by itself, within bounds."""
        values = dict(self.values)
        for effect in self.effects:
            for key, p in zip(effect.keys, effect.parameters, strict=True):
                values[key] = float(np.clip(rng.normal(values[key], self.sigma.get(key, 0.0)), p.lower, p.upper))
        return replace(self, values=values)

    @property
    def added(self) -> tuple[MotionEffect, ...]:
        """Effects beyond those that every joint has."""
        return tuple(effect for effect in self.effects if not effect.basic)

    def with_joint(
        self, effects: Iterable[MotionEffect], values: Mapping[str, float], sigma: Mapping[str, float]
    ) -> MotionModel:
        """The model with other effects and values of the joint that `effects` are of."""
        new = tuple(effects)
        joint = new[0].joint
        gone = {key for effect in self.of_joint(joint) for key in effect.keys}
        kept = tuple(effect for effect in self.effects if effect.joint != joint)
        merged = sorted((*kept, *new), key=lambda effect: effect.joint)
        return replace(
            self,
            effects=tuple(merged),
            values={**{k: v for k, v in self.values.items() if k not in gone}, **values},
            sigma={**{k: v for k, v in self.sigma.items() if k not in gone}, **sigma},
        )


class MotionStep(StrictSchema):
    """One step of a model's history: what was done, and the held-out error after it, RMS of encoders or of a tip."""

    step: str
    held_out_deg: float | None = None
    held_out_mm: float | None = None


class MotionFile(StrictSchema):
    """Schema of a motion model's file; parameters by key, in the keys' units. `arm_sha256`: of the arm of the fit.

    `servos`: how they were set while they were recorded; None: not known.
    """

    schema_: Literal["lrm/motion/2", "lrm/motion/1"] = Field(alias="schema")
    arm: str
    arm_sha256: str | None = None
    recording: str = ""
    servos: ServoSettings | None = None
    effects: Annotated[list[str], Field(max_length=MOST_EFFECTS)]
    parameters: dict[str, float]
    sigma: dict[str, float] = {}
    history: list[MotionStep] = []


def effect_of(arm: Arm, name: str, catalogue: MotionCatalogue = MOTION_EFFECTS) -> MotionEffect:
    """The effect `id@joint`. Raises `UnknownName`."""
    kind, place = EffectRef.parse(name)
    by_id = {kind.id: kind for kind in catalogue}
    if kind not in by_id:
        raise UnknownName("effect of motion", kind, list(by_id))
    if place not in arm.joint_names:
        raise UnknownName(f"place of {kind}", place or "", arm.joint_names)
    return by_id[kind](arm, place)


def load_motion(path: Path) -> tuple[MotionFile, MotionModel]:
    """A motion model's file, as it stands and as a model; its arm is looked up as that of a model file (`arm_of`).

    Raises `FileError`.
    """
    file = read_toml(path, MotionFile)
    return file, motion_of(path, file, arm_of(path, file.arm))


def motion_of(path: Path, file: MotionFile, arm: Arm) -> MotionModel:
    """The model of a parsed file, of an arm. Raises `FileError`: no model, or one of another arm."""
    if file.arm_sha256 not in (None, arm_sha256(arm)):
        words = f"{arm.name} is not as it was when the model was fitted: {WHAT_COUNTS} differ"
        raise FileError(path, "arm", words, "fit it again: lrm-ident motion fit")
    effects = _effects_of(path, file, arm)
    if file.schema_ == VERSION_1:
        _check_inertia_is_counted_once(path, effects)
    parameters = {key: p for effect in effects for key, p in zip(effect.keys, effect.parameters, strict=True)}
    for table, numbers in (("parameters", file.parameters), ("sigma", file.sigma)):
        for key in numbers:
            if key not in parameters:
                raise FileError(path, table, f"unknown parameter {key}", f"one of {', '.join(parameters)}")
    missing = [key for key, parameter in parameters.items() if key not in file.parameters and parameter.fixed is None]
    if missing:
        raise FileError(path, "parameters", f"no value of {missing[0]}", "every effect states all of its parameters")
    for key, value in file.parameters.items():
        if not parameters[key].lower <= value * parameters[key].si <= parameters[key].upper:
            bounds = f"{parameters[key].lower / parameters[key].si:g} to {parameters[key].upper / parameters[key].si:g}"
            raise FileError(path, "parameters", f"{key} = {value:g}", bounds)
    for key, value in file.sigma.items():
        if value < 0.0:
            raise FileError(path, "sigma", f"{key} = {value:g}", "a standard error is not below zero")
    values = {key: file.parameters.get(key, p.default / p.si) * p.si for key, p in parameters.items()}
    sigma = {key: value * parameters[key].si for key, value in file.sigma.items()}
    return MotionModel(arm, effects, values, sigma)


def _check_inertia_is_counted_once(path: Path, effects: tuple[MotionEffect, ...]) -> None:
    """Raises `FileError`: two effects of a joint of an older file, which now count the same inertia."""
    for joint in {effect.joint for effect in effects}:
        both = [effect.name for effect in effects if effect.joint == joint and isinstance(effect, INERTIAL)]
        if len(both) > 1:
            what = f"{' and '.join(both)}, fitted by an older version, now count the links' inertia twice"
            raise FileError(path, "effects", what, "fit it again: lrm-ident motion fit, then motion auto")


def _effects_of(path: Path, file: MotionFile, arm: Arm) -> tuple[MotionEffect, ...]:
    """Each once, and those that every joint has among them. Raises `FileError`."""
    if twice := [name for name, count in Counter(file.effects).items() if count > 1]:
        raise FileError(path, "effects", f"{twice[0]} is named twice")
    try:
        effects = tuple(effect_of(arm, name) for name in file.effects)
    except UnknownName as error:
        raise FileError(path, "effects", str(error)) from None
    for effect in MotionModel.nominal(arm).effects:
        if effect.name not in file.effects:
            raise FileError(path, "effects", f"{effect.name} is missing", "every joint has one")
    return effects
