"""Newton's method for full poses from one start at a time, in scalar Python: the counterpart of `newton`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from lrm_math.arrays import Array, Vector3
from lrm_math.ik.goal import Rotation
from lrm_math.ik.joint_laws import JointLaws
from lrm_math.ik.linkage import Indices, MassMoments
from lrm_math.ik.newton import (
    CHAR_LENGTH,
    CLOSE,
    FLAT,
    LONGEST_STEP,
    MOST_STEPS,
    TINY,
    JointBounds,
    NewtonBatch,
    StoppingRule,
)
from lrm_math.ik.scalar_linkage import ScalarFrame, ScalarLinkage, ScalarMassMoments, jacobian_rows, matrices, twist

DAMPING = 1e-3
NEARLY = 1e-5
"""m: starts with a smaller residual are followed to the end."""
QUICK, SLOW, STALLED = 4, 0.5, 1e-3
"""Convergence is slow when after so many steps the residual shrinks by less than this ratio. STALLED, m: residual below
which the response of the other slots is then added to the Jacobian.
"""
NUDGE = 1e-5
"""rad, finite-difference step for that response."""
STEADY = 0.01
"""The Jacobian is kept while the residual falls below this share of the one at which it was computed."""
LARGEST_EXCESS = 0.2
"""rad: excess beyond the limits at which a start is abandoned; or a smaller one, if the last step and nonlinear effects
cannot make up for it.
"""


@dataclass(frozen=True)
class NewtonResult:
    """Where one start ended.

    `amounts`: (V,) of the moving slots (rad). `tau`: (V,), gravity loads (N·m). `tcp`: tool frame. `residual`: m, of
    goal and equilibrium. `abandoned`: whether it was stopped because it leads beyond the limits.
    """

    amounts: list[float]
    tau: list[float]
    tcp: ScalarFrame
    residual: float
    steps: int
    abandoned: bool

    @property
    def converged(self) -> bool:
        """Whether the goal is met."""
        return self.residual <= CLOSE


@dataclass(frozen=True, eq=False)
class LinearSprings:
    """Slots that deflect in proportion to loads.

    `numbers`: of the slots. `first`: amount without load (rad), compliance (rad/N·m) and number of the slot whose load
    it feels. `more`: further loads: position among the slots, compliance and number of the load's slot.
    """

    numbers: tuple[int, ...]
    first: tuple[tuple[float, float, int], ...]
    more: tuple[tuple[int, float, int], ...]

    @classmethod
    def of(cls, laws: JointLaws, rows: Indices) -> LinearSprings:
        """From the linear effects of a model, for slots `rows`."""
        feels = [np.flatnonzero(laws.compliances[v]).tolist() or [0] for v in rows]
        first = [
            (float(laws.constants[v]), float(laws.compliances[v, u[0]]), u[0]) for v, u in zip(rows, feels, strict=True)
        ]
        more = [
            (i, float(laws.compliances[v, u]), u)
            for i, (v, us) in enumerate(zip(rows, feels, strict=True))
            for u in us[1:]
        ]
        return cls(tuple(rows.tolist()), tuple(first), tuple(more))

    def deflection(self, tau: Sequence[float]) -> list[float]:
        """Slot amounts (rad) under loads (V,), joints at command zero."""
        out = [rest + k * tau[u] for rest, k, u in self.first]
        for i, k, u in self.more:
            out[i] += k * tau[u]
        return out


@dataclass(frozen=True, eq=False)
class ScalarNewton:
    """Newton's method for one model.

    `joints`, `others`: the moving slots, with their linear response to loads. `arm_reach`: m, weight of the deficit of
    `others`. `nonlinear_bound`: rad, bound on the share of nonlinear effects in a command.
    """

    linkage: ScalarLinkage
    joints: LinearSprings
    others: LinearSprings
    arm_reach: float
    bounds: JointBounds
    nonlinear_bound: float

    @classmethod
    def of(cls, laws: JointLaws, bounds: JointBounds, nonlinear_bound: float) -> ScalarNewton | None:
        """None where slots translate, or where slots other than joints follow more than linear springs."""
        linkage = ScalarLinkage.of(laws.linkage)
        if linkage is None or not laws.others_are_linear:
            return None
        joints, others = LinearSprings.of(laws, laws.linkage.joints), LinearSprings.of(laws, laws.linkage.others)
        return cls(linkage, joints, others, laws.model.binding.reach, bounds, nonlinear_bound)

    def solve_each(
        self,
        rotation: Rotation,
        position: Vector3,
        masses: MassMoments,
        starts: Sequence[list[float]],
        stopping: StoppingRule,
    ) -> NewtonBatch:
        """From slot amounts (K, V), one after the other until `enough` have reached the goal within the limits."""
        bodies, ends, good = self.linkage.scalar_moments(masses), list[NewtonResult](), 0
        for start in starts:
            ends.append(self.solve(rotation, position, bodies, start, stopping))
            good += self._is_good(ends[-1])
            if good == stopping.enough:
                break
        return NewtonBatch(
            np.array([end.amounts for end in ends]),
            np.array([end.tau for end in ends]).T,
            np.array([end.residual for end in ends]),
            matrices([end.tcp for end in ends]),
            np.array([end.abandoned for end in ends]),
            max(end.steps for end in ends),
        )

    def solve(
        self,
        rotation: Rotation,
        position: Vector3,
        bodies: ScalarMassMoments,
        start: Sequence[float],
        stopping: StoppingRule,
    ) -> NewtonResult:
        """As `newton.newton_solve` from slot amounts (V,), for a pose.

        The other slots are set to where the loads have them and the joints make up for it; the response of the loads to
        the joints' steps is left to the next step, or enters the Jacobian where that converges slowly, as near folds.
        """
        joints, others = self.joints.numbers, self.others.numbers
        amounts, before, jacobian_residual = list(start), inf, 0.0
        follow: Array | None = None
        trail: list[float] = []
        damping = DAMPING
        for step in range(MOST_STEPS + 1):
            state = self.linkage.forward(amounts, bodies)
            tau = state.tau
            error = pose_residual(rotation, position, state.tcp)
            square = sum([e * e for e in error])
            there = self.others.deflection(tau)
            deficit = [(v, to - amounts[v]) for v, to in zip(others, there, strict=True)]
            residual = sqrt(square) + self.arm_reach * sum([abs(turn) for _, turn in deficit])
            trail.append(residual)
            stuck = len(trail) > stopping.patience and residual > 0.5 * trail[-1 - stopping.patience]
            slow = stuck or (step > QUICK and residual > SLOW * before)
            if slow and others and residual < STALLED and follow is None:
                follow = self._follow(amounts, there, bodies)
                stuck, trail, jacobian_residual = False, [residual], 0.0
            if residual <= CLOSE or stuck or step == MOST_STEPS:
                break
            damping = 30.0 * damping if residual > before else max(0.3 * damping, DAMPING)
            before = residual
            if residual > STEADY * jacobian_residual:
                by_joint = jacobian_rows(state, joints, CHAR_LENGTH)
                if follow is not None:
                    by_joint += follow @ jacobian_rows(state, others, CHAR_LENGTH)
                inverse, jacobian_residual = _inverse(by_joint, damping * square + TINY), residual
            from_deficit = twist(state, deficit, CHAR_LENGTH)
            turns = _cut(inverse @ np.array([e - d for e, d in zip(error, from_deficit, strict=True)]))
            for v, turn in deficit if follow is None else _follower_turns(turns, follow, deficit):
                amounts[v] += turn
            for v, turn in zip(joints, turns, strict=True):
                amounts[v] += turn
            if stopping.within and residual > NEARLY:
                allowed = min(LARGEST_EXCESS, self.nonlinear_bound + max(map(abs, turns)))
                if self._beyond(amounts, tau) > allowed:
                    return NewtonResult(amounts, tau, state.tcp, residual, step, True)
        return NewtonResult(amounts, tau, state.tcp, residual, step, False)

    def _follow(self, amounts: Sequence[float], there: Sequence[float], bodies: ScalarMassMoments) -> Array:
        """(n, W), response of the other slots, now due `there`, to a turn of each joint (rad/rad), by differences."""
        rows = []
        for v in self.joints.numbers:
            nudged = list(amounts)
            nudged[v] += NUDGE
            then = self.others.deflection(self.linkage.forward(nudged, bodies).tau)
            rows.append([(to - now) / NUDGE for to, now in zip(then, there, strict=True)])
        return np.array(rows)

    def _is_good(self, end: NewtonResult) -> bool:
        """Whether the goal is met within the limits, nonlinear effects permitting."""
        return end.converged and self._beyond(end.amounts, end.tau) <= self.nonlinear_bound

    def _beyond(self, amounts: Sequence[float], tau: Sequence[float]) -> float:
        """rad, largest excess of the linear command beyond the limits; negative within."""
        worst = -inf
        joints = self.joints
        for v, deflection, lower, upper in zip(
            joints.numbers, joints.deflection(tau), *self.bounds.limits, strict=True
        ):
            q = amounts[v] - deflection
            worst = max(worst, lower - q, q - upper)
        return worst


def _follower_turns(turns: list[float], follow: Array, deficit: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
    """Numbers and turns of the other slots: response to turns of the joints (n,), plus their deficit (rad)."""
    return [(v, lack + more) for (v, lack), more in zip(deficit, (turns @ follow).tolist(), strict=True)]


def _inverse(by_joint: Array, damping: float) -> Array:
    """(n, 6), damped least-squares inverse, damping in m², of a Jacobian whose transpose is `by_joint` (n, 6)."""
    normal = by_joint.T @ by_joint
    normal.flat[::7] += damping
    return np.asarray(by_joint @ np.linalg.inv(normal))


def _cut(turns: Array) -> list[float]:
    """The turns (n,), cut to the trust region."""
    out: list[float] = turns.tolist()
    largest = max(map(abs, out))
    return out if largest <= LONGEST_STEP else [turn * (LONGEST_STEP / largest) for turn in out]


def pose_residual(rotation: Rotation, position: Vector3, tcp: ScalarFrame) -> tuple[float, ...]:
    """Displacement to the goal (m) and scaled rotation to it, as a row of `newton.Target.error`."""
    (ux, vx, wx), (uy, vy, wy), (uz, vz, wz) = rotation
    ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = tcp
    x, y, z = position
    trace = ax * ux + ay * uy + az * uz + bx * vx + by * vy + bz * vz + cx * wx + cy * wy + cz * wz
    scale = 2.0 * CHAR_LENGTH / max(1.0 + trace, FLAT)
    return (
        x - px,
        y - py,
        z - pz,
        scale * (ay * uz - az * uy + by * vz - bz * vy + cy * wz - cz * wy),
        scale * (az * ux - ax * uz + bz * vx - bx * vz + cz * wx - cx * wz),
        scale * (ax * uy - ay * ux + bx * vy - by * vx + cx * wy - cy * wx),
    )
