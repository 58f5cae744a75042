"""The catalogue of effects: one class for each physical error source. To add one: its file, and two lines here."""

from __future__ import annotations

import re
from collections.abc import Sequence

from lrm_math.arm.arm import Arm
from lrm_math.effects.backlash import AxialPlay, Backlash, Hysteresis
from lrm_math.effects.base import (
    AngleDependentEffect,
    Description,
    Effect,
    Extrapolation,
    JointEffect,
    LinearEffect,
    LoadedJointEffect,
    ModelPart,
    Parameter,
    separately,
)
from lrm_math.effects.compliance import (
    BaseCompliance,
    BendingEnds,
    Compliance,
    LateralCompliance,
    NonlinearStiffness,
    ServoDroop,
    ToolCompliance,
)
from lrm_math.effects.curves import AngleCurve, CableCurve, CouplingCurve
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.effects.forces import CableSpring, Gravity, Mass, Payload
from lrm_math.effects.memory.creep import Creep, CreepSpectrum
from lrm_math.effects.memory.friction import FrictionCurve
from lrm_math.effects.memory.self_heating import SelfHeating
from lrm_math.effects.memory.settling_error import SettlingError
from lrm_math.effects.memory.slip import Slip
from lrm_math.effects.moment_curves import BaseCurve, BearingCurve, TorqueCurve
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.reference import EffectRef, ParameterRef, effect_of
from lrm_math.effects.servo_errors import (
    CommonGain,
    Coupling,
    Eccentricity,
    Quantisation,
    ServoGain,
    TransmissionRipple,
)
from lrm_math.effects.session_errors import ChangePoint, Drift, DriftCurve, SecondChangePoint, Session
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.effects.tracker_errors import Anchor, DepthScale, FrameCurve, MeasurementFrame, TouchedBoard, TouchedPoint
from lrm_math.errors import UnknownName

ALL_EFFECTS: tuple[type[Effect], ...] = (
    Offsets,
    Compliance,
    BaseCompliance,
    LateralCompliance,
    ToolCompliance,
    NonlinearStiffness,
    Backlash,
    AxialPlay,
    Hysteresis,
    ServoGain,
    CommonGain,
    Eccentricity,
    Quantisation,
    CableSpring,
    Coupling,
    Payload,
    Mass,
    Gravity,
    Drift,
    Session,
    ChangePoint,
    DepthScale,
    MeasurementFrame,
    Anchor,
    TouchedPoint,
    TouchedBoard,
    ServoDroop,
    Creep,
    SelfHeating,
    Slip,
    SettlingError,
    TransmissionRipple,
    # other forms, from plain to rich
    BendingEnds,
    BearingCurve,
    TorqueCurve,
    BaseCurve,
    FrictionCurve,
    CreepSpectrum,
    AngleCurve,
    CouplingCurve,
    CableCurve,
    DriftCurve,
    SecondChangePoint,
    FrameCurve,
    # no causes
    ResidualField,
)


class _NamedCatalogue(tuple[type[Effect], ...]):
    """A catalogue that signatures show by its name: there are more than twenty classes in it."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "CATALOGUE"


PLACES_TOUCHED = tuple(kind for kind in ALL_EFFECTS if "placement" in kind.depends_on)
"""Where touched points stood: no causes of an error, but unknowns of a measurement that touches them."""
CATALOGUE = _NamedCatalogue(
    kind for kind in ALL_EFFECTS if kind.names_a_cause and not kind.variant_of and kind not in PLACES_TOUCHED
)
FREE_FORMS = tuple(kind for kind in ALL_EFFECTS if kind.variant_of)
"""Other forms of effects of the catalogue, fitted beside them."""
FIELDS = tuple(kind for kind in ALL_EFFECTS if not kind.names_a_cause)
"""What predicts and names no cause: fitted last, and never a candidate of a diagnosis."""
NOT_A_CAUSE = "not a cause"
OWN_EFFECT = "an effect of your own comes with its file: --effects-file FILE.py, in Python catalogue_with"
NOT_OF_THE_ROVER = frozenset({"time", "session", "instrument"})


def effect_names(effects: Sequence[Effect]) -> list[str]:
    """Effects as named in a model file: `id` if present at all its places, else `id@place`."""
    names: list[str] = []
    for effect in effects:
        everywhere = {e.place for e in effects if e.id == effect.id} == set(type(effect).places(effect.arm))
        name = effect.id if everywhere else effect.name
        if name not in names:
            names.append(name)
    return names


def effects_at(arm: Arm, name: str, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> tuple[Effect, ...]:
    """The effects that `id` (at all its places) or `id@place` means on this arm.

    Raises:
        UnknownName: no such effect, or it cannot act at that place; the message lists what there is.
    """
    effect_id, place = EffectRef.parse(name)
    by_id = {effect.id: effect for effect in (*catalogue, *FREE_FORMS, *FIELDS, *PLACES_TOUCHED)}
    if effect_id not in by_id:
        raise UnknownName("effect", effect_id, by_id, OWN_EFFECT)
    places = by_id[effect_id].places(arm)
    if place and place not in places:
        other_places = [
            f"{place} is {at}" for at, joint in zip(arm.link_places, arm.links, strict=True) if joint.name == place
        ]
        raise UnknownName(f"place of effect {effect_id}", place, places, "".join(other_places))
    return tuple(by_id[effect_id](arm, at) for at in ([place] if place else places))


def marked(name: str, words: str = "") -> str:
    """A name (`id` or `id@place`), or words for it, as people are shown it: what names no cause says so."""
    return (
        f"{words or name} ({NOT_A_CAUSE})"
        if EffectRef.parse(name).id in {kind.id for kind in FIELDS}
        else words or name
    )


def variants(effect: Effect) -> tuple[str, ...]:
    """Names of the effects of which this is another form."""
    if not effect.variant_of:
        return ()
    joints = re.findall(r"joint\d+", effect.place)
    return tuple(
        str(EffectRef(each.id, each.place.format(*joints) or effect.place))
        for each in map(EffectRef.parse, effect.variant_of)
    )


def compensable(effect: Effect | type[Effect]) -> bool:
    """Whether it is an error of the rover, which depends on angles, load and direction only."""
    return NOT_OF_THE_ROVER.isdisjoint(effect.depends_on)


def constant(effect: Effect) -> bool:
    """Whether it moves slots by the same amounts whatever the pose, load and direction."""
    return not effect.depends_on and not effect.load_slots and kind_of(effect) is Kind.MOTION


__all__ = [
    "ALL_EFFECTS",
    "CATALOGUE",
    "FIELDS",
    "FREE_FORMS",
    "NOT_A_CAUSE",
    "AngleDependentEffect",
    "Description",
    "Effect",
    "EffectRef",
    "Extrapolation",
    "JointEffect",
    "LinearEffect",
    "LoadedJointEffect",
    "ModelPart",
    "Parameter",
    "ParameterRef",
    "compensable",
    "constant",
    "effect_names",
    "effect_of",
    "effects_at",
    "marked",
    "separately",
    "variants",
]
