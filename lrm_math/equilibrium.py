"""Model + poses -> where the arm comes to rest, and its TCP there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_math import statics
from lrm_math.chain import Array, Number, pull_back, trig, trig_of
from lrm_math.effects import Effect
from lrm_math.errors import NotSettled
from lrm_math.model import Model
from lrm_math.poses import Poses

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

    @cached_property
    def weights(self) -> list[statics.Weight]:
        """Every body's mass and centre of mass, payload and effects included."""
        return _weights(self.model, self.poses)

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

    Args:
        start: an equilibrium of the same poses for nearby parameters, to start from.
        tolerance: m, see `TOLERANCE`.

    Raises:
        NotSettled: naming the poses that did not come to rest, or only after giving way by half a radian or more.
    """
    chain, count = model.chain, len(poses)
    rigid, elastic = _rigid_amounts(model, poses)
    weights, pushed = _weights(model, poses), _pushes(model, poses)
    slots = list(rigid)
    moving = sorted({chain.index[key] for e, _ in elastic for key in e.moves})
    if start is not None:
        for k in moving:
            slots[k] = start.slots[k]
    angles = trig(chain, slots)
    tau: list[Number] = []
    relaxed: _Relaxation | None = None
    for iteration in range(1, MOST_ITERATIONS + 1):
        tau = statics.loads(chain, slots, angles, weights, model.felt)
        tau = [load + pushed[k] if k in pushed else load for k, load in zip(model.felt, tau, strict=True)]
        wanted = _elastic_amounts(model, poses, elastic, rigid, tau)
        steps = [wanted[k] - slots[k] for k in moving]
        change = np.zeros(count)
        for k, step in zip(moving, steps, strict=True):
            change += np.abs(step) * (_reach(model) if chain.slots[k].rotates else 1.0)
        worst = change.max(initial=0.0)
        if not np.isfinite(worst):
            break
        if iteration > PLAIN_ITERATIONS and worst > tolerance:
            relaxed = _Relaxation.after(relaxed, np.array([np.broadcast_to(step, count) for step in steps]))
            steps = list(relaxed.share * relaxed.step)
        for k, step in zip(moving, steps, strict=True):
            slots[k] = slots[k] + step
            if chain.slots[k].rotates:
                angles[k] = trig_of(slots[k])
        if worst <= tolerance:
            _check_small(model, poses, slots, rigid, moving)
            tcp = pull_back(chain, slots, angles)
            true = np.stack([np.broadcast_to(component, count) for component in tcp], axis=1)
            return Equilibrium(model, poses, tuple(slots), tuple(tau), _seen(model, true), true, iteration)
    restless = np.flatnonzero(~(change <= tolerance))
    left = f"after {iteration} iterations the TCP still moves {change[restless].max() * 1e3:.3g} mm"
    raise NotSettled(poses.names(restless), left)


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


def _check_small(model: Model, poses: Poses, slots: list[Number], rigid: list[Number], moving: list[int]) -> None:
    chain, count = model.chain, len(poses)
    for k in moving:
        motion = np.broadcast_to(np.abs(np.subtract(slots[k], rigid[k])), count)
        if chain.slots[k].rotates and motion.max(initial=0.0) > LARGEST_MOTION:
            far = np.flatnonzero(motion > LARGEST_MOTION)
            raise NotSettled(poses.names(far), f"{chain.slots[k].key} gives way by {np.degrees(motion.max()):.0f} deg")


def _weights(model: Model, poses: Poses) -> list[statics.Weight]:
    added = (
        (body, ballast)
        for effect, p in model.parts()
        if effect.weighs
        for body, ballast in zip(effect.weighs, effect.weight(poses, p), strict=True)
    )
    return statics.weights(model.chain, _constant_if_equal(poses.payload), added)


def _pushes(model: Model, poses: Poses) -> dict[int, Number]:
    """Loads that effects put on slots, by number of the slot."""
    out: dict[int, Number] = {}
    for effect, p in model.parts():
        for key, load in zip(effect.pushes, effect.push(poses, p), strict=True):
            k = model.chain.index[key]
            out[k] = out.get(k, 0.0) + load
    return out


def _seen(model: Model, tcp: Array) -> Array:
    seen = tcp
    for effect, p in model.parts():
        shift = effect.seen(tcp, p)
        if shift is not None:
            seen = seen + shift
    return seen


def _rigid_amounts(model: Model, poses: Poses) -> tuple[list[Number], list[tuple[Effect, Array]]]:
    """Slot amounts of the nominal arm and of every effect that feels no load; the effects that are left."""
    chain = model.chain
    slots = chain.values([poses.angle(i) for i in range(chain.dof)])
    for place in {key.split(".")[0] for effect in model.effects for key in effect.moves}:
        for k, way in chain.hinges(place):
            slots[k] = way
    elastic = []
    for effect, span in zip(model.effects, model.spans, strict=True):
        if effect.feels:
            elastic.append((effect, model.values[span]))
            continue
        for key, amount in zip(effect.moves, effect.motion(poses, (), model.values[span].tolist()), strict=True):
            slots[chain.index[key]] = slots[chain.index[key]] + amount
    return slots, elastic


def _elastic_amounts(
    model: Model, poses: Poses, elastic: list[tuple[Effect, Array]], rigid: list[Number], tau: list[Number]
) -> dict[int, Number]:
    load = dict(zip(model.felt, tau, strict=True))
    index = model.chain.index
    wanted: dict[int, Number] = {}
    for effect, p in elastic:
        felt = tuple(load[index[key]] for key in effect.feels)
        for key, amount in zip(effect.moves, effect.motion(poses, felt, p.tolist()), strict=True):
            k = index[key]
            wanted[k] = wanted.get(k, rigid[k]) + amount
    return wanted


def _constant_if_equal(payload: Array) -> Number:
    return float(payload[0]) if len(payload) and np.all(payload == payload[0]) else payload


def _reach(model: Model) -> float:
    """No rotation by 1 rad can move the TCP further than this (m): the stretched nominal arm, with a margin."""
    return 1.2 * sum(
        abs(slot.nominal)
        for slot in model.chain.slots
        if not slot.rotates and not slot.place.startswith(("base", "link"))
    )
