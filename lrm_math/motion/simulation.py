"""Motion of one joint in time: the effects of its model, one after the other, and the servo's equation between them.

Midpoint rule with the friction of each step as an impulse that may stop the joint and never turns it back
(Moreau 1988): stick–slip needs no regularisation, and steps of a tenth of the period are enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arrays import Array
from lrm_math.motion.base import JointDrive, MotionEffect, Values
from lrm_math.motion.effects import ServoResponse


def simulate(
    effects: Sequence[MotionEffect], values: Sequence[Values], drive: JointDrive, start: Array, speed: Array
) -> Array:
    """(M + 1, P, S), readings (rad) at the start and after every step.

    Args:
        values: for each effect its parameters (SI), each (P, 1). start, speed: (S,) at the beginning (rad, rad/s).
    """
    pairs = list(zip(effects, values, strict=True))
    count = max(len(p[0]) for _, p in pairs)
    u = np.repeat(drive.command[:, None], count, axis=1)
    for effect, p in pairs:
        u = effect.set_point(u, drive, p)
    q = _servo(pairs, u, drive, start, speed)
    for effect, p in pairs:
        q = effect.reading(q, drive, p)
    return q


def _servo(
    pairs: Sequence[tuple[MotionEffect, Values]], u: Array, drive: JointDrive, start: Array, speed: Array
) -> Array:
    """(M + 1, P, S), angle (rad) of the joint that the servo leads along the set-point u."""
    response = next((p for effect, p in pairs if isinstance(effect, ServoResponse)), None)
    if response is None:
        return np.concatenate([u[:1], u])
    h, (omega, braking) = drive.h, ServoResponse.spring(response)
    slowed = 2.0 / h * np.tan(0.5 * omega * h) / omega  # the rule swings slower by this: time is counted accordingly
    omega, braking = omega * slowed, braking * slowed
    stiff = (omega * h) ** 2
    braking = braking + omega**2 * sum(effect.damping(drive, p) for effect, p in pairs)
    damped, inertia = 0.5 * h * braking, 1.0 + sum(effect.inertia(drive, p) for effect, p in pairs)
    inertia = np.broadcast_to(np.maximum(inertia, 0.05), u.shape)
    told = u + sum(effect.push(drive, p) for effect, p in pairs)
    rubs = np.broadcast_to(sum(effect.friction(drive, p) for effect, p in pairs), u.shape)
    fading = [(e, p) for e, p in pairs if type(e).friction_at is not MotionEffect.friction_at]
    limits = [limit for effect, p in pairs if (limit := effect.saturation(p)) is not None]
    most = np.minimum.reduce(limits) if limits else None
    q, v = np.broadcast_to(start, u.shape[1:]).copy(), np.broadcast_to(speed, u.shape[1:]).copy()
    out = np.empty((len(u) + 1, *u.shape[1:]))
    out[0], dry = q, bool(np.any(rubs)) or bool(fading)
    scale, kept = 1.0 / (inertia + damped + 0.25 * stiff), inertia - damped - 0.25 * stiff
    for k in range(len(u)):
        error = told[k] - q
        then = (kept[k] * v + stiff / h * error) * scale[k]
        held = stiff / h * scale[k]
        if most is not None:
            beyond = np.abs(error) > most
            flat = 1.0 / (inertia[k] + damped)
            bounded = ((inertia[k] - damped) * v + stiff / h * np.clip(error, -most, most)) * flat
            then, held = np.where(beyond, bounded, then), np.where(beyond, stiff / h * flat, held)
        if dry:
            bound = rubs[k] + sum(effect.friction_at(v, p) for effect, p in fading)
            bound = held * bound
            then = then - np.clip(then, -bound, bound)
        q = q + 0.5 * h * (v + then)
        v = then
        out[k + 1] = q
    return out
