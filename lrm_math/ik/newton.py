"""Newton's method for the angles that the joints of a calibrated arm must really have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.joint_laws import Compensation
from lrm_math.ik.linkage import Burden, Indices
from lrm_math.kinematics.poses import Poses

CLOSE = 3e-10
"""m: a goal is met when position, turn times `LEVER` and what the equilibrium lacks are all below."""
LEVER = 0.1
"""m: a turn by 1 rad weighs as much as this distance."""
MOST_STEPS = 40
"""Singular poses are met slowly: each step halves the way."""
LONGEST_STEP = 0.6
"""rad: no joint turns further in one step."""
DAMPING = 0.05
WEIGHTS = np.array([[1.0], [1.0], [1.0], [LEVER], [LEVER], [LEVER]])
TURN_AND_TRACE = np.zeros((9, 4))
"""What gives of a rotation matrix, row by row, its axis times twice the sine of its angle, and its trace."""
TURN_AND_TRACE[[7, 2, 3], [0, 1, 2]], TURN_AND_TRACE[[5, 6, 1], [0, 1, 2]] = 1.0, -1.0
TURN_AND_TRACE[[0, 4, 8], 3] = 1.0
TINY = 1e-15
"""m²: keeps exactly singular poses solvable."""
ROUGHLY = 0.15
"""rad: what effects that are not linear, and steps still to be taken, may change of a command."""
FLAT = 1e-3
"""1 + trace of a rotation below which it is taken for half a turn."""
LAST_NEW_SLOPE = 1
"""The slopes of loads are reckoned anew in the first steps only; by then they hardly change."""


@dataclass(frozen=True, eq=False)
class Aim:
    """A goal as arrays: position (3,), rotation (3, 3) or approach (3,), and how many rows of its error count."""

    position: Array
    rotation: Array | None
    approach: Array | None
    rows: int

    @classmethod
    def of(cls, goal: Goal) -> Aim:
        """The arrays of one goal."""
        rotation = None if goal.rotation is None else np.array(goal.rotation)
        approach = None if goal.approach is None else np.array(goal.approach)
        return cls(np.array(goal.position), rotation, approach, goal.constraints)

    def error(self, tcp: Array) -> Array:
        """(K, rows): the way to go (m), then `LEVER` times the turn to make; both in the base's frame.

        The turn of an approach is the one about the tool's x and y.
        """
        out = np.empty((len(tcp), self.rows))
        np.subtract(self.position, tcp[:, :3, 3], out=out[:, :3])
        if self.rotation is not None:
            turn = (self.rotation @ tcp[:, :3, :3].transpose(0, 2, 1)).reshape(-1, 9) @ TURN_AND_TRACE
            np.multiply(turn[:, :3], (2.0 * LEVER) / np.maximum(1.0 + turn[:, 3:], FLAT), out=out[:, 3:])
        elif self.approach is not None:
            x, y, z = (self.approach @ tcp[:, :3, :3]).T
            sine = np.hypot(x, y)
            turn = LEVER * np.arctan2(sine, z) / np.where(sine > 0.0, sine, 1.0)
            out[:, 3], out[:, 4] = -y * turn, x * turn
        return out

    def rows_of(self, jacobian: Array, tcp: Array) -> Array:
        """(K, rows, V): the rows of a Jacobian (K, 6, V) that belong to `error`."""
        if self.rows == 6:
            return np.asarray(jacobian * WEIGHTS)
        if self.rows == 3:
            return jacobian[:, :3]
        turning = LEVER * (tcp[:, :3, :2].transpose(0, 2, 1) @ jacobian[:, 3:])
        return np.concatenate([jacobian[:, :3], turning], axis=1)


@dataclass(frozen=True, eq=False)
class Reached:
    """Where K candidates ended.

    `amounts`: (K, V) of the moving slots (rad, m). `tau`: (V, K), gravity's loads (N·m). `miss`: (K,), what is left of
    the goal and of the equilibrium (m). `tcp`: (K, 4, 4). `left`: (K,), which were followed no further because they
    lead beyond the limits. `steps`: how many were taken.
    """

    amounts: Array
    tau: Array
    miss: Array
    tcp: Array
    left: NDArray[np.bool_]
    steps: int

    @property
    def met(self) -> NDArray[np.bool_]:
        """(K,), whether the goal is met."""
        return np.asarray(self.miss <= CLOSE)

    def take(self, rows: NDArray[np.bool_]) -> Reached:
        """Some of the candidates."""
        amounts, miss, tcp = (column[rows] for column in self._rows)
        return Reached(amounts, self.tau[:, rows], miss, tcp, self.left[rows], self.steps)

    def joined(self, others: Reached) -> Reached:
        """These and others."""
        amounts, miss, tcp = (np.concatenate(pair) for pair in zip(self._rows, others._rows, strict=True))
        left = np.concatenate([self.left, others.left])
        return Reached(amounts, np.hstack([self.tau, others.tau]), miss, tcp, left, self.steps + others.steps)

    @property
    def _rows(self) -> tuple[Array, Array, Array]:
        return self.amounts, self.miss, self.tcp


@dataclass(frozen=True)
class Effort:
    """When to end: with `enough` candidates at the goal, or none that halved what it misses in `patience` steps.

    `singly`: one start after the other, so that none waits for the slowest, where the model and the goal allow that.
    `within`: those are left where they lead beyond the limits.
    """

    enough: int
    patience: int
    singly: bool = False
    within: bool = False


EVERY_BRANCH = Effort(enough=1000, patience=4, singly=True, within=True)
FIRST_BRANCH = Effort(enough=1, patience=4, singly=True, within=True)
STRAYS = Effort(enough=1, patience=5, singly=True)
ANY_BRANCH = Effort(enough=1, patience=3)
LAST_RESORT = Effort(enough=2, patience=12)


@dataclass(frozen=True, eq=False)
class Band:
    """Limits of the commands, (n,) each (rad)."""

    lower: Array
    upper: Array

    @cached_property
    def limits(self) -> tuple[list[float], list[float]]:
        """The same as lists: lower and upper."""
        return self.lower.tolist(), self.upper.tolist()

    def holds(self, q: Array, slack: float) -> NDArray[np.bool_]:
        """(K,), whether commands (K, n) keep them but for `slack`."""
        return np.asarray(((q > self.lower - slack) & (q < self.upper + slack)).all(axis=1))


def reach(c: Compensation, aim: Aim, burden: Burden, poses: Poses, start: Array, band: Band, effort: Effort) -> Reached:
    """Newton's method from amounts `start` (K, V) of the moving slots, for all candidates at once.

    The slots that are no joints follow by the linear answer of the loads, so that convergence stays fast. Damping in
    proportion to the squared error keeps it so where the Jacobian is singular (Yamashita & Fukushima 2001). Once a
    candidate within the limits has met the goal, only those near them count.

    Args:
        poses: K rows with payload, direction and, for effects that need it, the command so far.
        effort: see `Effort`.
    """
    linkage, joints, others = c.linkage, c.linkage.joints, c.linkage.others
    amounts, stiff = start.copy(), np.empty(0)
    trail: list[Array] = []
    damping, before = np.full(len(start), DAMPING), np.full(len(start), np.inf)
    for step in range(MOST_STEPS + 1):
        placed = linkage.place(amounts)
        loads = linkage.loads(placed, burden)
        error = aim.error(placed.tcp)
        square = (error * error).sum(axis=1)
        miss = np.sqrt(square)
        if len(others):
            poses = c.commanding(poses, loads.tau, amounts) if c.follows_command else poses
            lacking = c.others(poses, loads.tau).T - amounts[:, others]
            miss += np.abs(lacking).sum(axis=1) * c.model.wiring.reach
        q, going = c.roughly(loads.tau, amounts[:, joints]), miss > CLOSE
        met = np.count_nonzero(band.holds(q, 0.0) & ~going)
        if met:
            going &= band.holds(q, ROUGHLY)
        trail.append(miss)
        if len(trail) > effort.patience:
            going &= miss < 0.5 * trail[-1 - effort.patience]
        if step == MOST_STEPS or met >= effort.enough or not going.any():
            break
        damping = np.where(miss > before, 30.0 * damping, np.maximum(0.3 * damping, DAMPING))
        before = miss
        J = aim.rows_of(linkage.jacobian(placed), placed.tcp)
        if not len(others):
            amounts[:, joints] += _damped(J[:, :, joints], error, damping * square)
            continue
        if step <= LAST_NEW_SLOPE:
            stiff = c.springs(poses, loads.tau) @ linkage.slopes(placed, burden, loads).transpose(2, 0, 1)
        by_joint, follow = _with_followers(J, joints, others, stiff, lacking)
        error = error - (J[:, :, others] @ follow[:, :, -1:])[:, :, 0]
        turn = _damped(by_joint, error, damping * square)
        amounts[:, joints] += turn
        amounts[:, others] += (follow[:, :, :-1] @ turn[:, :, None])[:, :, 0] + follow[:, :, -1]
    return Reached(amounts, loads.tau, miss, placed.tcp, np.zeros(len(miss), dtype=bool), step)


def _with_followers(J: Array, joints: Indices, others: Indices, stiff: Array, lacking: Array) -> tuple[Array, Array]:
    """The Jacobian (K, rows, n) of the joints with the other slots following, and how these follow: (K, W, n + 1).

    The last column is what they still have to go by themselves. `stiff`: (K, W, V), their answer to any slot's motion.
    """
    system = np.eye(len(others)) - stiff[:, :, others]
    follow = np.linalg.solve(system, np.concatenate([stiff[:, :, joints], lacking[:, :, None]], axis=2))
    return J[:, :, joints] + J[:, :, others] @ follow[:, :, :-1], follow


def _damped(J: Array, error: Array, damping: Array) -> Array:
    """(K, n), the least motion of the joints that takes the error away, damped (m²) and cut to size."""
    turned = J.transpose(0, 2, 1)
    normal = J @ turned + (damping + TINY)[:, None, None] * np.eye(J.shape[1])
    turn = (turned @ np.linalg.solve(normal, error[:, :, None]))[:, :, 0]
    largest = np.abs(turn).max(axis=1, keepdims=True)
    return np.asarray(turn * (LONGEST_STEP / np.maximum(largest, LONGEST_STEP)))
