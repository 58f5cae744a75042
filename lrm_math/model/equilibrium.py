"""Elastic equilibrium: the slots' amounts at which elastic motions and loads agree, and the TCP there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Angle, Number, pull_back, trig, trig_of
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude, maximum
from lrm_math.model.model import Model

TOLERANCE = 1e-9
"""m: the iteration ends when no TCP can still move more than this."""
PLAIN_ITERATIONS, MOST_ITERATIONS = 20, 150
SLOW_SHARE = 0.5
"""Share of the poses that still move, below which they go on alone."""
SMALLEST_FACTOR = 0.02
LARGEST_MOTION = 0.5
"""rad: larger elastic rotations are refused, since the effects' formulas hold for small motions."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The elastic equilibrium of N poses.

    Attributes:
        slots: amount of every slot of the chain, nominal + all effects, each a float or (N,) (rad, m).
        tau: load on each slot of `model.load_slots`, N·m, each (N,).
        tcp: (N, 3), m, as the tracker measures it.
        true_tcp: (N, 3), m; differs from `tcp` only where an effect of the model distorts the measurement.
        iterations: number of fixed-point iterations.
    """

    model: Model
    poses: Poses
    slots: tuple[Number, ...]
    tau: tuple[Number, ...]
    tcp: Array
    true_tcp: Array
    iterations: int

    def one(self, row: int) -> Equilibrium:
        """One pose alone, all numbers floats."""
        slots, tau = (tuple(_at(a, row) for a in amounts) for amounts in (self.slots, self.tau))
        tcp, true = self.tcp[[row]], self.true_tcp[[row]]
        return Equilibrium(self.model, self.poses.one(row), slots, tau, tcp, true, self.iterations)

    def take(self, rows: NDArray[np.int64]) -> Equilibrium:
        """The poses of these rows."""
        slots, tau = (tuple(_part(a, rows) for a in amounts) for amounts in (self.slots, self.tau))
        tcp, true = self.tcp[rows], self.true_tcp[rows]
        return Equilibrium(self.model, self.poses.take(rows), slots, tau, tcp, true, self.iterations)

    @cached_property
    def weights(self) -> tuple[statics.Weight, ...]:
        """Every body's mass and centre of mass, payload and effects included."""
        return self.model.weights(self.poses.carried)

    def loads_on(self, slots: Sequence[int]) -> Array:
        """(N, len(slots)), gravity's load on rotating slots given by number, ascending (N·m)."""
        chain = self.model.chain
        loads = statics.loads(chain, self.slots, trig(chain, self.slots), self.weights, slots)
        return np.stack([np.broadcast_to(load, len(self.poses)) for load in loads], axis=1)

    @property
    def weightless(self) -> bool:
        """Whether no body has mass, payload and effects included, so that gravity loads nothing."""
        return all(not np.any(weight.mass) for weight in self.weights)

    @property
    def joint_torque(self) -> Array:
        """(N, n), gravity's torque on every joint axis (N·m), thesis Eq 2.48."""
        return self.loads_on(self.model.chain.joint_slots)

    @property
    def base_moment(self) -> Array:
        """(N,), gravity's moment about the base's y axis at the base's origin (N·m), thesis section 4.3."""
        return np.asarray(self.loads_on([self.model.chain.index["base.beta"]])[:, 0])


def equilibrium(
    model: Model, poses: Poses, start: Equilibrium | None = None, tolerance: float = TOLERANCE
) -> Equilibrium:
    """The elastic equilibrium by fixed-point iteration (thesis Figure 4.4).

    Poses that do not converge soon are under-relaxed by Aitken's method for vectors (Irons & Tuck 1969). One pose alone
    is computed with Python's floats, many with numpy's arrays: each is many times faster so.

    Args:
        start: an equilibrium of the same poses for nearby parameters, to start from.
        tolerance: m, see `TOLERANCE`.

    Raises:
        NoEquilibrium: poses that do not converge, or where a slot deflects by more than `LARGEST_MOTION`.
    """
    return solve_equilibrium(model, poses, None if start is None else start.slots, tolerance)


def solve_equilibrium(
    model: Model, poses: Poses, start: Sequence[Number] | None = None, tolerance: float = TOLERANCE
) -> Equilibrium:
    """`equilibrium`, started from amounts of all slots (rad, m; each a float or (N,))."""
    rigid = rigid_amounts(model, poses)
    first = list(rigid)
    for k in model.binding.moving if start is not None else ():
        first[k] = start[k]  # type: ignore[index]
    found = _settle(model, poses, rigid, effect_loads(model, poses), first, tolerance)
    _check_small(model, poses, found.slots, rigid)
    true = _columns(pull_back(model.chain, found.slots, found.angles), len(poses))
    slots, tau = tuple(found.slots), tuple(found.tau)
    return Equilibrium(model, poses, slots, tau, _measured(model, true), true, found.iterations)


@dataclass(frozen=True, eq=False)
class _Settled:
    """Amounts of all slots at rest, the trigonometry of their angles, loads on the model's `load_slots`."""

    slots: list[Number]
    angles: list[Angle]
    tau: list[Number]
    iterations: int


def _settle(
    model: Model,
    poses: Poses,
    rigid: list[Number],
    pushed: dict[int, Number],
    first: list[Number],
    tolerance: float,
) -> _Settled:
    """Iterates from `first` until every pose is at rest; a few slow poses of many go on alone. Raises `NoEquilibrium`.

    Args:
        rigid: amounts of the slots of the rigid arm. pushed: loads that effects put on slots.
    """
    chain, binding, slots = model.chain, model.binding, list(first)
    weights, angles = model.weights(poses.carried), trig(chain, slots)
    relaxed: _Relaxation | None = None
    for iteration in range(1, MOST_ITERATIONS + 1):
        tau = statics.loads(chain, slots, angles, weights, model.load_slots)
        tau = [load + pushed[k] if k in pushed else load for k, load in zip(model.load_slots, tau, strict=True)]
        target = {k: rigid[k] for k in binding.moving}
        for effect in binding.elastic:
            for k, amount in effect.motion(poses, tau):
                target[k] = target[k] + amount
        steps = [target[k] - slots[k] for k in binding.moving]
        change: Number = 0.0
        for k, step in zip(binding.moving, steps, strict=True):
            change = change + magnitude(step) * (binding.reach if chain.slots[k].rotates else 1.0)
        worst = maximum(change)
        if not math.isfinite(worst):
            break
        slow = np.flatnonzero(np.broadcast_to(change, len(poses)) > tolerance) if iteration > PLAIN_ITERATIONS else None
        few = slow is not None and len(slow) <= SLOW_SHARE * len(poses)
        if slow is not None and len(slow) and not few:
            relaxed = _Relaxation.after(relaxed, np.array([np.broadcast_to(step, len(poses)) for step in steps]))
            steps = relaxed.steps
        for k, step in zip(binding.moving, steps, strict=True):
            slots[k] = slots[k] + step
            if chain.slots[k].rotates:
                angles[k] = trig_of(slots[k])
        now = _Settled(slots, angles, tau, iteration)
        if worst <= tolerance:
            return now
        if slow is not None and few:
            return _with_slow(model, poses, rigid, pushed, now, slow, tolerance)
    diverging = np.flatnonzero(~(np.broadcast_to(change, len(poses)) <= tolerance))
    left = f"after {iteration} iterations the TCP still moves {worst * 1e3:.3g} mm"
    raise NoEquilibrium(poses.names(diverging), left)


def _with_slow(
    model: Model,
    poses: Poses,
    rigid: list[Number],
    pushed: dict[int, Number],
    now: _Settled,
    slow: NDArray[np.int64],
    tolerance: float,
) -> _Settled:
    """The poses at rest, and the slow ones iterated alone: an iteration of few poses costs little."""
    alone = replace(poses, number=np.array(poses.names(np.arange(len(poses))))).take(slow)

    def part(amount: Number) -> Number:
        return _at(amount, int(slow[0])) if len(slow) == 1 else _part(amount, slow)

    loads = {k: part(load) for k, load in pushed.items()}
    found = _settle(model, alone, [part(a) for a in rigid], loads, [part(a) for a in now.slots], tolerance)
    count = len(poses)
    slots, tau = list(now.slots), [_merged(a, b, slow, count) for a, b in zip(now.tau, found.tau, strict=True)]
    for k in model.binding.moving:
        slots[k] = _merged(now.slots[k], found.slots[k], slow, count)
    return _Settled(slots, trig(model.chain, slots), tau, now.iterations + found.iterations)


def _merged(amount: Number, other: Number, rows: NDArray[np.int64], count: int) -> Number:
    """An amount of all poses, that of some rows replaced."""
    whole = np.array(np.broadcast_to(amount, count))
    whole[rows] = other
    return whole


def _at(amount: Number, row: int) -> float:
    return amount if isinstance(amount, float) else float(amount[row if len(amount) > 1 else 0])


def _part(amount: Number, rows: NDArray[np.int64]) -> Number:
    return amount[rows] if isinstance(amount, np.ndarray) and len(amount) > 1 else amount


def _columns(components: Sequence[Number], count: int) -> Array:
    """(N, 3) from three components, each a float or (N,)."""
    if count == 1:
        return np.array([[_at(c, 0) for c in components]])
    return np.stack([np.broadcast_to(c, count) for c in components], axis=1)


@dataclass(frozen=True, eq=False)
class _Relaxation:
    """Aitken relaxation: the factor (N,) applied to a step (M, N) of each pose."""

    factor: Array
    step: Array

    @classmethod
    def after(cls, before: _Relaxation | None, step: Array) -> _Relaxation:
        """The next factor: exact if the residual were linear along the last step."""
        if before is None:
            return cls(np.full(step.shape[1], 0.5), step)
        change = step - before.step
        size = np.einsum("mn,mn->n", change, change)
        factor = -before.factor * np.einsum("mn,mn->n", before.step, change) / np.where(size > 0, size, 1.0)
        return cls(np.clip(np.where(size > 0, factor, 1.0), SMALLEST_FACTOR, 1.0), step)

    @property
    def steps(self) -> list[Number]:
        """The relaxed steps of the M slots, each (N,), or a float for one pose."""
        relaxed = self.factor * self.step
        return relaxed[:, 0].tolist() if relaxed.shape[1] == 1 else list(relaxed)


def _check_small(model: Model, poses: Poses, slots: list[Number], rigid: list[Number]) -> None:
    chain = model.chain
    for k in model.binding.moving:
        motion = magnitude(slots[k] - rigid[k])
        if chain.slots[k].rotates and maximum(motion) > LARGEST_MOTION:
            far = np.flatnonzero(np.broadcast_to(motion, len(poses)) > LARGEST_MOTION)
            raise NoEquilibrium(
                poses.names(far), f"{chain.slots[k].key} gives way by {math.degrees(maximum(motion)):.0f} deg"
            )


def rigid_amounts(model: Model, poses: Poses) -> list[Number]:
    """Amount of every slot (rad, m) of the rigid arm: nominal dimensions, the command, effects that feel no load."""
    slots: list[Number] = list(model.binding.constants)
    angles = [poses.angle(joint) for joint in range(model.arm.dof)]
    for k, angle in zip(model.chain.joint_slots, angles, strict=True):
        slots[k] = slots[k] + angle
    for k, joint, ratio in model.binding.gears:
        slots[k] = slots[k] + ratio * angles[joint]
    for effect in model.binding.rigid:
        for k, amount in effect.motion(poses, []):
            slots[k] = slots[k] + amount
    return slots


def effect_loads(model: Model, poses: Poses) -> dict[int, Number]:
    """Loads that effects put on slots (N·m), by number of the slot."""
    out: dict[int, Number] = {}
    for bound in model.binding.pushing:
        for k, load in zip(bound.pushes, bound.effect.push(poses, bound.p), strict=True):
            out[k] = out.get(k, 0.0) + load
    return out


def _measured(model: Model, tcp: Array) -> Array:
    measured = tcp
    for bound in model.binding.distorting:
        error = bound.effect.seen(tcp, bound.p)
        if error is not None:
            measured = measured + error
    return measured
