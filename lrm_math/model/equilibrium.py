"""Elastic equilibrium: the slots' amounts at which elastic motions and loads agree, and the TCP there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Number, chain_of, pull_back, trig
from lrm_math.kinematics.history import LoadedArm
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import ends_of, magnitude, maximum
from lrm_math.model.effect_binding import distortion
from lrm_math.model.fixed_point import EquilibriumSearch, NewtonPreconditioner, SlotIterate, amount_at, amounts_at
from lrm_math.model.model import Model

TOLERANCE = 1e-9
"""m: the iteration ends when no TCP can still move more than this."""
LARGEST_MOTION = 0.5
"""rad: larger elastic rotations are refused, since the effects' formulas hold for small motions."""
LARGEST_SLIDE = 0.05
"""m: likewise of elastic translations."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The elastic equilibrium of N poses.

    Attributes:
        slots: amount of every slot of the chain, nominal + all effects, each a float or (N,) (rad, m).
        tau: load on each slot of `model.load_slots`, N·m (N along a translation), each (N,).
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

    def take(self, rows: NDArray[np.int64]) -> Equilibrium:
        """The poses of these rows; of one alone all numbers are floats."""
        slots, tau = (tuple(amounts_at(a, rows) for a in amounts) for amounts in (self.slots, self.tau))
        tcp, true = self.tcp[rows], self.true_tcp[rows]
        return Equilibrium(self.model, self.poses.take(rows), slots, tau, tcp, true, self.iterations)

    @cached_property
    def weights(self) -> tuple[statics.Weight, ...]:
        """Every body's mass and centre of mass, payload and effects included."""
        return self.model.weights(self.poses.carried)

    @cached_property
    def gravity(self) -> statics.Gravity:
        """Gravity in the frame of measurement, effects included (m/s²)."""
        return self.model.gravity(self.poses)

    def loads_on(self, slots: Sequence[int]) -> Array:
        """(N, len(slots)), gravity's load on slots given by number, ascending (N·m, or N along a translation)."""
        chain = self.model.chain
        loads = statics.loads(chain, self.slots, trig(chain, self.slots), self.weights, self.gravity, slots)
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


def solve_equilibrium(
    model: Model,
    poses: Poses,
    start: Equilibrium | Sequence[Number] | None = None,
    tolerance: float = TOLERANCE,
    preconditioner: NewtonPreconditioner | None = None,
) -> Equilibrium:
    """The elastic equilibrium by fixed-point iteration (thesis Figure 4.4), accelerated (Anderson 1965, depth one).

    Poses that do not converge are relaxed in the end by Aitken's method for vectors (Irons & Tuck 1969). One pose
    alone is computed with Python's floats, many with numpy's arrays: each is many times faster so.

    Args:
        start: an equilibrium of the same poses for nearby parameters to start from, or amounts of all slots (rad, m;
            each a float or (N,)).
        tolerance: m, see `TOLERANCE`.
        preconditioner: of an equilibrium of the same poses nearby, if it is known.

    Raises:
        NoEquilibrium: poses that do not converge, or where a slot deflects by more than `LARGEST_MOTION`, or
            `LARGEST_SLIDE`.
    """
    if model.remembers and poses.history is not None and poses.history.visits.bore is None:
        poses = with_borne_loads(model, poses)
    rigid = rigid_amounts(model, poses)
    first = list(rigid)
    near = start.slots if isinstance(start, Equilibrium) else start or rigid
    for k in model.binding.moving:
        first[k] = near[k]
    search = EquilibriumSearch(model, poses, rigid, effect_loads(model, poses), tolerance, preconditioner)
    settled = search.settled(SlotIterate(first, trig(model.chain, first), [], 0))
    _check_small(model, poses, settled.slots, rigid)
    true = _columns(pull_back(model.chain, settled.slots, settled.angles), len(poses))
    measured = _measured(model, poses, true)
    return Equilibrium(model, poses, tuple(settled.slots), tuple(settled.tau), measured, true, settled.number)


def with_borne_loads(model: Model, poses: Poses) -> Poses:
    """The poses, with the loads before them those that the arm of this model bears at all visits of their history.

    What a few poses of many need was found for all of them before, or is found at the commands alone. Poses without a
    history stay as they are; where the arm has no equilibrium at some visit, the loads are those of the nominal one.
    """
    if (history := poses.history) is None:
        return poses
    visits, order = history.visits, history.order
    if order is None and visits.bore is not None:
        return poses
    loaded_history = history if visits.bore else history.borne_by(visits.nominal(chain_of(model.arm)))
    if order is not None:
        visited = replace(poses, history=loaded_history).take(order)
    else:
        rows = np.arange(len(visits.q))
        visited = Poses(visits.q, visits.payload, gravity=visits.gravity, history=replace(loaded_history, row=rows))
    try:
        settled = solve_equilibrium(model, visited)
    except NoEquilibrium:
        return replace(poses, history=loaded_history)
    arm = LoadedArm(model.chain, settled.slots, settled.weights, settled.gravity)
    return replace(poses, history=loaded_history.borne_by(arm))


def measured_range(settled: Equilibrium) -> MeasuredRange:
    """The range of some poses, of the loads at them and of the TCP."""
    poses, chain = settled.poses, settled.model.chain
    slots = sorted({*settled.model.load_slots, *chain.joint_slots})
    loads = {chain.slots[k].key: ends_of(column) for k, column in zip(slots, settled.loads_on(slots).T, strict=True)}
    for k, load in zip(settled.model.load_slots, settled.tau, strict=True):
        loads[chain.slots[k].key] = ends_of(load)
    t, running = (None if of is None else ends_of(of) for of in (poses.t, poses.running))
    tcp = tuple(map(ends_of, settled.true_tcp.T))
    centre = tuple(settled.true_tcp.mean(axis=0).tolist())
    return MeasuredRange(tuple(map(ends_of, poses.q.T)), ends_of(poses.payload), loads, t, running, tcp, centre)


def _columns(components: Sequence[Number], count: int) -> Array:
    """(N, 3) from three components, each a float or (N,)."""
    if count == 1:
        return np.array([[amount_at(c, 0) for c in components]])
    return np.stack([np.broadcast_to(c, count) for c in components], axis=1)


def _check_small(model: Model, poses: Poses, slots: list[Number], rigid: list[Number]) -> None:
    chain = model.chain
    for k in model.binding.moving:
        motion = magnitude(slots[k] - rigid[k])
        largest = LARGEST_MOTION if chain.slots[k].rotates else LARGEST_SLIDE
        if maximum(motion) > largest:
            far, most = np.flatnonzero(np.broadcast_to(motion, len(poses)) > largest), maximum(motion)
            said = f"{math.degrees(most):.0f} deg" if chain.slots[k].rotates else f"{1e3 * most:.0f} mm"
            raise NoEquilibrium(poses.names(far), f"{chain.slots[k].key} gives way by {said}")


def rigid_amounts(model: Model, poses: Poses) -> list[Number]:
    """Amount of every slot (rad, m) of the rigid arm: nominal dimensions, the command, effects without loads."""
    slots: list[Number] = list(model.binding.constants)
    angles = [poses.angle(joint) for joint in range(model.arm.dof)]
    for k, angle in zip(model.chain.joint_slots, angles, strict=True):
        slots[k] = slots[k] + angle
    for effect in model.binding.rigid:
        for k, amount in effect.amounts(poses, []):
            slots[k] = slots[k] + amount
    return slots


def effect_loads(model: Model, poses: Poses) -> dict[int, Number]:
    """Loads that effects put on slots (N·m), by number of the slot."""
    out: dict[int, Number] = {}
    for bound in model.binding.loading:
        for k, load in bound.amounts(poses, []):
            out[k] = out.get(k, 0.0) + load
    return out


def _measured(model: Model, poses: Poses, tcp: Array) -> Array:
    measured = tcp
    for bound in model.binding.distorting:
        added = distortion(bound, bound.at(poses), list(tcp.T))
        measured = np.asarray(measured + _columns(added, len(tcp)))
    return measured


def batch_equilibrium(
    model: Model, poses: Poses, start: Sequence[Number] | None = None, tolerance: float = TOLERANCE
) -> tuple[Equilibrium, NDArray[np.int64]]:
    """Equilibria of the poses that settle, and their rows; arguments as of `equilibrium`."""
    rows = np.arange(len(poses))
    while True:
        try:
            some = poses.take(rows)
            begin = None if start is None else [amounts_at(a, rows) for a in start]
            return solve_equilibrium(model, some, begin, tolerance), rows
        except NoEquilibrium as error:
            names = some.names(np.arange(len(rows)))
            rows = rows[~np.isin(names, error.poses)]
