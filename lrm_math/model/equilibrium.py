"""Model + poses -> where the arm comes to rest, and its TCP there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import NotSettled
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Number, pull_back, trig, trig_of
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import largest, size
from lrm_math.model.model import Model

TOLERANCE = 1e-9
"""m: the iteration ends when no TCP can still move more than this (DESIGN asks for 1e-6)."""
PLAIN_ITERATIONS, MOST_ITERATIONS = 20, 150
SMALLEST_SHARE = 0.02
LARGEST_MOTION = 0.5
"""rad: beyond it the small rotations that effects stand for are not small, and the arm has lost its shape."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Where the arm comes to rest, for N poses.

    Attributes:
        slots: amount of every slot of the chain, nominal + all effects, each a float or (N,) (rad, m).
        tau: load on each slot of `model.felt`, N·m, each (N,).
        tcp: (N, 3), m, as the tracker sees it.
        true_tcp: (N, 3), m, where it is; the same unless an effect of the model distorts the tracker's frame.
        iterations: how many it took.
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
    """Finds where the arm rests: effects move slots, that changes the loads, those change the effects.

    Fixed-point iteration (thesis Figure 4.4). Poses that do not settle soon take a share of each step, which
    follows from how the last step changed the next (Aitken's relaxation for vectors; Irons & Tuck 1969).
    One pose alone is reckoned with Python's floats, many with numpy's arrays: each is many times faster there.

    Args:
        start: an equilibrium of the same poses for nearby parameters, to start from.
        tolerance: m, see `TOLERANCE`.

    Raises:
        NotSettled: naming the poses that did not come to rest, or only after giving way by half a radian or more.
    """
    return settle(model, poses, None if start is None else start.slots, tolerance)


def settle(
    model: Model, poses: Poses, start: Sequence[Number] | None = None, tolerance: float = TOLERANCE
) -> Equilibrium:
    """`equilibrium`, from amounts of all slots (rad, m; each a float or (N,)) near those at rest."""
    chain, wiring = model.chain, model.wiring
    rigid = rigid_amounts(model, poses)
    weights, pushed = model.weights(poses.carried), pushes_of(model, poses)
    slots = list(rigid)
    for k in wiring.moving if start is not None else ():
        slots[k] = start[k]  # type: ignore[index]
    angles = trig(chain, slots)
    tau: list[Number] = []
    relaxed: _Relaxation | None = None
    for iteration in range(1, MOST_ITERATIONS + 1):
        tau = statics.loads(chain, slots, angles, weights, model.felt)
        tau = [load + pushed[k] if k in pushed else load for k, load in zip(model.felt, tau, strict=True)]
        wanted = {k: rigid[k] for k in wiring.moving}
        for effect in wiring.elastic:
            for k, amount in effect.motion(poses, tau):
                wanted[k] = wanted[k] + amount
        steps = [wanted[k] - slots[k] for k in wiring.moving]
        change: Number = 0.0
        for k, step in zip(wiring.moving, steps, strict=True):
            change = change + size(step) * (wiring.reach if chain.slots[k].rotates else 1.0)
        worst = largest(change)
        if not math.isfinite(worst):
            break
        if iteration > PLAIN_ITERATIONS and worst > tolerance:
            relaxed = _Relaxation.after(relaxed, np.array([np.broadcast_to(step, len(poses)) for step in steps]))
            steps = relaxed.steps
        for k, step in zip(wiring.moving, steps, strict=True):
            slots[k] = slots[k] + step
            if chain.slots[k].rotates:
                angles[k] = trig_of(slots[k])
        if worst <= tolerance:
            _check_small(model, poses, slots, rigid)
            true = _columns(pull_back(chain, slots, angles), len(poses))
            return Equilibrium(model, poses, tuple(slots), tuple(tau), _seen(model, true), true, iteration)
    restless = np.flatnonzero(~(np.broadcast_to(change, len(poses)) <= tolerance))
    left = f"after {iteration} iterations the TCP still moves {worst * 1e3:.3g} mm"
    raise NotSettled(poses.names(restless), left)


def _at(amount: Number, row: int) -> float:
    return amount if isinstance(amount, float) else float(amount[row if len(amount) > 1 else 0])


def _columns(components: Sequence[Number], count: int) -> Array:
    """(N, 3) from three components, each a float or (N,)."""
    if count == 1:
        return np.array([[float(c) for c in components]])
    return np.stack([np.broadcast_to(c, count) for c in components], axis=1)


@dataclass(frozen=True, eq=False)
class _Relaxation:
    """The share (N,) of a step (M, N) that each pose takes."""

    share: Array
    step: Array

    @classmethod
    def after(cls, before: _Relaxation | None, step: Array) -> _Relaxation:
        """The next share: what would have met the root, were the response to the last one linear."""
        if before is None:
            return cls(np.full(step.shape[1], 0.5), step)
        change = step - before.step
        size = np.einsum("mn,mn->n", change, change)
        share = -before.share * np.einsum("mn,mn->n", before.step, change) / np.where(size > 0, size, 1.0)
        return cls(np.clip(np.where(size > 0, share, 1.0), SMALLEST_SHARE, 1.0), step)

    @property
    def steps(self) -> list[Number]:
        """The shares that the M slots take, each (N,), or a float for one pose."""
        shares = self.share * self.step
        return shares[:, 0].tolist() if shares.shape[1] == 1 else list(shares)


def _check_small(model: Model, poses: Poses, slots: list[Number], rigid: list[Number]) -> None:
    chain = model.chain
    for k in model.wiring.moving:
        motion = size(slots[k] - rigid[k])
        if chain.slots[k].rotates and largest(motion) > LARGEST_MOTION:
            far = np.flatnonzero(np.broadcast_to(motion, len(poses)) > LARGEST_MOTION)
            raise NotSettled(
                poses.names(far), f"{chain.slots[k].key} gives way by {math.degrees(largest(motion)):.0f} deg"
            )


def rigid_amounts(model: Model, poses: Poses) -> list[Number]:
    """Amount of every slot (rad, m) before anything gives way: the nominal arm, the command, effects without load."""
    slots: list[Number] = list(model.wiring.steady)
    angles = [poses.angle(joint) for joint in range(model.arm.dof)]
    for k, angle in zip(model.chain.joint_slots, angles, strict=True):
        slots[k] = slots[k] + angle
    for k, joint, ratio in model.wiring.gears:
        slots[k] = slots[k] + ratio * angles[joint]
    for effect in model.wiring.rigid:
        for k, amount in effect.motion(poses, []):
            slots[k] = slots[k] + amount
    return slots


def pushes_of(model: Model, poses: Poses) -> dict[int, Number]:
    """Loads that effects put on slots (N·m), by number of the slot."""
    out: dict[int, Number] = {}
    for wired in model.wiring.pushing:
        for k, load in zip(wired.pushes, wired.effect.push(poses, wired.p), strict=True):
            out[k] = out.get(k, 0.0) + load
    return out


def _seen(model: Model, tcp: Array) -> Array:
    seen = tcp
    for wired in model.wiring.seeing:
        shift = wired.effect.seen(tcp, wired.p)
        if shift is not None:
            seen = seen + shift
    return seen
