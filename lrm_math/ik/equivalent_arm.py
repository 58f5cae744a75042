"""An arm as much like the calibrated one as a closed form allows: where Newton's method starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, pi

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, Placement
from lrm_math.arrays import Array
from lrm_math.ik.answer import Limits
from lrm_math.ik.goal import Goal
from lrm_math.ik.nominal import solver_of
from lrm_math.ik.pieper import pieper_form
from lrm_math.ik.scalar_closed_form import OneGoal, one_goal_solver
from lrm_math.ik.screw_axes import lines_of
from lrm_math.ik.solver import NominalSolver
from lrm_math.model.model import Model

SLACK = 0.4
"""rad: joints sag and play by less than this, so that seeds need not be sought further outside the limits."""
PULLED = (0.0, 0.01, 0.03, 0.07, 0.15)
"""Shares of the way to the arm's middle by which goals at the edge of reach are pulled in."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Angles `q` (K, n) of the look-alike (rad) that take the goal or come near.

    `numbers`: of the closed form's branches, or -1.
    """

    q: Array
    numbers: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Likeness:
    """The look-alike's inverse. Its joint angles are counted from where the calibrated arm's joints really are.

    `one_goal`, `almost`: for one pose; the other one also answers goals that it misses (see `one_goal_solver`).
    `anywhere`: as `almost`, whatever the limits.
    `middle`: (3,), m, the point that goals out of reach are pulled towards: the second joint's origin.
    """

    arm: Arm
    solver: NominalSolver
    one_goal: OneGoal | None
    almost: OneGoal | None
    anywhere: OneGoal | None
    middle: Array

    @classmethod
    def of(cls, model: Model) -> Likeness:
        """For a model."""
        arm = _alike(model)
        form = pieper_form(lines_of(arm))
        limits, all_round = Limits.of(arm), Limits((-pi,) * arm.dof, (pi,) * arm.dof)
        one_goal, almost, anywhere = (
            None if form is None else one_goal_solver(form, window, missed)
            for window, missed in ((limits, 0.0), (limits, inf), (all_round, inf))
        )
        return cls(arm, solver_of(arm), one_goal, almost, anywhere, lines_of(arm).point[min(1, arm.dof - 1)])

    def seeds(self, goal: Goal, near: Sequence[float] | None) -> Seeds:
        """Angles that joints may have at a goal, limits widened by `SLACK`; perhaps none.

        Beyond the look-alike's reach they are those that come near it; without a closed form for one pose, those that
        take it pulled inwards.
        """
        if goal.rotation is None:
            branches = self.solver.lesser(goal, near)
            return _seeds([(-1, branch.q) for branch in branches], self.arm.dof)
        for solver in (self.one_goal, self.almost):
            if solver is not None and (found := solver(goal.rotation, goal.position)):
                return _seeds(found, self.arm.dof)
        return self.pulled(goal, ()) if self.one_goal is None else _seeds((), self.arm.dof)

    def pulled(self, goal: Goal, known: Sequence[int]) -> Seeds:
        """For a pose, branches other than those `known` by number, each with the goal pulled in as little as can be.

        Beyond the look-alike's reach, and for branches that end near the goal, which the calibrated arm may still have.
        """
        shares = np.array(PULLED)[:, None]
        positions = (1.0 - shares) * goal.position + shares * self.middle
        batch = self.solver.solve_batch(positions, np.broadcast_to(np.array(goal.rotation), (len(positions), 3, 3)))
        numbers = [k for k in np.flatnonzero(batch.valid.any(axis=0)).tolist() if k not in known]
        rows = batch.valid.argmax(axis=0)[numbers]
        return Seeds(batch.q[rows, numbers], tuple(numbers))


def _seeds(found: Sequence[tuple[int, tuple[float, ...]]], dof: int) -> Seeds:
    return Seeds(np.array([q for _, q in found]).reshape(-1, dof), tuple(number for number, _ in found))


def _alike(model: Model) -> Arm:
    """The arm with every corrected angle, and the lengths that the drawing has; other lengths would part its axes."""
    amounts = dict(zip((slot.key for slot in model.chain.slots), model.wiring.steady, strict=True))

    def placement(place: str) -> Placement:
        return Placement(*(amounts[f"{place}.{name}"] for name in ("x", "y", "z", "alpha", "beta", "gamma")))

    def length(place: str, name: str, nominal: float) -> float:
        return amounts[f"{place}.{name}"] if nominal else 0.0

    def joint(place: str, drawn: Joint) -> Joint:
        return replace(
            drawn,
            theta=amounts[f"{place}.theta"],
            d=length(place, "d", drawn.d),
            a=length(place, "a", drawn.a),
            alpha=amounts[f"{place}.alpha"],
            extra_z=None if drawn.extra_z is None else length(place, "extra_z", drawn.extra_z),
            lower=drawn.lower - SLACK,
            upper=drawn.upper + SLACK,
        )

    joints = tuple(joint(f"joint{i + 1}", drawn) for i, drawn in enumerate(model.arm.joints))
    return replace(model.arm, base=placement(BASE), joints=joints, tool=placement(TOOL))
