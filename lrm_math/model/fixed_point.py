"""Fixed-point iteration for the amounts of slots and the loads that hold each other in equilibrium."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Angle, Number, trig, trig_of
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model

ACCELERATED_ITERATIONS, PLAIN_ITERATIONS, MOST_ITERATIONS = 20, 60, 600
FEW = 0.5
"""Share of the poses below which those that still move go on alone."""
SMALLEST_FACTOR, LARGEST_FACTOR = 0.02, 20.0
TINY = 1e-300
MARGIN = 0.1
"""Part of the tolerance below which the next step, predicted from the last two, need not be looked at."""


@dataclass(frozen=True, eq=False)
class SlotIterate:
    """Iterate number `number`: amounts of all slots, their angles' trigonometry, loads on the model's `load_slots`."""

    slots: list[Number]
    angles: list[Angle]
    tau: list[Number]
    number: int


@dataclass(frozen=True, eq=False)
class NewtonPreconditioner:
    """Inverse (I − D H)⁻¹ = I + D (I − H D)⁻¹ H of M elastic slots and A loads at N poses, kept for equilibria nearby
    (chord method, Kelley 1995).

    Attributes:
        moving: the slots.
        by_load: (M, A, N), D: motions that effects add by the loads (rad/N·m or m/N·m).
        by_slot: (A, M, N), H: change of the loads by the slots' amounts.
        inverse: (A, A, N), (I − H D)⁻¹: change of the loads by what is added to them.
    """

    moving: tuple[int, ...]
    by_load: Array
    by_slot: Array
    inverse: Array

    def newton_steps(self, slots: Sequence[int], fixed_point: Array) -> Array:
        """Nearly Newton's steps (K, N) of slots (rad, m), from those of the fixed-point iteration: its next ones are
        added as far as they are linear."""
        rows = [slots.index(k) for k in self.moving]
        # with g the plain step and g' = D H: Newton's step (I − g')⁻¹ g = g + D (I − H D)⁻¹ H g, whose inverse is A × A
        # instead of M × M
        added = fixed_point[rows]
        for matrix in (self.by_slot, self.inverse, self.by_load):
            added = np.einsum("ijn,jn->in", matrix, added)
        steps = fixed_point.copy()
        steps[rows] += added
        return steps


@dataclass(frozen=True, eq=False)
class EquilibriumSearch:
    """Search for the equilibrium of N poses, from amounts of the rigid arm's slots and loads that effects put on slots.

    Accelerated at first, from Newton's steps where a `preconditioner` is known; then plain, which may creep but leaves
    an equilibrium that is none, between the two ends of a play; then relaxed, against oscillations and creep. A few
    slow poses of many go on alone, where an iteration is cheap.
    """

    model: Model
    poses: Poses
    rigid: list[Number]
    applied: dict[int, Number]
    tolerance: float
    preconditioner: NewtonPreconditioner | None = None

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """The M elastic slots."""
        return self.model.binding.moving

    @cached_property
    def _gravity(self) -> statics.Gravity:
        return self.model.gravity(self.poses)

    @cached_property
    def _weights(self) -> tuple[statics.Weight, ...]:
        return self.model.weights(self.poses.carried)

    @cached_property
    def _levers(self) -> Array:
        """(M,), motion of the TCP by each of them at most (m/rad, or 1)."""
        chain, reach = self.model.chain, self.model.binding.reach
        return np.array([reach if chain.slots[k].rotates else 1.0 for k in self.moving])

    def settled(self, iterate: SlotIterate) -> SlotIterate:
        """The iterate at which every pose has settled. Raises `NoEquilibrium`."""
        amounts, before, relaxed, worst = self._rows([iterate.slots[k] for k in self.moving]), None, None, 0.0
        for number in range(iterate.number + 1, MOST_ITERATIONS + 1):
            tau, last = self._loads(iterate), worst
            step = self._bent(tau) - amounts
            change = self._levers @ np.abs(step)
            worst = float(change.max(initial=0.0))
            if not math.isfinite(worst):
                break
            settled = worst <= self.tolerance
            if number <= ACCELERATED_ITERATIONS and not settled:
                if self.preconditioner is not None:
                    step = self.preconditioner.newton_steps(self.moving, step)
                here = FixedPointStep(amounts, step)
                step, before = here.accelerated(before), here
            elif number > PLAIN_ITERATIONS and not settled:
                relaxed = Relaxation.after(relaxed, step)
                step = relaxed.factor * step
            amounts = amounts + step
            iterate = self._moved(iterate, amounts, tau, number)
            if settled:
                return iterate
            # a Newton-like step shrinks by worst/last, so that the next one will be worst²/last: nothing to wait for
            # below the tolerance
            if self.preconditioner is not None and worst * worst <= MARGIN * self.tolerance * last:
                return replace(iterate, tau=self._loads(iterate))
            if number >= ACCELERATED_ITERATIONS and len(self.poses) > 1:
                slow = np.flatnonzero(change > self.tolerance)
                if len(slow) <= FEW * len(self.poses):
                    return self._with_slow(iterate, slow)
        diverging = np.flatnonzero(~(change <= self.tolerance))
        remaining_motion = f"after {number} iterations the TCP still moves {worst * 1e3:.3g} mm"
        raise NoEquilibrium(self.poses.names(diverging), remaining_motion)

    def _loads(self, iterate: SlotIterate) -> list[Number]:
        """Loads on the model's `load_slots`, those included that effects put on them."""
        model = self.model
        tau = statics.loads(model.chain, iterate.slots, iterate.angles, self._weights, self._gravity, model.load_slots)
        return [load + self.applied.get(k, 0.0) for k, load in zip(model.load_slots, tau, strict=True)]

    def _bent(self, tau: list[Number]) -> Array:
        """(M, N), amounts of the moving slots under these loads."""
        binding = self.model.binding
        bent = self._rigid_rows + binding.springs @ self._rows(tau)
        for effect in binding.nonlinear:
            for k, amount in effect.amounts(self.poses, tau):
                bent[self.moving.index(k)] += amount
        return bent

    @cached_property
    def _rigid_rows(self) -> Array:
        return self._rows([self.rigid[k] for k in self.moving])

    def _rows(self, amounts: Sequence[Number]) -> Array:
        """(K, N), amounts that are each a float or (N,)."""
        out = np.empty((len(amounts), len(self.poses)))
        for row, amount in zip(out, amounts, strict=True):
            row[:] = amount
        return out

    def _moved(self, iterate: SlotIterate, amounts: Array, tau: list[Number], number: int) -> SlotIterate:
        """The iterate with the moving slots at other amounts (M, N)."""
        slots, angles = list(iterate.slots), list(iterate.angles)
        for k, amount in zip(self.moving, amounts[:, 0].tolist() if amounts.shape[1] == 1 else amounts, strict=True):
            slots[k] = amount
            if self.model.chain.slots[k].rotates:
                angles[k] = trig_of(amount)
        for k, leader, ratio in self.model.chain.couplings:
            angles[k] = trig_of(slots[k] + ratio * slots[leader])
        return SlotIterate(slots, angles, tau, number)

    def _with_slow(self, iterate: SlotIterate, slow: NDArray[np.int64]) -> SlotIterate:
        """The settled poses, and the slow ones settled alone."""
        poses = replace(self.poses, number=np.array(self.poses.names(np.arange(len(self.poses))))).take(slow)

        def part(amounts: Iterable[Number]) -> list[Number]:
            return [amounts_at(a, slow) for a in amounts]

        def merged(amount: Number, other: Number) -> Number:
            whole = np.array(np.broadcast_to(amount, len(self.poses)))
            whole[slow] = other
            return whole

        applied = dict(zip(self.applied, part(self.applied.values()), strict=True))
        first = part(iterate.slots)
        alone = EquilibriumSearch(self.model, poses, part(self.rigid), applied, self.tolerance)
        settled = alone.settled(SlotIterate(first, trig(self.model.chain, first), [], iterate.number))
        slots, tau = list(iterate.slots), [merged(a, b) for a, b in zip(iterate.tau, settled.tau, strict=True)]
        for k in self.model.binding.moving:
            slots[k] = merged(iterate.slots[k], settled.slots[k])
        return SlotIterate(slots, trig(self.model.chain, slots), tau, settled.number)


def amount_at(amount: Number, row: int) -> float:
    """An amount, a float or (N,), at one pose."""
    return amount if isinstance(amount, float) else float(amount[row if len(amount) > 1 else 0])


def amounts_at(amount: Number, rows: NDArray[np.int64]) -> Number:
    """An amount, a float or (N,), at some poses; a float for one."""
    if len(rows) == 1:
        return amount_at(amount, int(rows[0]))
    return amount[rows] if isinstance(amount, np.ndarray) and len(amount) > 1 else amount


@dataclass(frozen=True, eq=False)
class FixedPointStep:
    """Amounts (M, N) or (M,) of one pose, and the fixed-point step from there."""

    amounts: Array
    step: Array

    def accelerated(self, before: FixedPointStep | None) -> Array:
        """The step of Anderson's (1965) method with one step of memory: a secant along the last change, per pose."""
        if before is None:
            return self.step
        change = self.step - before.step
        # share γ minimises |f_k − γ (f_k − f_(k−1))|: the residual if it were linear between the last two iterates
        share = (self.step * change).sum(axis=0) / (TINY + (change * change).sum(axis=0))
        return np.asarray(self.step - share * (self.amounts - before.amounts + change))


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Aitken relaxation: the factor (N,) applied to a step (M, N) of each pose."""

    factor: Array
    step: Array

    @classmethod
    def after(cls, before: Relaxation | None, step: Array) -> Relaxation:
        """The next factor: exact if the residual were linear along the last step. Twice the last one where steps grow:
        they lead away from where nothing rests, as where the two ends of a play have just become one."""
        if before is None:
            return cls(np.full(step.shape[1], 0.5), step)
        change = step - before.step
        size = (change * change).sum(axis=0)
        # Irons & Tuck 1969: ω_k = −ω_(k−1) f_(k−1)·(f_k − f_(k−1)) / |f_k − f_(k−1)|²
        factor = -before.factor * (before.step * change).sum(axis=0) / np.where(size > 0, size, 1.0)
        factor = np.where(factor > 0, factor, 2.0 * before.factor)
        return cls(np.clip(factor, SMALLEST_FACTOR, LARGEST_FACTOR), step)
