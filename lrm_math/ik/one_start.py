"""Newton's method from one start, most of it in scalar Python: as `newton` does it for many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from lrm_math.chain import Array
from lrm_math.ik.compensation import Compensation
from lrm_math.ik.goal import Rotation, Triple
from lrm_math.ik.linkage import Burden, Indices
from lrm_math.ik.newton import (
    CLOSE,
    EVERY_BRANCH,
    FLAT,
    LEVER,
    LONGEST_STEP,
    MOST_STEPS,
    TINY,
    Band,
    Reached,
)
from lrm_math.ik.one_linkage import Cargo, Frame, OneLinkage, Stand, matrices, screws, swept

Springs = tuple[tuple[float, tuple[tuple[int, float], ...]], ...]
"""For some slots: what they have without load (rad), and by which slots' loads they give way how much (rad/N·m)."""
DAMPING = 1e-3
NEW_SLOPE = 1e-3
"""rad: after a larger step of any slot it is reckoned anew how the other slots follow the joints."""
PATIENCE = EVERY_BRANCH.patience
AT_FIRST, LATER = 0.3, 0.1
"""rad: a command this far beyond the limits at the start, or after a step, is not worth following while there are
others. Steps still to be taken, and effects that are not linear, may change it."""


@dataclass(frozen=True)
class End:
    """Where one start led to: `amounts` (V,) of the moving slots (rad), loads `tau` (V,) there (N·m), the tool's frame,
    and `miss`, what is left of the goal and of the equilibrium (m), after some `steps`. `left`: whether it was
    followed no further because it breaks limits."""

    amounts: list[float]
    tau: list[float]
    tcp: Frame
    miss: float
    steps: int
    left: bool

    @property
    def met(self) -> bool:
        """Whether the goal is met."""
        return self.miss <= CLOSE


@dataclass(frozen=True, eq=False)
class OneStart:
    """A deployed model's arm, with what else one start needs.

    `moved`: the first body that each slot moves. `joints`, `others`: where they stand among the moving slots;
    `on_joints`, `on_others`: what their linear effects make of loads; `compliant`: (W, V), the same of the others.
    `inner`: (V, V), whether slot k stands before slot j, or is it. `behind`: see `Linkage.behind`; `unmoved`: the first
    body that each of those loads counts. `wide`: m, by which others' turns count.
    """

    linkage: OneLinkage
    moved: tuple[int, ...]
    joints: Indices
    others: Indices
    on_joints: Springs
    on_others: Springs
    compliant: Array
    inner: NDArray[np.bool_]
    behind: tuple[Indices, Indices]
    unmoved: tuple[int, ...]
    wide: float
    band: Band

    @classmethod
    def of(cls, c: Compensation, band: Band) -> OneStart | None:
        """For a model; None where slots are translations, or others than joints follow more than linear springs."""
        linkage = OneLinkage.of(c.linkage)
        if linkage is None or not c.others_are_springs:
            return None
        return cls(
            linkage=linkage,
            moved=tuple(c.linkage.moved.tolist()),
            joints=c.linkage.joints,
            others=c.linkage.others,
            on_joints=_springs(c, c.linkage.joints),
            on_others=_springs(c, c.linkage.others),
            compliant=c.compliances[c.linkage.others],
            inner=c.linkage.inner[:, :, 0],
            behind=c.linkage.behind,
            unmoved=tuple(c.linkage.counted[c.linkage.behind[0]].tolist()),
            wide=c.model.wiring.reach,
            band=band,
        )

    def seen(self, starts: Sequence[list[float]], burden: Burden) -> tuple[Array, Array]:
        """Tool frames (K, 4, 4) at amounts (K, V), and where the slots that are no joints want to be there (K, W)."""
        cargo = self.linkage.cargo(burden)
        stands = [self._stand(start, cargo) for start in starts]
        wanted = [self._given_way(tau) for _, _, tau in stands]
        return matrices([stand.tcp for stand, _, _ in stands]), np.array(wanted).reshape(len(stands), -1)

    def reach_all(self, rotation: Rotation, position: Triple, burden: Burden, starts: Sequence[list[float]]) -> Reached:
        """Where amounts (K, V) lead to; beyond the limits they are followed only if none gets there within."""
        cargo = self.linkage.cargo(burden)
        ends = [self.reach(rotation, position, cargo, start, True) for start in starts]
        if not any(end.met and self._beyond(end.amounts, end.tau) <= 0.0 for end in ends):
            ends = [self.reach(rotation, position, cargo, end.amounts, False) if end.left else end for end in ends]
        return Reached(
            np.array([end.amounts for end in ends]),
            np.array([end.tau for end in ends]).T,
            np.array([end.miss for end in ends]),
            matrices([end.tcp for end in ends]),
            max(end.steps for end in ends),
        )

    def reach(self, rotation: Rotation, position: Triple, cargo: Cargo, start: Sequence[float], limited: bool) -> End:
        """As `newton.reach` from amounts (V,), for a pose; `limited`: only while the command may keep the limits.

        How the other slots follow the joints is a small share of what the joints do themselves: it is left out of the
        first step, and reckoned anew after large ones.
        """
        amounts, follow, before, largest = list(start), self._still, inf, 0.0
        trail: list[float] = []
        damping = DAMPING
        for step in range(MOST_STEPS + 1):
            stand, levers, tau = self._stand(amounts, cargo)
            error = way(rotation, position, stand.tcp)
            square = sum([e * e for e in error])
            lacking = [
                wanted - amounts[v] for v, wanted in zip(self.others.tolist(), self._given_way(tau), strict=True)
            ]
            miss = sqrt(square) + self.wide * sum(map(abs, lacking))
            trail.append(miss)
            stuck = step >= PATIENCE and miss > 0.5 * trail[-1 - PATIENCE]
            if miss <= CLOSE or stuck or step == MOST_STEPS:
                break
            if limited and self._beyond(amounts, tau) > (AT_FIRST if step == 0 else LATER):
                return End(amounts, tau, stand.tcp, miss, step, True)
            damping = 30.0 * damping if miss > before else max(0.3 * damping, DAMPING)
            before = miss
            if lacking and largest > NEW_SLOPE:
                follow = _Follow.of(self, stand, levers, cargo)
            turns = follow.turns(self, screws(stand, LEVER), error, lacking, damping * square + TINY)
            amounts = [amount + turn for amount, turn in zip(amounts, turns, strict=True)]
            largest = max(map(abs, turns))
        return End(amounts, tau, stand.tcp, miss, step, False)

    @cached_property
    def _still(self) -> _Follow:
        """Other slots that do not follow the joints."""
        return _Follow(np.zeros((len(self.others), len(self.joints))), np.eye(len(self.others)))

    def _stand(self, amounts: Sequence[float], cargo: Cargo) -> tuple[Stand, list[Triple], list[float]]:
        """Frames, gravity x axis of every slot, and gravity's loads."""
        stand = self.linkage.stand(amounts, cargo)
        levers = self.linkage.levers(stand)
        return stand, levers, self.linkage.loads(stand, levers, cargo)

    def _given_way(self, tau: Sequence[float]) -> list[float]:
        """Where the slots that are no joints want to be under loads (V,): rad."""
        return [rest + sum([k * tau[v] for v, k in springs]) for rest, springs in self.on_others]

    def _beyond(self, amounts: Sequence[float], tau: Sequence[float]) -> float:
        """How far the command, with the linear effects only, is beyond the limits at most; negative within (rad)."""
        worst = -inf
        for v, (rest, springs), lower, upper in zip(
            self.joints.tolist(), self.on_joints, *self.band.limits, strict=True
        ):
            q = amounts[v] - rest - sum([k * tau[u] for u, k in springs])
            worst = max(worst, lower - q, q - upper)
        return worst


@dataclass(frozen=True, eq=False)
class _Follow:
    """How the other slots follow the joints (W, n), and how each other's lack spreads among them (W, W)."""

    joints: Array
    spread: Array

    @classmethod
    def of(cls, one: OneStart, stand: Stand, levers: list[Triple], cargo: Cargo) -> _Follow:
        """From the slopes of the loads, as `Linkage.slopes` has them, to second order in what others do to others."""
        lever, slots = np.array(levers), range(len(levers))
        by_outer = swept(stand, cargo, slots, one.moved)
        by_inner = swept(stand, cargo, slots, one.linkage.counted)
        slopes = np.where(one.inner, lever @ by_outer.T, by_inner @ lever.T)
        if one.unmoved:
            k, j = one.behind
            left = swept(stand, cargo, j.tolist(), one.unmoved) - by_outer[j]
            slopes[k, j] -= np.einsum("pc,pc->p", lever[k], left)
        stiff = one.compliant @ slopes
        among = stiff[:, one.others]
        spread = among + among @ among
        spread.flat[:: len(among) + 1] += 1.0
        return cls(spread @ stiff[:, one.joints], spread)

    def turns(
        self, one: OneStart, screw: Array, error: Sequence[float], lacking: list[float], damping: float
    ) -> list[float]:
        """(V,), the least turns of the joints that take the error away, damped (m²) and cut to size; others follow."""
        if not lacking:
            return _least(screw, np.array(error), damping).tolist()  # type: ignore[no-any-return]
        by_other, left = screw[one.others], self.spread @ lacking
        by_joint = screw[one.joints] + self.joints.T @ by_other
        out = np.empty(len(screw))
        out[one.joints] = turn = _least(by_joint, error - left @ by_other, damping)
        out[one.others] = self.joints @ turn + left
        return out.tolist()


def _least(by_joint: Array, missing: Array, damping: float) -> Array:
    """(n,), rad: see `newton._damped`; `by_joint` (n, 6) is the Jacobian's transpose."""
    normal = by_joint.T @ by_joint
    normal.flat[::7] += damping
    turn = by_joint @ np.linalg.solve(normal, missing)
    return np.asarray(turn * (LONGEST_STEP / max(LONGEST_STEP, *map(abs, turn.tolist()))))


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


def _springs(c: Compensation, rows: Indices) -> Springs:
    return tuple(
        (float(c.steady[v]), tuple((int(u), float(c.compliances[v, u])) for u in np.flatnonzero(c.compliances[v])))
        for v in rows
    )
