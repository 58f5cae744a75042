"""Newton's method from one start, most of it in scalar Python: as `newton` does it for many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from lrm_math.chain import Array
from lrm_math.ik.compensation import Compensation
from lrm_math.ik.goal import Rotation, Triple
from lrm_math.ik.newton import (
    CLOSE,
    DAMPING,
    EVERY_BRANCH,
    FLAT,
    LEVER,
    LONGEST_STEP,
    MOST_STEPS,
    TINY,
    Band,
    Reached,
)
from lrm_math.ik.one_linkage import Cargo, Frame, OneLinkage, Stand, screws, swept

Springs = tuple[tuple[float, tuple[tuple[int, float], ...]], ...]
"""For some slots: what they have without load (rad), and by which slots' loads they give way how much (rad/N·m)."""


@dataclass(frozen=True)
class End:
    """Where one start led to: `amounts` (V,) of the moving slots (rad), loads `tau` (V,) there (N·m), `stand`, and
    `miss`, what is left of the goal and of the equilibrium (m), after some `steps`."""

    amounts: list[float]
    tau: list[float]
    stand: Stand
    miss: float
    steps: int


@dataclass(frozen=True, eq=False)
class OneStart:
    """A deployed model's arm, with what else one start needs.

    `moved`: the first body that each slot moves. `joints`, `others`: where they stand among the moving slots, and
    what their linear effects make of loads. `compliant`: (W, V), the same of the others. `inner`: (V, V), whether slot
    k stands before slot j, or is it. `wide`: m, by which others' turns count.
    """

    linkage: OneLinkage
    moved: tuple[int, ...]
    joints: tuple[int, ...]
    others: tuple[int, ...]
    on_joints: Springs
    on_others: Springs
    compliant: Array
    inner: Array
    wide: float
    band: Band

    @classmethod
    def of(cls, c: Compensation, band: Band) -> OneStart | None:
        """For a model; None where slots are translations, or others than joints follow more than linear springs."""
        linkage = OneLinkage.of(c.linkage)
        if linkage is None or not c.others_are_springs:
            return None
        joints, others = tuple(c.linkage.joints.tolist()), tuple(c.linkage.others.tolist())
        return cls(
            linkage=linkage,
            moved=tuple(c.linkage.moved.tolist()),
            joints=joints,
            others=others,
            on_joints=_springs(c, joints),
            on_others=_springs(c, others),
            compliant=c.compliances[c.linkage.others],
            inner=c.linkage.inner[:, :, 0],
            wide=c.model.wiring.reach,
            band=band,
        )

    def stand(self, amounts: Sequence[float], cargo: Cargo) -> tuple[Stand, list[Triple], list[float]]:
        """Frames, gravity x axis of every slot, and gravity's loads."""
        stand = self.linkage.stand(amounts, cargo)
        levers = self.linkage.levers(stand)
        return stand, levers, self.linkage.loads(stand, levers, cargo)

    def given_way(self, tau: Sequence[float]) -> list[float]:
        """Where the slots that are no joints want to be under loads (V,): rad."""
        return [amount + sum([k * tau[v] for v, k in springs]) for amount, springs in self.on_others]

    def reach(
        self, rotation: Rotation, position: Triple, cargo: Cargo, start: Sequence[float], slack: float = inf
    ) -> End:
        """As `newton.reach` from amounts (V,), for a whole pose; given up where a command breaks limits by `slack`.

        How the other slots follow the joints is reckoned at the start only; on the way it hardly changes.
        """
        amounts, follow = list(start), _Follow.none()
        trail: list[float] = []
        damping, before = DAMPING, inf
        for step in range(MOST_STEPS + 1):
            stand, levers, tau = self.stand(amounts, cargo)
            error = way(rotation, position, stand.tcp)
            square = sum([e * e for e in error])
            lacking = [wanted - amounts[v] for v, wanted in zip(self.others, self.given_way(tau), strict=True)]
            miss = sqrt(square) + self.wide * sum(map(abs, lacking))
            trail.append(miss)
            stuck = step >= EVERY_BRANCH.patience and miss > 0.5 * trail[-1 - EVERY_BRANCH.patience]
            if miss <= CLOSE or stuck or step == MOST_STEPS or not self._may_keep_limits(amounts, tau, slack):
                break
            damping = 30.0 * damping if miss > before else max(0.3 * damping, DAMPING)
            before = miss
            if self.others and step == 0:
                follow = _Follow.of(self, levers, swept(stand, cargo, self.moved))
            joint_turns, other_turns = follow.steps(self, stand, error, lacking, damping * square + TINY)
            for v, turn in zip(self.joints, joint_turns, strict=True):
                amounts[v] += turn
            for v, turn in zip(self.others, other_turns, strict=True):
                amounts[v] += turn
        return End(amounts, tau, stand, miss, step)

    def _may_keep_limits(self, amounts: Sequence[float], tau: Sequence[float], slack: float) -> bool:
        """Whether the command, with the linear effects only, keeps the limits but for `slack` (rad)."""
        if slack == inf:
            return True
        for v, (rest, springs), lower, upper in zip(
            self.joints, self.on_joints, *self.band.limits, strict=True
        ):
            q = amounts[v] - rest - sum([k * tau[u] for u, k in springs])
            if not lower - slack < q < upper + slack:
                return False
        return True


@dataclass(frozen=True, eq=False)
class _Follow:
    """How the other slots follow the joints (W, n), and what is left to do (W, W) of what they lack by themselves."""

    joints: Array
    lack: Array

    @classmethod
    def none(cls) -> _Follow:
        return cls(np.empty((0, 0)), np.empty((0, 0)))

    @classmethod
    def of(cls, one: OneStart, levers: list[Triple], moments: list[Triple]) -> _Follow:
        """From the slopes of the loads, as `Linkage.slopes` has them."""
        outer = np.array(levers) @ np.array(moments).T
        stiff = one.compliant @ np.where(one.inner, outer, outer.T)
        others = list(one.others)
        lack = np.linalg.inv(np.eye(len(others)) - stiff[:, others])
        return cls(lack @ stiff[:, list(one.joints)], lack)

    def steps(
        self, one: OneStart, stand: Stand, error: Sequence[float], lacking: list[float], damping: float
    ) -> tuple[list[float], list[float]]:
        """The least turns of the joints that take the error away, damped (m²), cut to size, and of the others (rad)."""
        J = np.array(screws(stand, LEVER))
        by_joint, missing = J[list(one.joints)], np.array(error)
        if lacking:
            by_other, left = J[list(one.others)], self.lack @ lacking
            by_joint += self.joints.T @ by_other
            missing -= left @ by_other
        normal = by_joint.T @ by_joint
        normal.flat[:: len(normal) + 1] += damping
        turn = by_joint @ np.linalg.solve(normal, missing)
        turn *= LONGEST_STEP / max(LONGEST_STEP, float(abs(turn).max()))
        return turn.tolist(), (self.joints @ turn + left).tolist() if lacking else []


def way(rotation: Rotation, position: Triple, tcp: Frame) -> tuple[float, ...]:
    """The way to go (m), then `LEVER` times the turn to make, as `newton.Aim.error` has them."""
    (ux, vx, wx), (uy, vy, wy), (uz, vz, wz) = rotation
    ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = tcp
    x, y, z = position
    trace = ax * ux + ay * uy + az * uz + bx * vx + by * vy + bz * vz + cx * wx + cy * wy + cz * wz
    scale = 2.0 * LEVER / max(1.0 + trace, FLAT)
    return (
        x - px,
        y - py,
        z - pz,
        scale * (ay * uz - az * uy + by * vz - bz * vy + cy * wz - cz * wy),
        scale * (az * ux - ax * uz + bz * vx - bx * vz + cz * wx - cx * wz),
        scale * (ax * uy - ay * ux + bx * vy - by * vx + cx * wy - cy * wx),
    )


def reached(ends: Sequence[End]) -> Reached:
    """The ends of several starts as arrays."""
    return Reached(
        np.array([end.amounts for end in ends]),
        np.array([end.tau for end in ends]).T,
        np.array([end.miss for end in ends]),
        np.array([end.stand.matrix() for end in ends]),
        max(end.steps for end in ends),
    )


def _springs(c: Compensation, rows: Sequence[int]) -> Springs:
    return tuple(
        (float(c.steady[v]), tuple((int(u), float(c.compliances[v, u])) for u in np.flatnonzero(c.compliances[v])))
        for v in rows
    )
