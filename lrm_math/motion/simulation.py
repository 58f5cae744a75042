"""Motion of one joint in time: the effects of its model, one after the other, and the servo's equation between them.

Each step is the exact motion of spring and damper under a constant force. Friction of a step is the force that stops
the joint, or as much of it as there is, so that it never turns back (Moreau 1988): stick–slip needs no regularisation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from lrm_math.arrays import Array
from lrm_math.motion.base import JointDrive, MotionEffect, Values
from lrm_math.motion.effects import ServoResponse
from lrm_math.motion.linear_recursion import linear_recursion
from lrm_math.motion.spring_step import sprung, two_masses

LEAST_INERTIA = 0.05
"""J/J₀ of a posture that is lighter than any."""
IMPLICIT = 2
"""Times that friction which depends on speed is improved within its own step."""


def simulate(effects: Sequence[MotionEffect], values: Sequence[Values], drive: JointDrive) -> Array:
    """(M + 1, P, S), readings (rad) at the start and after every step.

    Args:
        values: for each effect its parameters (SI), each (P, 1).
    """
    pairs = list(zip(effects, values, strict=True))
    count = max(len(p[0]) for _, p in pairs)
    u = np.repeat(drive.command[:, None], count, axis=1)
    for effect, p in pairs:
        u = effect.set_point(u, drive, p)
    start = drive.start
    for effect, p in reversed(pairs):
        start = effect.angle(start, p)
    q = _servo(pairs, u, drive, start)
    for effect, p in pairs:
        q = effect.reading(q, drive, p)
    return q


def _servo(pairs: Sequence[tuple[MotionEffect, Values]], u: Array, drive: JointDrive, start: Array) -> Array:
    """(M + 1, P, S), angle (rad) of the joint that a servo leads along the set-point u, or of what swings behind it."""
    response = next((p for effect, p in pairs if isinstance(effect, ServoResponse)), None)
    if response is None:
        return np.concatenate([u[:1], u])
    h, (omega, braking) = drive.h, ServoResponse.spring(response)
    braking = braking + omega**2 * sum(effect.damping(drive, p) for effect, p in pairs)
    yielding = sum(effect.compliance(p) for effect, p in pairs)
    heavier = yielding * omega**2 * (drive.inertia - drive.reference)[:, None]
    inertia = 1.0 + heavier + sum(effect.inertia(drive, p) for effect, p in pairs)
    inertia = _unrepeated(np.maximum(inertia, LEAST_INERTIA))  # often one number: one matrix of a step, not thousands
    stiffness, braking = omega**2 / inertia, braking / inertia
    second = next((x for effect, p in pairs if (x := effect.hung(p)) is not None), None)
    damped: tuple[Array, ...] = sprung(stiffness, braking, h)
    if second is None:
        step = np.array([[1.0 - damped[0], -damped[1]], [damped[2], damped[3]]])
    else:
        step = two_masses(stiffness, braking, (*second[:2], second[2] / inertia), h)
    step = step[:, :, None] if step.ndim < 5 else step
    blows = stiffness * sum(effect.lead(p) for effect, p in pairs) * np.diff(u, axis=0, prepend=u[:1])
    told = u + yielding * drive.reaction[:, None] + sum(effect.push(drive, p) for effect, p in pairs)
    rubs = np.broadcast_to(sum(effect.friction(drive, p) for effect, p in pairs), u.shape)
    fading = [(e, p) for e, p in pairs if type(e).friction_at is not MotionEffect.friction_at]
    limits = [limit for effect, p in pairs if (limit := effect.saturation(p)) is not None]
    most = np.minimum.reduce(limits) if limits else None
    q, v = np.broadcast_to(start, u.shape[1:]).copy(), np.broadcast_to(drive.speed, u.shape[1:]).copy()
    dry = bool(np.any(rubs)) or bool(fading)
    if not dry and most is None:
        return _pulled(step, told, blows, q, v)
    out = np.empty((len(u) + 1, *u.shape[1:]))
    out[0] = q
    step = np.broadcast_to(step, (*step.shape[:2], *u.shape))
    pushed, moved, kicked, slowed = 1.0 - step[0, 0], -step[0, 1], step[1, 0], step[1, 1]
    behind = np.zeros((2, *q.shape))  # angle and speed of the second mass, less those of the joint
    for k in range(len(u)):
        v = v + blows[k]
        force, ahead, then = told[k] - q, moved[k] * v, slowed[k] * v
        if second is not None:
            ahead = ahead - np.sum(step[0, 2:, k] * behind, axis=0)
            then = then + np.sum(step[1, 2:, k] * behind, axis=0)
        if most is not None:
            limited = _within(force, most)
            force = force - _mean_excess(force, force - pushed[k] * limited - ahead, most)
        then = then + kicked[k] * force
        if dry:
            stop, half = -then / kicked[k], 0.5 * kicked[k]
            if fading:
                rub = _implicit(partial(_rub, fading, rubs[k], stop, 0.5 * v - half * stop, half), np.zeros_like(q))
            else:
                rub = _within(stop, rubs[k])
            force, then = force + rub, then + kicked[k] * rub
        q = q + pushed[k] * force + ahead
        if second is not None:
            behind = np.sum(step[2:, 2:, k] * behind, axis=1) + step[2:, 0, k] * force + step[2:, 1, k] * v
        v = then
        out[k + 1] = q + behind[0]
    return out


def _pulled(step: Array, told: Array, blows: Array, q: Array, v: Array) -> Array:
    """(M + 1, P, S), rad, of the read mass where neither friction nor a limit acts: each step is linear.

    `step`: (n, n, M or 1, …), of the deflection told − q, the speed, and of what is hung.
    """
    sign = np.array([-1.0, *np.ones(len(step) - 1)]).reshape(-1, 1, 1, 1)
    A = np.moveaxis(sign[:, None] * step * sign, 2, 0)
    pull = step[:, 0].copy()
    pull[0] = 1.0 - pull[0]
    b = np.moveaxis(pull * told + sign * step[:, 1] * blows, 0, 1)
    x = np.concatenate([[q, v], np.zeros((len(step) - 2, *q.shape))])
    path = linear_recursion(A, b, x)
    return path[:, 0] if len(step) == 2 else path[:, 0] + path[:, 2]


def _unrepeated(values: Array) -> Array:
    """The same values, with one entry along every axis on which they do not vary."""
    for axis in range(values.ndim):
        first = values[(slice(None),) * axis + (slice(1),)]
        if (values == first).all():
            values = first
    return values


def _rub(
    fading: Sequence[tuple[MotionEffect, Values]], dry: Array, stop: Array, slow: Array, kicked: Array, rub: Array
) -> Array:
    """Friction (rad) at the mean speed slow + kicked rub of a step; `stop`: what would stop the joint."""
    speed, bound = slow + kicked * rub, dry
    for effect, p in fading:
        bound = bound + effect.friction_at(speed, p)
    return _within(stop, bound)


def _within(values: Array, bound: Array) -> Array:
    """Values no farther from zero than a bound; `np.clip` takes three times as long for so few."""
    return np.asarray(np.minimum(np.maximum(values, -bound), bound))


def _implicit(of: Callable[[Array], Array], rub: Array) -> Array:
    """The rub that is what follows of itself, by fixed points that are extrapolated (Steffensen 1933)."""
    for _ in range(IMPLICIT):
        once = of(rub)
        twice = of(once)
        first = once - rub
        bend = twice - once - first
        curved = np.abs(bend) > 1e-12
        rub = np.where(curved, rub - first * first / np.where(curved, bend, 1.0), twice)
    return of(rub)


def _mean_excess(before: Array, after: Array, most: Array) -> Array:
    """What of a deflection (rad) that goes straight from one to another lies beyond ±`most`, the mean over the way."""
    first, last = (np.maximum(np.abs(x) - most, 0.0) for x in (before, after))
    change = after - before
    standing = np.abs(change) < 1e-9
    along = 0.5 * (last**2 - first**2) / np.where(standing, 1.0, change)
    return np.asarray(np.where(standing, np.sign(before) * first, along))
