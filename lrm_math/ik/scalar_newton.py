"""Newton's method from one start, most of it in scalar Python: as `newton` does it for many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Rotation, Triple
from lrm_math.ik.joint_laws import Compensation
from lrm_math.ik.linkage import Burden, Indices
from lrm_math.ik.newton import (
    CLOSE,
    FLAT,
    LEVER,
    LONGEST_STEP,
    MOST_STEPS,
    TINY,
    Band,
    Effort,
    Reached,
)
from lrm_math.ik.scalar_linkage import Cargo, Frame, OneLinkage, matrices, screws, twist

DAMPING = 1e-3
NEARLY = 1e-5
"""m: starts that miss less are followed to the end."""
QUICK, SLOW, STALLED = 4, 0.5, 1e-3
"""After so many steps, one that leaves more than this share of the error is slow; m: this close it is helped on."""
NUDGE = 1e-5
"""rad, a turn that tells how the other slots follow."""
STEADY = 0.01
"""The Jacobian is kept where the last one made the error this much smaller, at least."""
HOPELESS = 0.2
"""rad: a step that leads this far beyond the limits is not worth following while there are other starts; nor one that
leads further beyond than it turned any joint and effects that are not linear may make up for."""


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
class Springs:
    """Slots that give way in proportion to loads.

    `numbers`: of the slots. `first`: what each has without load (rad), by how much it gives way (rad/N·m), and to which
    slot's load. `more`: further loads, each with the place among the slots, rad/N·m, and the number of the load's slot.
    """

    numbers: tuple[int, ...]
    first: tuple[tuple[float, float, int], ...]
    more: tuple[tuple[int, float, int], ...]

    @classmethod
    def of(cls, c: Compensation, rows: Indices) -> Springs:
        """With the linear effects of a model."""
        feels = [np.flatnonzero(c.compliances[v]).tolist() or [0] for v in rows]
        first = [(float(c.steady[v]), float(c.compliances[v, u[0]]), u[0]) for v, u in zip(rows, feels, strict=True)]
        more = [
            (i, float(c.compliances[v, u]), u)
            for i, (v, us) in enumerate(zip(rows, feels, strict=True))
            for u in us[1:]
        ]
        return cls(tuple(rows.tolist()), tuple(first), tuple(more))

    def given_way(self, tau: Sequence[float]) -> list[float]:
        """Where the slots are under loads (V,) with joints at command zero: rad."""
        out = [rest + k * tau[u] for rest, k, u in self.first]
        for i, k, u in self.more:
            out[i] += k * tau[u]
        return out


@dataclass(frozen=True, eq=False)
class OneStart:
    """A deployed model's arm, with what else one start needs.

    `joints`, `others`: the moving slots that are joints, and the others, with what their linear effects make of loads.
    `wide`: m, by which others' turns count. `bent`: rad, what effects that are not linear make of a command at most.
    """

    linkage: OneLinkage
    joints: Springs
    others: Springs
    wide: float
    band: Band
    bent: float

    @classmethod
    def of(cls, c: Compensation, band: Band, bent: float) -> OneStart | None:
        """For a model; None where slots are translations, or others than joints follow more than linear springs."""
        linkage = OneLinkage.of(c.linkage)
        if linkage is None or not c.others_are_springs:
            return None
        joints, others = Springs.of(c, c.linkage.joints), Springs.of(c, c.linkage.others)
        return cls(linkage, joints, others, c.model.wiring.reach, band, bent)

    def reach_all(
        self, rotation: Rotation, position: Triple, burden: Burden, starts: Sequence[list[float]], effort: Effort
    ) -> Reached:
        """Where amounts (K, V) lead to, one after the other until `enough` are at the goal within the limits."""
        cargo, ends, good = self.linkage.cargo(burden), list[End](), 0
        for start in starts:
            ends.append(self.reach(rotation, position, cargo, start, effort))
            good += self._is_good(ends[-1])
            if good == effort.enough:
                break
        return Reached(
            np.array([end.amounts for end in ends]),
            np.array([end.tau for end in ends]).T,
            np.array([end.miss for end in ends]),
            matrices([end.tcp for end in ends]),
            np.array([end.left for end in ends]),
            max(end.steps for end in ends),
        )

    def reach(self, rotation: Rotation, position: Triple, cargo: Cargo, start: Sequence[float], effort: Effort) -> End:
        """As `newton.reach` from amounts (V,), for a pose.

        The other slots go where loads have them, and the joints make up for that; what the joints' steps do to those
        loads in turn is a small share, and left to the next step. Close to a goal where that is slow, as near folds,
        it is reckoned with.
        """
        joints, others = self.joints.numbers, self.others.numbers
        amounts, before, seen_from = list(start), inf, 0.0
        follow: Array | None = None
        trail: list[float] = []
        damping = DAMPING
        for step in range(MOST_STEPS + 1):
            stand = self.linkage.stand(amounts, cargo)
            tau = stand.tau
            error = way(rotation, position, stand.tcp)
            square = sum([e * e for e in error])
            there = self.others.given_way(tau)
            lacking = [(v, to - amounts[v]) for v, to in zip(others, there, strict=True)]
            miss = sqrt(square) + self.wide * sum([abs(turn) for _, turn in lacking])
            trail.append(miss)
            stuck = len(trail) > effort.patience and miss > 0.5 * trail[-1 - effort.patience]
            slow = stuck or (step > QUICK and miss > SLOW * before)
            if slow and others and miss < STALLED and follow is None:
                follow = self._follow(amounts, there, cargo)
                stuck, trail, seen_from = False, [miss], 0.0
            if miss <= CLOSE or stuck or step == MOST_STEPS:
                break
            damping = 30.0 * damping if miss > before else max(0.3 * damping, DAMPING)
            before = miss
            if miss > STEADY * seen_from:
                by_joint = screws(stand, joints, LEVER)
                if follow is not None:
                    by_joint += follow @ screws(stand, others, LEVER)
                inverse, seen_from = _inverse(by_joint, damping * square + TINY), miss
            led = twist(stand, lacking, LEVER)
            turns = _cut(inverse @ np.array([e - d for e, d in zip(error, led, strict=True)]))
            for v, turn in lacking if follow is None else _led(turns, follow, lacking):
                amounts[v] += turn
            for v, turn in zip(joints, turns, strict=True):
                amounts[v] += turn
            if effort.within and miss > NEARLY:
                hope = min(HOPELESS, self.bent + max(map(abs, turns)))
                if self._beyond(amounts, tau) > hope:
                    return End(amounts, tau, stand.tcp, miss, step, True)
        return End(amounts, tau, stand.tcp, miss, step, False)

    def _follow(self, amounts: Sequence[float], there: Sequence[float], cargo: Cargo) -> Array:
        """(n, W), how the other slots, which want to be `there` now, follow a turn of each joint (rad/rad)."""
        rows = []
        for v in self.joints.numbers:
            nudged = list(amounts)
            nudged[v] += NUDGE
            then = self.others.given_way(self.linkage.stand(nudged, cargo).tau)
            rows.append([(to - now) / NUDGE for to, now in zip(then, there, strict=True)])
        return np.array(rows)

    def _is_good(self, end: End) -> bool:
        """Whether the goal is met within the limits, or perhaps so."""
        return end.met and self._beyond(end.amounts, end.tau) <= self.bent

    def _beyond(self, amounts: Sequence[float], tau: Sequence[float]) -> float:
        """How far the command, with the linear effects only, is beyond the limits at most; negative within (rad)."""
        worst = -inf
        joints = self.joints
        for v, bent, lower, upper in zip(joints.numbers, joints.given_way(tau), *self.band.limits, strict=True):
            q = amounts[v] - bent
            worst = max(worst, lower - q, q - upper)
        return worst


def _led(turns: list[float], follow: Array, lacking: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
    """Numbers and turns of the other slots: where turns of the joints (n,) lead them, and what they lack (rad)."""
    return [(v, lack + more) for (v, lack), more in zip(lacking, (turns @ follow).tolist(), strict=True)]


def _inverse(by_joint: Array, damping: float) -> Array:
    """(n, 6), from an error to the least turns of the joints that take it away, damped (m²).

    `by_joint`: (n, 6), the Jacobian's transpose.
    """
    normal = by_joint.T @ by_joint
    normal.flat[::7] += damping
    return np.asarray(by_joint @ np.linalg.inv(normal))


def _cut(turns: Array) -> list[float]:
    """The same turns (n,), cut to size."""
    out: list[float] = turns.tolist()
    largest = max(map(abs, out))
    return out if largest <= LONGEST_STEP else [turn * (LONGEST_STEP / largest) for turn in out]


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
