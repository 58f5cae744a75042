"""An arm close to the calibrated one that has a closed form: seeds for Newton's method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, pi

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, Placement
from lrm_math.arrays import Array
from lrm_math.ik.answer import JointLimits
from lrm_math.ik.goal import Goal
from lrm_math.ik.nominal import solver_of
from lrm_math.ik.pieper import pieper_form
from lrm_math.ik.scalar_closed_form import ScalarClosedForm, scalar_closed_form
from lrm_math.ik.screw_axes import screw_axes_of
from lrm_math.ik.solver import NominalSolver
from lrm_math.model.model import Model

SLACK = 0.4
"""rad: joints sag and play by less than this, so that seeds need not be sought further outside the limits."""
RETRACTIONS = (0.0, 0.01, 0.03, 0.07, 0.15)
"""Shares of the distance to the arm's middle by which goals at the edge of the workspace are retracted."""


@dataclass(frozen=True, eq=False)
class SeedBatch:
    """Angles `q` (K, n) of the equivalent arm (rad) at or near the goal.

    `numbers`: of the closed form's branches, or -1.
    """

    q: Array
    numbers: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class EquivalentArm:
    """Inverse of the equivalent arm. Its joint angles are counted as the calibrated arm's true angles.

    `scalar_solver`, `clamped`: for one pose, without and with missed roots (see `scalar_closed_form`).
    `anywhere`: as `clamped`, without limits.
    `middle`: (3,), m, the point that goals out of reach are retracted towards: the second joint's origin.
    """

    arm: Arm
    solver: NominalSolver
    scalar_solver: ScalarClosedForm | None
    clamped: ScalarClosedForm | None
    anywhere: ScalarClosedForm | None
    middle: Array

    @classmethod
    def of(cls, model: Model) -> EquivalentArm:
        """For a model."""
        arm = _equivalent_arm(model)
        form = pieper_form(screw_axes_of(arm))
        limits, all_round = JointLimits.of(arm), JointLimits((-pi,) * arm.dof, (pi,) * arm.dof)
        scalar_solver, clamped, anywhere = (
            None if form is None else scalar_closed_form(form, window, missed)
            for window, missed in ((limits, 0.0), (limits, inf), (all_round, inf))
        )
        return cls(arm, solver_of(arm), scalar_solver, clamped, anywhere, screw_axes_of(arm).point[min(1, arm.dof - 1)])

    def seeds(self, goal: Goal, near: Sequence[float] | None) -> SeedBatch:
        """Angles near a goal, limits widened by `SLACK`; perhaps none.

        Beyond the equivalent arm's reach those that come near; without a scalar closed form, those of retracted goals.
        """
        if goal.rotation is None:
            branches = self.solver.partial_branches(goal, near)
            return _seeds([(-1, branch.q) for branch in branches], self.arm.dof)
        for solver in (self.scalar_solver, self.clamped):
            if solver is not None and (found := solver(goal.rotation, goal.position)):
                return _seeds(found, self.arm.dof)
        return self.retracted(goal, ()) if self.scalar_solver is None else _seeds((), self.arm.dof)

    def retracted(self, goal: Goal, known: Sequence[int]) -> SeedBatch:
        """For a pose, branches not `known` by number, each with the goal retracted as little as possible.

        The calibrated arm may have them where the equivalent arm does not reach, or its branches end near the goal.
        """
        shares = np.array(RETRACTIONS)[:, None]
        positions = (1.0 - shares) * goal.position + shares * self.middle
        batch = self.solver.solve_batch(positions, np.broadcast_to(np.array(goal.rotation), (len(positions), 3, 3)))
        numbers = [k for k in np.flatnonzero(batch.valid.any(axis=0)).tolist() if k not in known]
        rows = batch.valid.argmax(axis=0)[numbers]
        return SeedBatch(batch.q[rows, numbers], tuple(numbers))


def _seeds(found: Sequence[tuple[int, tuple[float, ...]]], dof: int) -> SeedBatch:
    return SeedBatch(np.array([q for _, q in found]).reshape(-1, dof), tuple(number for number, _ in found))


def _equivalent_arm(model: Model) -> Arm:
    """The arm with corrected angles and corrected nonzero lengths; further lengths would separate its axes."""
    amounts = dict(zip((slot.key for slot in model.chain.slots), model.binding.constants, strict=True))

    def placement(place: str) -> Placement:
        return Placement(*(amounts[f"{place}.{name}"] for name in ("x", "y", "z", "alpha", "beta", "gamma")))

    def length(place: str, name: str, nominal: float) -> float:
        return amounts[f"{place}.{name}"] if nominal else 0.0

    def joint(place: str, nominal_joint: Joint) -> Joint:
        return replace(
            nominal_joint,
            theta=amounts[f"{place}.theta"],
            d=length(place, "d", nominal_joint.d),
            a=length(place, "a", nominal_joint.a),
            alpha=amounts[f"{place}.alpha"],
            beta=0.0,
            extra_z=None if nominal_joint.extra_z is None else length(place, "extra_z", nominal_joint.extra_z),
            lower=nominal_joint.lower - SLACK,
            upper=nominal_joint.upper + SLACK,
        )

    joints = tuple(joint(f"joint{i + 1}", nominal_joint) for i, nominal_joint in enumerate(model.arm.joints))
    return replace(model.arm, base=placement(BASE), joints=joints, tool=placement(TOOL))
