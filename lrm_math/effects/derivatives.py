"""Derivatives of what an effect adds, by its parameters, loads and the commanded angles: nobody writes them.

An effect that is linear in its parameters gives its basis; everything else is evaluated on dual numbers. A function
that takes no duals (a table of numbers, say) is differentiated by central differences, whose error is about 1e-9 of the
amount.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lrm_math.effects.base import Amounts, Effect, Extrapolation, LinearEffect
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.poses import Poses

STEP = 6e-6
"""Cube root of the machine epsilon: the best step of a central difference."""
Rows = tuple[Amounts, ...]
"""One number or (N,) for each of D quantities and each target of an effect."""


def amounts_within(
    effect: Effect, poses: Poses, tau: Amounts, p: Sequence[float], within: MeasuredRange | None
) -> Amounts:
    """`Effect.amounts`, held at the edge of a range where the effect is held, zero far beyond it where it fades."""
    if effect.extrapolation is Extrapolation.FADING:
        return effect.over(within).amounts(poses, tau, p)
    return effect.amounts(*_held_within(effect, poses, tau, within), p)


def _held_within(effect: Effect, poses: Poses, tau: Amounts, within: MeasuredRange | None) -> tuple[Poses, Amounts]:
    if within is None or effect.extrapolation is not Extrapolation.HELD:
        return poses, tau
    return within.poses(poses) if effect.depends_on else poses, within.loads(effect.load_slots, tau)


def by_parameters(
    effect: Effect,
    poses: Poses,
    tau: Amounts,
    p: Sequence[float],
    within: MeasuredRange | None = None,
    chosen: Sequence[int] | None = None,
) -> Rows:
    """∂amount/∂p: for each parameter, or each of those `chosen` by number, one number or (N,) for each target; other
    arguments as of `amounts_within`."""
    poses, tau = _held_within(effect, poses, tau, within)
    chosen = range(len(p)) if chosen is None else chosen
    if effect.extrapolation is Extrapolation.FADING:
        effect = effect.over(within)
    if isinstance(effect, LinearEffect):
        basis = effect.basis(poses, tau)
        return tuple([basis[row] for row in chosen])
    if "counts" in effect.depends_on:  # a staircase
        return ((0.0,) * len(effect.targets),) * len(chosen)
    seeded = dict(zip(chosen, _seeds([p[row] for row in chosen]), strict=True))
    return _rows(
        lambda: effect.amounts(poses, tau, [seeded.get(row, value) for row, value in enumerate(p)]),  # type: ignore[misc]
        lambda j, h: effect.amounts(poses, tau, _changed(p, chosen[j], h)),  # type: ignore[arg-type]
        [STEP * effect.parameters[row].typical for row in chosen],
    )


def by_loads(
    effect: Effect, poses: Poses, tau: Amounts, p: Sequence[float], within: MeasuredRange | None = None
) -> Rows:
    """∂amount/∂tau: for each of the effect's `load_slots` one number or (N,) for each target."""
    return _rows(
        lambda: amounts_within(effect, poses, tuple(_seeds(tau)), p, within),
        lambda j, h: amounts_within(effect, poses, _changed(tau, j, h), p, within),
        [STEP] * len(tau),
    )


def by_angles(
    effect: Effect, poses: Poses, tau: Amounts, p: Sequence[float], within: MeasuredRange | None = None
) -> Rows:
    """∂amount/∂q at fixed loads: for each joint one number or (N,) for each target."""
    joints = effect.arm.dof
    if "angle" not in effect.depends_on:
        return ((0.0,) * len(effect.targets),) * joints
    slope = np.repeat(np.eye(joints)[:, None, :], len(poses), axis=1)
    return _rows(
        lambda: amounts_within(effect, replace(poses, q=Dual(poses.q, slope)), tau, p, within),  # type: ignore[arg-type]
        lambda j, h: amounts_within(effect, poses.perturbed(j, h), tau, p, within),
        [STEP] * joints,
    )


def _rows(on_duals: Callable[[], Amounts], changed: Callable[[int, float], Amounts], steps: Sequence[float]) -> Rows:
    """The slopes of duals; where the function takes none, central differences of these steps."""
    try:
        amounts = on_duals()
        return tuple(tuple(_slope(amount, j) for amount in amounts) for j in range(len(steps)))
    except TypeError:
        sides = [(changed(j, h), changed(j, -h), h) for j, h in enumerate(steps)]
        return tuple(tuple((a - b) / (2.0 * h) for a, b in zip(plus, minus, strict=True)) for plus, minus, h in sides)


def _slope(amount: Number | Dual, j: int) -> Number:
    """Derivative by quantity number j; zero of what depends on none. Raises `TypeError` for an array of objects."""
    if not isinstance(amount, Dual):
        if isinstance(amount, np.ndarray) and amount.dtype.kind == "O":
            raise TypeError("duals in an array")
        return 0.0
    row = np.asarray(amount.slope[min(j, len(amount.slope) - 1)])
    if not row.any():
        return 0.0
    return float(row.ravel()[0]) if row.size == 1 else row


def _seeds(values: Sequence[Number]) -> list[Number]:
    """The values as duals that carry the derivatives by themselves."""
    units = np.eye(len(values))[:, :, None]
    return [Dual(value, units[:, j]) for j, value in enumerate(values)]  # type: ignore[misc]


def _changed(values: Sequence[Number], j: int, step: float) -> tuple[Number, ...]:
    return tuple(value + step if i == j else value for i, value in enumerate(values))
