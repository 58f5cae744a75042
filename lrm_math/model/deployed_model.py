"""Parts of a model: what a rover uses, and what names a cause."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from lrm_math.arm.servo_table import PwmClock
from lrm_math.arrays import Vector3
from lrm_math.effects import Effect, EffectRef, ModelPart, ParameterRef, effect_of, effects_at
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.effects.forces import Gravity
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.servo_errors import Quantisation
from lrm_math.effects.session_errors import Drift, warms_with_the_arm
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.lasting_parts import lasting_parts
from lrm_math.model.model import Model
from lrm_math.model.session_state import SessionMemory, StateAfterSession

COMPENSATED = {"angle", "direction"}


class OnRover(Enum):
    """Treatment of an effect by who drives the arm."""

    COMPENSATED = "compensated"
    """At every pose."""
    ROUNDED = "rounded"
    """Commands are rounded so, and what that leaves is stated."""
    WARMING = "warming"
    """Compensated where the time since power-on is known; else its state goes along."""
    REMEMBERED = "remembered"
    """Compensated where it is known what the arm did before; else its state goes along."""
    CARRIED = "carried"
    """Left out, and its state goes along."""
    LEFT_OUT = "left out"
    """As an error of the measurement."""


CORRECTED = {OnRover.COMPENSATED, OnRover.WARMING, OnRover.REMEMBERED}
"""Those that leave no error, where what they follow is known."""


def on_rover(effect: Effect) -> OnRover:
    """Treatment of an effect by who drives the arm, at its place."""
    if COMPENSATED.issuperset(effect.depends_on):
        return OnRover.COMPENSATED
    if isinstance(effect, Quantisation):
        return OnRover.ROUNDED
    if isinstance(effect, EffectWithMemory):
        return OnRover.REMEMBERED
    if warms_with_the_arm(effect):
        return OnRover.WARMING
    return OnRover.CARRIED if goes_along(effect) else OnRover.LEFT_OUT


def of_a_session(effect: Effect) -> bool:
    """Whether it explains one measurement session: drift, power cycles, the tracker's frame."""
    return not {"time", "session"}.isdisjoint(effect.depends_on)


def goes_along(effect: Effect) -> bool:
    """Whether no rover can compensate it and it moves the arm or its base, so that its state goes along.

    Not one of the measurement: the arm that it saw was not at rest.
    """
    return of_a_session(effect) and kind_of(effect) is Kind.MOTION and effect.part is not ModelPart.MEASUREMENT


def as_deployed(model: Model) -> Model:
    """The model that a rover uses: without what no rover can know, whose last state (`Model.state`) is in the offsets.

    It follows neither how poses are numbered nor when they were measured; the model itself if nothing is left out.
    """
    lasting = _part(model, [effect for effect in model.effects if not of_a_session(effect)])
    if lasting is model or model.state is None:
        return lasting
    return with_offsets(replace(lasting, state=None), model.state.offsets)


def as_deployed_at(model: Model, poses: Poses) -> Model:
    """The model that a rover uses at poses: `as_deployed`, with the laws that follow the time since power-on
    (`StateAfterSession.warming`), and those that follow what the arm did before (`memory`), where that is known."""
    names = followed_effects(model, poses)
    return as_deployed_with(model, names) if names else as_deployed(model)


def as_deployed_with(model: Model, names: Collection[str]) -> Model:
    """`as_deployed`, but some effects, by name, are themselves there instead of the state that stands for them."""
    if model.state is None or not names:
        return as_deployed(model)
    kept = _part(model, [effect for effect in model.effects if effect.name in names or not of_a_session(effect)])
    return with_offsets(with_offsets(replace(kept, state=None), model.state.offsets), _taken_out(model.state, names))


def as_deployed_when_read(model: Model, poses: Poses | None = None) -> Model:
    """The model as deployed, at the moment of each reading of its own measurement: joints that had not come to rest are
    still on their way. Readings are compared with it. `poses`: those that `as_deployed_at` follows; None: none."""
    followed = () if poses is None else followed_effects(model, poses)
    return as_deployed_with(model, [*followed, *on_the_way(model)])


def on_the_way(model: Model) -> list[str]:
    """Names of effects by which a measurement saw the arm elsewhere than where it comes to rest."""
    seen = (effect for effect in model.effects if effect.part is ModelPart.MEASUREMENT)
    return [effect.name for effect in seen if of_a_session(effect) and kind_of(effect) is Kind.MOTION]


def since_power_on(poses: Poses) -> bool:
    """Whether the times of poses are taken as since the arm's power-on: in one session."""
    return poses.t is not None and (poses.power_cycle is None or not poses.power_cycle.any())


def followed_parts(model: Model, poses: Poses) -> dict[str, float]:
    """Differences of constant offsets, springs and gains (SI) from `as_deployed` at one pose, by their keys.

    Of what follows the time since power-on, and of what follows what the arm did before (its history has the loads that
    it bore, see `with_borne_loads`). Empty where nothing of the model does, or that is not known.
    """
    names = followed_effects(model, poses)
    if model.state is None or not names:
        return {}
    counts = Counter(_taken_out(model.state, names))
    for bound in model.binding.bound:
        if bound.effect.name in names:
            counts.update(lasting_parts(model, bound, poses, "last"))
    return dict(counts)


def memorised(model: Model) -> Mapping[str, SessionMemory]:
    """Memories, by effect's name, that a deployed model follows where it is known what the arm did before."""
    return {} if model.state is None else model.state.memory


def followed_effects(model: Model, poses: Poses) -> list[str]:
    """Names of effects that are followed at poses: what they follow is known, and what it warmed by if that counts."""
    if model.state is None:
        return []
    warming, history = model.state.warming, poses.history
    by_heat = [key for effect in model.effects if effect.name in warming for key in effect.keys if "_per_K" in key]
    warmed = poses.warmed is not None or not any(map(model.value, by_heat))
    remembered = model.state.memory if history is not None and history.visits.timed else {}
    timed = [effect.name for effect in warming_at(model, poses) if warmed and effect.name in warming]
    return [*timed, *remembered]


def warming_at(model: Model, poses: Poses) -> list[Effect]:
    """Drifts of joints whose time since power-on is known at poses: in one session, or of those that begin anew with
    each."""
    drifts = [effect for effect in model.effects if isinstance(effect, Drift) and warms_with_the_arm(effect)]
    anew = [effect for effect in drifts if poses.running is not None and model.value(effect.reset_key) >= 0.5]
    return [*(drifts if since_power_on(poses) else anew)]


def _taken_out(state: StateAfterSession, names: Collection[str]) -> dict[str, float]:
    """What of a state's offsets stands for some effects, with the other sign."""
    out = Counter({_angle_key(name): -part for name, part in state.warming.items() if name in names})
    for name, memory in state.memory.items():
        if name in names:
            out.subtract(memory.parts)
    return dict(out)


def _angle_key(name: str) -> str:
    """Key of the constant offset of the angle of the joint that an effect `id@place` warms."""
    return str(ParameterRef(Offsets.id, EffectRef.parse(name).place, "theta_rad"))


FIT_STATE = "fit it again with this version: lrm-ident fit DATA --start MODEL"


def unknown_state(model: Model) -> str:
    """Words for effects of a session whose state is not known, as of a file of an older version; empty without any."""
    names = [effect.name for effect in model.effects if of_a_session(effect)]
    if not names or model.state is not None:
        return ""
    return f"{', '.join(names)} explain a session, and the model does not say which state of it goes along"


def with_offsets(model: Model, added: Mapping[str, float]) -> Model:
    """The model with amounts (SI) added to parameters of linear effects, by their keys: constant offsets (rad, m), and
    springs; places that have none get them."""
    names = dict.fromkeys(effect_of(key) for key in added if key not in model.structure.positions)
    missing = [effect for name in names for effect in effects_at(model.arm, name)]
    if missing:
        zeros = np.zeros(sum(len(effect.parameters) for effect in missing))
        values = np.concatenate([model.values, zeros])
        model = replace(model, effects=(*model.effects, *missing), values=values)
    return model.with_values_of([*added], [model.value(key) + amount for key, amount in added.items()])


def deployed_part(model: Model, left_out: Sequence[str] = ()) -> Model:
    """The model `as_deployed`, without rounding, which inverse kinematics do apart, and without effects `left_out`.

    Raises `LrmError`: an effect that only explains a measurement session (drift, session, measurement_frame) is neither
    compensable nor named in `left_out`; or a name there that the model does not have.
    """
    names = {effect.id for effect in model.effects}
    for name in left_out:
        if name not in names:
            raise LrmError(f"left out: '{name}' is no effect of this model; it has {', '.join(sorted(names))}")
    for effect in model.effects:
        if of_a_session(effect) and effect.id not in left_out:
            raise LrmError(
                f"effect {effect.name} explains a measurement session and cannot be compensated on the "
                f"rover; name it as left out (left_out = ['{effect.id}']) to deploy the others"
            )
    deployed = as_deployed(model)
    return _part(deployed, [e for e in deployed.effects if set(e.depends_on) <= COMPENSATED and e.id not in left_out])


def named_part(model: Model) -> Model:
    """The model without a residual field: that is no cause, and is fitted anew after whatever changes the causes."""
    return _part(model, [effect for effect in model.effects if effect.names_a_cause])


def under_gravity(model: Model, down: Vector3) -> Model:
    """The model where gravity's direction is known, as from an accelerometer: a unit vector in the arm's frame.

    The lean that it was measured with no longer counts.
    """
    x, y, z = (math.hypot(*model.arm.gravity) * component for component in down)
    part = _part(model, [effect for effect in model.effects if not isinstance(effect, Gravity)])
    return replace(part, arm=replace(model.arm, gravity=(x, y, z)))


def with_load_at(model: Model, centre: Vector3) -> Model:
    """The model where the load's centre is known, see `Arm.with_load_at`. Raises `LrmError`."""
    return replace(model, arm=model.arm.with_load_at(centre))


def field_of(model: Model) -> ResidualField | None:
    """The residual field of a model; None without one."""
    return next((effect for effect in model.effects if isinstance(effect, ResidualField)), None)


def _part(model: Model, effects: Collection[Effect]) -> Model:
    if len(effects) == len(model.effects):
        return model
    spans = [span for effect, span in zip(model.effects, model.spans, strict=True) if effect in effects]
    values = np.concatenate([np.empty(0), *(model.values[span] for span in spans)])
    part = Model(model.arm, tuple(effects), values, within=model.within, fitted_to=model.fitted_to, state=model.state)
    keys = set(part.keys)
    return replace(part, free=tuple(key for key in model.free if key in keys))


def clock_of(model: Model) -> PwmClock | None:
    """The clock of the servo board whose rounding is an effect of a model; None without that effect."""
    return next((PwmClock(p[0], p[1]) for effect, p in model.parts() if isinstance(effect, Quantisation)), None)
