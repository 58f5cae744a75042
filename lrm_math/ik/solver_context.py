"""What every method of the calibrated inverse needs of one deployed model, reckoned once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.answer import Limits
from lrm_math.ik.equivalent_arm import SLACK, Likeness, Seeds
from lrm_math.ik.goal import Goal
from lrm_math.ik.joint_laws import Compensation
from lrm_math.ik.library import Library
from lrm_math.ik.library_seeds import Leaps
from lrm_math.ik.newton import EVERY_BRANCH, Aim, Band, Effort, Reached, reach
from lrm_math.ik.nominal import solver_of
from lrm_math.ik.scalar_newton import OneStart
from lrm_math.ik.scalar_pose import OnePose
from lrm_math.ik.solver import NominalSolver
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import settle
from lrm_math.model.model import Model

AT_LIMIT = 1e-9
"""rad: a command this far beyond a limit is at the limit."""
MOST_TURNS = 2


@dataclass(frozen=True, slots=True)
class Ask:
    """One question: the goal, the load (kg), and the angles (rad) that the arm stands at, if known."""

    goal: Goal
    payload: float = 0.0
    near: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class Found:
    """Commands that a method proposes, the ways they were found included.

    Attributes:
        q: (K, n), rad, whatever the limits. `reached`: where the arm then is, at the goal.
        direction: (K, n), the side that each joint arrives from (see `Poses`); zeros where it is not known.
        detour: (K, n), where a move straight from `near` would arrive from the other side.
        steps: how many steps the method took.
        error: m, what was left of the goal before the polish, if the method has one.
    """

    q: Array
    reached: Reached
    direction: Array
    detour: NDArray[np.bool_]
    steps: int
    error: float | None = None

    def joined(self, others: Found) -> Found:
        """These and others, in this order."""
        q, direction = (np.concatenate(pair) for pair in ((self.q, others.q), (self.direction, others.direction)))
        detour = np.concatenate([self.detour, others.detour])
        return Found(q, self.reached.joined(others.reached), direction, detour, self.steps + others.steps, self.error)


@dataclass(frozen=True, eq=False)
class Stalled:
    """A method that ended away from the goal.

    `q`: its last command (rad). `errors`: m, the distance from the goal after each step.
    """

    q: tuple[float, ...]
    errors: tuple[float, ...]


class Method(Protocol):
    """A way to solve the calibrated inverse."""

    @property
    def name(self) -> str:
        """What replies call it."""

    def find(self, deployment: Deployment, ask: Ask) -> Found | Stalled | None:
        """Commands for one goal; None where the method finds no way to it."""


@dataclass(frozen=True, eq=False)
class Deployment:
    """A model as the rover uses it: effects that can be compensated only, and no rounding."""

    model: Model

    @cached_property
    def compensation(self) -> Compensation:
        """From real angles to commands."""
        return Compensation(self.model)

    @cached_property
    def limits(self) -> Limits:
        """Of the commands."""
        return Limits.of(self.model.arm)

    @cached_property
    def drawing(self) -> NominalSolver:
        """The inverse of the arm as drawn, limits widened by `SLACK`."""
        joints = (replace(j, lower=j.lower - SLACK, upper=j.upper + SLACK) for j in self.model.arm.joints)
        return solver_of(replace(self.model.arm, joints=tuple(joints)))

    @cached_property
    def likeness(self) -> Likeness:
        """An arm like the calibrated one, with a closed form."""
        return Likeness.of(self.model)

    @cached_property
    def library(self) -> Library:
        """Commands all over the range, and where the arm is then."""
        return Library.of(self.model, self.compensation.linkage.slots.tolist())

    @cached_property
    def leaps(self) -> Leaps:
        """Starts of last resort for whole poses."""
        return Leaps.of(self.library, self.compensation.linkage, self.band)

    def poses(self, ask: Ask, q: Array, direction: Array | None = None) -> Poses:
        """Commands q (K, n) with the load of a question."""
        return (OnePose if len(q) == 1 else Poses)(q, np.full(len(q), ask.payload), direction)

    def start_at(self, ask: Ask, seeds: Seeds) -> Array:
        """Amounts (K, V) of the moving slots at the look-alike's branches, and where the arm stands, if known."""
        return self.at(seeds.q if ask.near is None else np.vstack([seeds.q, ask.near]))

    def at(self, q: Array) -> Array:
        """Amounts (K, V) of the moving slots at angles of the look-alike's joints (K, n), the others as on average."""
        start = np.repeat(self._resting[None], len(q), axis=0)
        start[:, self.compensation.linkage.joints] = self.zero + q
        return start

    @cached_property
    def _resting(self) -> Array:
        """(V,), what the moving slots have on average over the library (rad, m)."""
        return np.asarray(self.library.amounts.mean(axis=0))

    @cached_property
    def _bent(self) -> float:
        """What effects that are not linear make of a command at most, going by twice what the library shows (rad)."""
        c, amounts = self.compensation, self.library.amounts
        tau = c.linkage.loads(c.linkage.place(amounts), c.burden(0.0)).tau
        return 2.0 * float(np.abs(c.roughly(tau, amounts[:, c.linkage.joints]) - self.library.q).max())

    @cached_property
    def one_start(self) -> OneStart | None:
        """What one start at a time is solved with; None for models that are only solved in batches."""
        return OneStart.of(self.compensation, self.band, self._bent)

    def solve_from(self, ask: Ask, start: Array, effort: Effort = EVERY_BRANCH) -> tuple[Found, Reached]:
        """Newton's method from amounts (K, V) of the moving slots: commands for those that met the goal, and all."""
        compensation, joints = self.compensation, self.compensation.linkage.joints
        burden = compensation.burden(ask.payload)
        goal, one = ask.goal, self.one_start
        if one is not None and goal.rotation is not None and effort.singly:
            reached = one.reach_all(goal.rotation, goal.position, burden, start.tolist(), effort)
        else:
            poses = self.poses(ask, start[:, joints] - self.zero)
            reached = reach(compensation, Aim.of(ask.goal), burden, poses, start, self.band, effort)
        roughly = compensation.roughly(reached.tau, reached.amounts[:, joints])
        plausible = reached.met & self.band.holds(roughly, SLACK)
        return self.commands(ask, reached.take(plausible)), reached

    def commands(self, ask: Ask, reached: Reached) -> Found:
        """What to command so that the arm is where it was wanted; whence it arrives follows from where it is now."""
        arrived = reached.amounts[:, self.compensation.linkage.joints]

        def command(q: Array, side: Array | None) -> Array:
            return self.compensation.command(self.poses(ask, q, side), reached.tau, arrived)

        q = command(arrived - self.zero, None)
        if ask.near is None:
            return Found(q, reached, np.zeros_like(q), np.zeros(q.shape, dtype=bool), reached.steps)
        side = np.sign(q - ask.near)
        for _ in range(MOST_TURNS):
            q = command(q, side)
            wrong = np.sign(q - ask.near) != side
            if not wrong.any():
                return Found(q, reached, side, wrong, reached.steps)
            side = np.where(wrong, -side, side)
        q = command(q, side)
        return Found(q, reached, side, np.sign(q - ask.near) != side, reached.steps)

    @cached_property
    def band(self) -> Band:
        """The limits as arrays."""
        return Band(np.array(self.limits.lower), np.array(self.limits.upper))

    def standing(self, ask: Ask, q: Array, steps: int) -> Found:
        """Commands (K, n) as they are, and where the arm then rests. Raises `NotSettled`."""
        poses, goal = self.poses(ask, q), np.array(ask.goal.position)
        rest = settle(self.model, poses)
        slots = self.compensation.linkage.slots
        amounts = np.array([np.broadcast_to(rest.slots[k], len(q)) for k in slots]).T
        placed = self.compensation.linkage.place(amounts)
        tau = self.compensation.linkage.loads(placed, self.compensation.burden(ask.payload)).tau
        miss = np.linalg.norm(placed.tcp[:, :3, 3] - goal, axis=1)
        reached = Reached(amounts, tau, miss, placed.tcp, np.zeros(len(q), dtype=bool), steps)
        unknown = np.zeros_like(q)
        return Found(q, reached, unknown, unknown > 0.0, steps)

    @cached_property
    def zero(self) -> Array:
        """(n,), the angle that each joint really has at command zero without load, constant effects included (rad)."""
        return np.asarray(self.compensation.steady[self.compensation.linkage.joints])

    def usable(self, found: Found) -> NDArray[np.bool_]:
        """(K,), which commands keep the limits."""
        return self.band.holds(found.q, AT_LIMIT)
