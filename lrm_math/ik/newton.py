"""Newton's method for the true joint angles of a batch of candidates on the calibrated arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.joint_laws import JointLaws
from lrm_math.ik.linkage import Indices, MassMoments
from lrm_math.kinematics.poses import Poses

CLOSE = 3e-10
"""m: a candidate has converged when the sum of position error, weighted rotation and equilibrium residual is below."""
CHAR_LENGTH = 0.1
"""m: weight of a rotation by 1 rad against a distance (characteristic length)."""
MOST_STEPS = 40
"""Convergence at singular poses is linear: each step halves the error."""
LONGEST_STEP = 0.6
"""rad, trust region: largest turn of a joint per step."""
DAMPING = 0.05
WEIGHTS = np.array([[1.0], [1.0], [1.0], [CHAR_LENGTH], [CHAR_LENGTH], [CHAR_LENGTH]])
TURN_AND_TRACE = np.zeros((9, 4))
"""Maps a rotation matrix, row by row, to its axis times twice the sine of its angle, and its trace."""
TURN_AND_TRACE[[7, 2, 3], [0, 1, 2]], TURN_AND_TRACE[[5, 6, 1], [0, 1, 2]] = 1.0, -1.0
TURN_AND_TRACE[[0, 4, 8], 3] = 1.0
TINY = 1e-15
"""m²: keeps exactly singular systems solvable."""
ROUGHLY = 0.15
"""rad: bound on what nonlinear effects and the remaining steps change of a command."""
FLAT = 1e-3
"""1 + trace of a rotation below which it is taken for half a turn."""
LAST_NEW_SLOPE = 1
"""Last step that recomputes the derivatives of the loads; later they hardly change."""


@dataclass(frozen=True, eq=False)
class Target:
    """A goal as arrays: position (3,), rotation (3, 3) or approach (3,), and the number of rows of its error."""

    position: Array
    rotation: Array | None
    approach: Array | None
    rows: int

    @classmethod
    def of(cls, goal: Goal) -> Target:
        """From one goal."""
        rotation = None if goal.rotation is None else np.array(goal.rotation)
        approach = None if goal.approach is None else np.array(goal.approach)
        return cls(np.array(goal.position), rotation, approach, goal.constraints)

    def error(self, tcp: Array) -> Array:
        """(K, rows): displacement to the goal (m), then `CHAR_LENGTH` times the rotation to it; base frame.

        The rotation error of an approach is about the tool's x and y.
        """
        out = np.empty((len(tcp), self.rows))
        np.subtract(self.position, tcp[:, :3, 3], out=out[:, :3])
        if self.rotation is not None:
            turn = (self.rotation @ tcp[:, :3, :3].transpose(0, 2, 1)).reshape(-1, 9) @ TURN_AND_TRACE
            np.multiply(turn[:, :3], (2.0 * CHAR_LENGTH) / np.maximum(1.0 + turn[:, 3:], FLAT), out=out[:, 3:])
        elif self.approach is not None:
            x, y, z = (self.approach @ tcp[:, :3, :3]).T
            sine = np.hypot(x, y)
            turn = CHAR_LENGTH * np.arctan2(sine, z) / np.where(sine > 0.0, sine, 1.0)
            out[:, 3], out[:, 4] = -y * turn, x * turn
        return out

    def rows_of(self, jacobian: Array, tcp: Array) -> Array:
        """(K, rows, V): the rows of a Jacobian (K, 6, V) that belong to `error`."""
        if self.rows == 6:
            return np.asarray(jacobian * WEIGHTS)
        if self.rows == 3:
            return jacobian[:, :3]
        turning = CHAR_LENGTH * (tcp[:, :3, :2].transpose(0, 2, 1) @ jacobian[:, 3:])
        return np.concatenate([jacobian[:, :3], turning], axis=1)


@dataclass(frozen=True, eq=False)
class NewtonBatch:
    """Where K candidates of Newton's method ended.

    `amounts`: (K, V) of the moving slots (rad, m). `tau`: (V, K), gravity loads (N·m). `residual`: (K,), m, of goal and
    equilibrium. `tcp`: (K, 4, 4). `abandoned`: (K,), stopped because they lead beyond the limits. `steps`: taken.
    """

    amounts: Array
    tau: Array
    residual: Array
    tcp: Array
    abandoned: NDArray[np.bool_]
    steps: int

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(K,), whether the goal is met."""
        return np.asarray(self.residual <= CLOSE)

    def take(self, rows: NDArray[np.bool_]) -> NewtonBatch:
        """Selected candidates."""
        amounts, residual, tcp = self.amounts[rows], self.residual[rows], self.tcp[rows]
        return NewtonBatch(amounts, self.tau[:, rows], residual, tcp, self.abandoned[rows], self.steps)

    def joined(self, others: NewtonBatch) -> NewtonBatch:
        """Concatenation with another batch."""
        mine, more = (self.amounts, self.residual, self.tcp), (others.amounts, others.residual, others.tcp)
        amounts, residual, tcp = (np.concatenate(pair) for pair in zip(mine, more, strict=True))
        abandoned = np.concatenate([self.abandoned, others.abandoned])
        return NewtonBatch(
            amounts, np.hstack([self.tau, others.tau]), residual, tcp, abandoned, self.steps + others.steps
        )


@dataclass(frozen=True)
class StoppingRule:
    """When to stop: with `enough` candidates at the goal, or none whose residual halved in `patience` steps.

    `singly`: one start after the other, so that none waits for the slowest, where the model and the goal allow that.
    `within`: abandon those that lead beyond the limits.
    """

    enough: int
    patience: int
    singly: bool = False
    within: bool = False


EVERY_BRANCH = StoppingRule(enough=1000, patience=4, singly=True, within=True)
FIRST_BRANCH = StoppingRule(enough=1, patience=4, singly=True, within=True)
IGNORE_LIMITS = StoppingRule(enough=1, patience=5, singly=True)
ANY_BRANCH = StoppingRule(enough=1, patience=3)
PATIENT = StoppingRule(enough=2, patience=12)


@dataclass(frozen=True, eq=False)
class JointBounds:
    """Joint limits of the commands as arrays, (n,) each (rad)."""

    lower: Array
    upper: Array

    @cached_property
    def limits(self) -> tuple[list[float], list[float]]:
        """Lower and upper as lists."""
        return self.lower.tolist(), self.upper.tolist()

    def contains(self, q: Array, slack: float) -> NDArray[np.bool_]:
        """(K,), whether commands (K, n) keep the limits with a tolerance `slack` (rad)."""
        return np.asarray(((q > self.lower - slack) & (q < self.upper + slack)).all(axis=1))


def newton_solve(
    laws: JointLaws,
    target: Target,
    masses: MassMoments,
    poses: Poses,
    start: Array,
    bounds: JointBounds,
    stopping: StoppingRule,
) -> NewtonBatch:
    """Damped Newton's method from slot amounts `start` (K, V), for all candidates at once.

    Slots other than joints follow by the linearised response of the loads, so that convergence stays fast. Damping in
    proportion to the squared error keeps it so where the Jacobian is singular (Yamashita & Fukushima 2001). Once a
    candidate within the limits has converged, only those near the limits go on.

    `poses`: K rows with payload, direction and, for effects that need it, the command so far.
    """
    linkage, joints, others = laws.linkage, laws.linkage.joints, laws.linkage.others
    amounts, stiff = start.copy(), np.empty(0)
    trail: list[Array] = []
    damping, before = np.full(len(start), DAMPING), np.full(len(start), np.inf)
    for step in range(MOST_STEPS + 1):
        state = linkage.forward(amounts)
        loads = linkage.loads(state, masses)
        error = target.error(state.tcp)
        square = (error * error).sum(axis=1)
        residual = np.sqrt(square)
        if len(others):
            poses = laws.with_commands(poses, loads.tau, amounts) if laws.follows_command else poses
            deficit = laws.others_at_loads(poses, loads.tau).T - amounts[:, others]
            residual += np.abs(deficit).sum(axis=1) * laws.model.binding.reach
        q, going = laws.linear_command(loads.tau, amounts[:, joints]), residual > CLOSE
        converged = np.count_nonzero(bounds.contains(q, 0.0) & ~going)
        if converged:
            going &= bounds.contains(q, ROUGHLY)
        trail.append(residual)
        if len(trail) > stopping.patience:
            going &= residual < 0.5 * trail[-1 - stopping.patience]
        if step == MOST_STEPS or converged >= stopping.enough or not going.any():
            break
        damping = np.where(residual > before, 30.0 * damping, np.maximum(0.3 * damping, DAMPING))
        before = residual
        J = target.rows_of(linkage.jacobian(state), state.tcp)
        if not len(others):
            amounts[:, joints] += _damped(J[:, :, joints], error, damping * square)
            continue
        if step <= LAST_NEW_SLOPE:
            stiff = laws.others_compliance(poses, loads.tau) @ linkage.load_derivatives(state, masses, loads).transpose(
                2, 0, 1
            )
        by_joint, follow = _reduced_jacobian(J, joints, others, stiff, deficit)
        error = error - (J[:, :, others] @ follow[:, :, -1:])[:, :, 0]
        turn = _damped(by_joint, error, damping * square)
        amounts[:, joints] += turn
        amounts[:, others] += (follow[:, :, :-1] @ turn[:, :, None])[:, :, 0] + follow[:, :, -1]
    return NewtonBatch(amounts, loads.tau, residual, state.tcp, np.zeros(len(residual), dtype=bool), step)


def _reduced_jacobian(J: Array, joints: Indices, others: Indices, stiff: Array, deficit: Array) -> tuple[Array, Array]:
    """Reduced Jacobian (K, rows, n) of the joints with the other slots following, and their response (K, W, n + 1).

    The last column is the remaining deficit of the followers. `stiff`: (K, W, V), their response to any slot's motion.
    """
    system = np.eye(len(others)) - stiff[:, :, others]
    follow = np.linalg.solve(system, np.concatenate([stiff[:, :, joints], deficit[:, :, None]], axis=2))
    return J[:, :, joints] + J[:, :, others] @ follow[:, :, :-1], follow


def _damped(J: Array, error: Array, damping: Array) -> Array:
    """(K, n), damped least-squares step of the joints, damping in m², cut to the trust region."""
    turned = J.transpose(0, 2, 1)
    normal = J @ turned + (damping + TINY)[:, None, None] * np.eye(J.shape[1])
    turn = (turned @ np.linalg.solve(normal, error[:, :, None]))[:, :, 0]
    largest = np.abs(turn).max(axis=1, keepdims=True)
    return np.asarray(turn * (LONGEST_STEP / np.maximum(largest, LONGEST_STEP)))
