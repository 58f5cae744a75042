"""The catalogue of effects: one class for each physical error source."""

from __future__ import annotations

from lrm_math.arm.arm import Arm
from lrm_math.effects.anchor import Anchor
from lrm_math.effects.backlash import AxialPlay, Backlash, Hysteresis
from lrm_math.effects.base import AngleDependentEffect, Effect, JointEffect, LoadedJointEffect, Parameter
from lrm_math.effects.compliance import BaseCompliance, BendingEnds, Compliance, LateralCompliance, NonlinearStiffness
from lrm_math.effects.curves import AngleCurve, CableCurve, CouplingCurve
from lrm_math.effects.drift_curve import DriftCurve
from lrm_math.effects.forces import CableSpring, Mass, Payload
from lrm_math.effects.friction import FrictionCurve
from lrm_math.effects.moment_curves import BaseCurve, BearingCurve, TorqueCurve
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.servo_droop import ServoDroop
from lrm_math.effects.servo_errors import Coupling, Eccentricity, Quantisation, ServoGain
from lrm_math.effects.session_errors import Drift, MeasurementFrame, Session
from lrm_math.errors import UnknownName

CATALOGUE: tuple[type[Effect], ...] = (
    Offsets,
    Compliance,
    BaseCompliance,
    LateralCompliance,
    NonlinearStiffness,
    Backlash,
    AxialPlay,
    Hysteresis,
    ServoGain,
    Eccentricity,
    Quantisation,
    CableSpring,
    Coupling,
    Payload,
    Mass,
    Drift,
    Session,
    MeasurementFrame,
    Anchor,
    ServoDroop,
)
FORMS: tuple[type[Effect], ...] = (
    BendingEnds,
    BearingCurve,
    TorqueCurve,
    BaseCurve,
    FrictionCurve,
    AngleCurve,
    CouplingCurve,
    CableCurve,
    DriftCurve,
)
"""Other forms of effects of the catalogue, fitted beside them, from plain to rich."""


def effects_at(arm: Arm, name: str, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> tuple[Effect, ...]:
    """The effects that `id` (at all its places) or `id@place` means on this arm.

    Raises:
        UnknownName: no such effect, or it cannot act at that place; the message lists what there is.
    """
    effect_id, _, place = name.partition("@")
    by_id = {effect.id: effect for effect in (*catalogue, *FORMS)}
    if effect_id not in by_id:
        raise UnknownName("effect", effect_id, by_id)
    places = by_id[effect_id].places(arm)
    if place and place not in places:
        raise UnknownName(f"place of effect {effect_id}", place, places)
    return tuple(by_id[effect_id](arm, at) for at in ([place] if place else places))


__all__ = [
    "CATALOGUE",
    "FORMS",
    "AngleDependentEffect",
    "Effect",
    "JointEffect",
    "LoadedJointEffect",
    "Parameter",
    "effects_at",
]
