"""Everything that the methods of the calibrated inverse precompute from one deployed model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.answer import JointLimits
from lrm_math.ik.equivalent_arm import SLACK, EquivalentArm, SeedBatch
from lrm_math.ik.goal import Goal
from lrm_math.ik.joint_laws import JointLaws
from lrm_math.ik.library import PoseLibrary
from lrm_math.ik.library_seeds import LibrarySeeds
from lrm_math.ik.linkage import Linkage
from lrm_math.ik.newton import EVERY_BRANCH, JointBounds, NewtonBatch, StoppingRule, Target, newton_solve
from lrm_math.ik.nominal import solver_of
from lrm_math.ik.scalar_newton import ScalarNewton
from lrm_math.ik.scalar_pose import SinglePose
from lrm_math.ik.solver import NominalSolver
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

AT_LIMIT = 1e-9
"""rad: a command this far beyond a limit is at the limit."""
MOST_SIDE_CHANGES = 2


@dataclass(frozen=True, slots=True)
class IkQuery:
    """The goal, the payload (kg), and the present joint angles (rad), if known."""

    goal: Goal
    payload: float = 0.0
    near: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class CommandBatch:
    """Commands that a method found.

    `q`: (K, n), rad, whatever the limits. `reached`: states of the arm at the goal. `direction`: (K, n), the side that
    each joint arrives from (see `Poses`); zeros where it is not known. `detour`: (K, n), where a move straight from
    `near` would arrive from the other side. `steps`: of the method. `error`: m, before the final Newton's method, if
    the method has one.
    """

    q: Array
    reached: NewtonBatch
    direction: Array
    detour: NDArray[np.bool_]
    steps: int
    error: float | None = None

    def joined(self, others: CommandBatch) -> CommandBatch:
        """Concatenation, in this order."""
        q, direction = (np.concatenate(pair) for pair in ((self.q, others.q), (self.direction, others.direction)))
        detour, steps = np.concatenate([self.detour, others.detour]), self.steps + others.steps
        return CommandBatch(q, self.reached.joined(others.reached), direction, detour, steps, self.error)


@dataclass(frozen=True, eq=False)
class Stalled:
    """A method that ended away from the goal.

    `q`: its last command (rad). `errors`: m, the distance from the goal after each step.
    """

    q: tuple[float, ...]
    errors: tuple[float, ...]


class Method(Protocol):
    """A method of the calibrated inverse."""

    @property
    def name(self) -> str:
        """Name in replies."""

    def find(self, context: SolverContext, query: IkQuery) -> CommandBatch | Stalled | None:
        """Commands for one goal; None where the method finds none."""


@dataclass(frozen=True, eq=False)
class SolverContext:
    """A deployed model (see `joint_laws.deployed`) and what follows from it alone."""

    model: Model

    @cached_property
    def joint_laws(self) -> JointLaws:
        """From true joint angles to commands."""
        return JointLaws(self.model)

    @property
    def linkage(self) -> Linkage:
        """The calibrated arm, reduced to its moving slots."""
        return self.joint_laws.linkage

    @cached_property
    def limits(self) -> JointLimits:
        """Of the commands."""
        return JointLimits.of(self.model.arm)

    @cached_property
    def nominal_solver(self) -> NominalSolver:
        """Inverse of the nominal arm, limits widened by `SLACK`."""
        joints = (replace(j, lower=j.lower - SLACK, upper=j.upper + SLACK) for j in self.model.arm.joints)
        return solver_of(replace(self.model.arm, joints=tuple(joints)))

    @cached_property
    def equivalent_arm(self) -> EquivalentArm:
        """An arm close to the calibrated one, with a closed form."""
        return EquivalentArm.of(self.model)

    @cached_property
    def library(self) -> PoseLibrary:
        """Settled poses all over the range."""
        return PoseLibrary.of(self.model, self.linkage.slots.tolist())

    @cached_property
    def library_seeds(self) -> LibrarySeeds:
        """Ranked library seeds for full poses."""
        return LibrarySeeds.of(self.library, self.linkage, self.bounds)

    def poses(self, query: IkQuery, q: Array, direction: Array | None = None) -> Poses:
        """Commands q (K, n) with the payload of a query."""
        return (SinglePose if len(q) == 1 else Poses)(q, np.full(len(q), query.payload), direction)

    def start_amounts(self, query: IkQuery, seeds: SeedBatch) -> Array:
        """Slot amounts (K, V) at the equivalent arm's branches, and at the present angles, if known."""
        return self.amounts_at(seeds.q if query.near is None else np.vstack([seeds.q, query.near]))

    def amounts_at(self, q: Array) -> Array:
        """Slot amounts (K, V) at true joint angles (K, n), other slots at their library means."""
        start = np.repeat(self._mean_amounts[None], len(q), axis=0)
        start[:, self.linkage.joints] = self.zero + q
        return start

    def slot_amounts(self, rest: Equilibrium) -> Array:
        """(K, V), amounts of the moving slots at rest (rad, m)."""
        return np.array([np.broadcast_to(rest.slots[k], len(rest.poses)) for k in self.linkage.slots]).T

    def chain_amounts(self, amounts: Array) -> list[Number]:
        """Amounts of all slots of the chain, from those of the moving ones (K, V); floats for a single pose."""
        out: list[Number] = list(self.model.binding.constants)
        for k, amount in zip(self.linkage.slots.tolist(), amounts.T, strict=True):
            out[k] = float(amount[0]) if len(amounts) == 1 else amount
        return out

    @cached_property
    def _mean_amounts(self) -> Array:
        """(V,), mean slot amounts of the library (rad, m)."""
        return np.asarray(self.library.amounts.mean(axis=0))

    @cached_property
    def _nonlinear_bound(self) -> float:
        """rad, bound on the share of nonlinear effects in a command: twice the largest of the library."""
        laws, amounts = self.joint_laws, self.library.amounts
        tau = laws.linkage.loads(laws.linkage.forward(amounts), laws.mass_moments(0.0)).tau
        return 2.0 * float(np.abs(laws.linear_command(tau, amounts[:, laws.linkage.joints]) - self.library.q).max())

    @cached_property
    def scalar_newton(self) -> ScalarNewton | None:
        """Newton from one start at a time; None for models that are only solved in batches."""
        return ScalarNewton.of(self.joint_laws, self.bounds, self._nonlinear_bound)

    def solve_from(
        self, query: IkQuery, start: Array, stopping: StoppingRule = EVERY_BRANCH
    ) -> tuple[CommandBatch, NewtonBatch]:
        """Newton's method from slot amounts (K, V): commands of the converged candidates, and all candidates."""
        laws, joints = self.joint_laws, self.linkage.joints
        goal, scalar, masses = query.goal, self.scalar_newton, laws.mass_moments(query.payload)
        if scalar is not None and goal.rotation is not None and stopping.singly:
            reached = scalar.solve_each(goal.rotation, goal.position, masses, start.tolist(), stopping)
        else:
            poses = self.poses(query, start[:, joints] - self.zero)
            reached = newton_solve(laws, Target.of(goal), masses, poses, start, self.bounds, stopping)
        linear = laws.linear_command(reached.tau, reached.amounts[:, joints])
        near_limits = reached.converged & self.bounds.contains(linear, SLACK)
        return self.commands(query, reached.take(near_limits)), reached

    def commands(self, query: IkQuery, reached: NewtonBatch) -> CommandBatch:
        """Commands that bring the arm to the states reached; sides of arrival follow from the present angles."""
        arrived = reached.amounts[:, self.linkage.joints]

        def command(q: Array, side: Array | None) -> Array:
            return self.joint_laws.command(self.poses(query, q, side), reached.tau, arrived)

        q = command(arrived - self.zero, None)
        if query.near is None:
            return CommandBatch(q, reached, np.zeros_like(q), np.zeros(q.shape, dtype=bool), reached.steps)
        side = np.sign(q - query.near)
        for _ in range(MOST_SIDE_CHANGES):
            q = command(q, side)
            wrong = np.sign(q - query.near) != side
            if not wrong.any():
                return CommandBatch(q, reached, side, wrong, reached.steps)
            side = np.where(wrong, -side, side)
        q = command(q, side)
        return CommandBatch(q, reached, side, np.sign(q - query.near) != side, reached.steps)

    @cached_property
    def bounds(self) -> JointBounds:
        """The limits as arrays."""
        return JointBounds(np.array(self.limits.lower), np.array(self.limits.upper))

    def at_rest(self, query: IkQuery, q: Array, steps: int) -> CommandBatch:
        """Commands (K, n) as they are, and the equilibria there. Raises `NoEquilibrium`."""
        amounts = self.slot_amounts(solve_equilibrium(self.model, self.poses(query, q)))
        state = self.linkage.forward(amounts)
        tau = self.linkage.loads(state, self.joint_laws.mass_moments(query.payload)).tau
        residual = np.linalg.norm(state.tcp[:, :3, 3] - np.array(query.goal.position), axis=1)
        reached = NewtonBatch(amounts, tau, residual, state.tcp, np.zeros(len(q), dtype=bool), steps)
        unknown = np.zeros_like(q)
        return CommandBatch(q, reached, unknown, unknown > 0.0, steps)

    @cached_property
    def zero(self) -> Array:
        """(n,), true joint angles at command zero without load, constant effects included (rad)."""
        return np.asarray(self.joint_laws.constants[self.linkage.joints])

    def within_limits(self, found: CommandBatch) -> NDArray[np.bool_]:
        """(K,), which commands keep the limits."""
        return self.bounds.contains(found.q, AT_LIMIT)
