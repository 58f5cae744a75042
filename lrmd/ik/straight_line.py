"""Straight lines of the tip: commands along which the sagging arm's tool goes straight, turning evenly or not at all.

Theory of operation: goals along the line are solved one after the other, each nearest to the one before, so that the
branch is kept. The joints move evenly from command to command, so between two of them the tip bows: where it leaves the
line by more than is allowed, another command goes between, until it does not. What the tip does between is computed by
the model's elastic equilibrium, with the moves that led there. Each command is that of the arm as it is when it arrives
there: an arm that warms up, or remembers, changes on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.answer import Solved, apart
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import CancellationCheck
from lrm_math.ik.goal import Goal, pose
from lrm_math.ik.methods import QUICKEST
from lrm_math.kinematics.known import Known
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.sensed import tool_rotation
from lrmd.ik.planner import NoPlan

TOLERANCE, TURN_TOLERANCE = 5e-4, 0.02
"""m, rad: how far the tip may leave the line, and the tool its orientation there."""
SHARE = 0.6
"""Share of the tolerances that is used: the rest is for what lies between the places looked at."""
STEP, TURN_STEP = 0.01, 0.15
"""m, rad: largest distance of the first commands."""
LEAST_SHARE = 1e-4
"""Share of the line below which no further command is put between two."""
JUMP = 0.3
"""rad: largest turn of a joint between neighbours; more is another branch, or a singular pose between them."""
AT_LIMIT = 0.01
"""rad: a joint nearer to its limit is the reason why a line ends."""
BETWEEN = np.array([0.25, 0.5, 0.75])
MOST_COMMANDS = 1000
PASSES, ARRIVED = 4, 1e-5
"""Of the iteration for the state at arrival: its largest number, and the change of the commands that ends it (rad)."""


@dataclass(frozen=True, eq=False)
class Waypoint:
    """An arm at a command: what is known of it there, and the solver of its state there."""

    known: Known
    solver: CalibratedSolver

    @classmethod
    def of(cls, solver: CalibratedSolver, motion: Motion) -> Waypoint:
        """An arm of which the moves so far are known, and neither time nor memory."""
        return cls(Known(motion), solver)

    @property
    def motion(self) -> Motion:
        """Record of its moves, up to there."""
        assert self.known.motion is not None
        return self.known.motion


Follow: TypeAlias = Callable[[Waypoint, Motion], Waypoint]
"""The arm at the end of a straight move, by the record of its moves after it."""


def unchanged(before: Waypoint, motion: Motion) -> Waypoint:
    """The arm after a move, in the state that it was in before."""
    return Waypoint(replace(before.known, motion=motion), before.solver)


@dataclass(frozen=True)
class LineEnd(NoPlan):
    """End of a line (`at`, m) that does not go on to its goal, and why."""

    at: Vector3


@dataclass(frozen=True, eq=False)
class ToolLine:
    """Goals from a tool frame to another: `ends` (2, 3) in m; `turn` (3,), rotation vector in the first frame of the
    whole turn; `start` (3, 3) its orientation there, None where the orientation is free."""

    ends: Array
    start: Array | None
    turn: Array

    @classmethod
    def to(cls, tcp: Array, rotation: Array, goal: Goal, holds_orientation: bool) -> ToolLine:
        """The line from a tool at tcp (3,), m, with a rotation (3, 3), to a goal: by the shortest turn to its
        orientation or approach; without either the orientation stays, if the arm can hold one."""
        ends = np.array([tcp, goal.position])
        if goal.rotation is not None:
            return cls(ends, rotation, rotation_vector(rotation.T @ np.array(goal.rotation)))
        if goal.approach is not None:
            return cls(ends, rotation, rotation.T @ _between(rotation[:, 2], np.array(goal.approach)))
        return cls(ends, rotation if holds_orientation else None, np.zeros(3))

    @property
    def length(self) -> float:
        """m."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    def place(self, share: float) -> Array:
        """(3,), m, at a share of the line."""
        return np.asarray(self.ends[0] + share * (self.ends[1] - self.ends[0]))

    def rotation(self, share: float) -> Array:
        """(3, 3), orientation at a share of the line."""
        assert self.start is not None
        return np.asarray(self.start @ rotation_of(share * self.turn))

    def goal(self, share: float) -> Goal:
        """The goal at a share of the line."""
        x, y, z = self.place(share).tolist()
        return Goal((x, y, z)) if self.start is None else pose((x, y, z), self.rotation(share))

    def first_shares(self) -> list[float]:
        """Shares at which it is solved first."""
        count = math.ceil(max(self.length / STEP, float(np.linalg.norm(self.turn)) / TURN_STEP, 1.0))
        return [float(share) for share in np.linspace(0.0, 1.0, count + 1)[1:]]

    def deviation(self, tips: Array, rotations: Array) -> float:
        """The largest deviation of tips (N, 3), m, and orientations (N, 3, 3), as a share of the tolerances."""
        along = self.ends[1] - self.ends[0]
        share = np.clip((tips - self.ends[0]) @ along / max(float(along @ along), 1e-18), 0.0, 1.0)
        off = float(np.linalg.norm(tips - self.ends[0] - share[:, None] * along, axis=1).max()) / TOLERANCE
        if self.start is None or self.length < STEP:
            return off
        turned = [
            float(np.linalg.norm(rotation_vector(self.rotation(s).T @ R)))
            for s, R in zip(share.tolist(), rotations, strict=True)
        ]
        return max(off, max(turned) / TURN_TOLERANCE)


def line_path(
    begin: Waypoint, payload: float, goal: Goal, check_cancelled: CancellationCheck, follow: Follow = unchanged
) -> list[tuple[float, ...]] | LineEnd:
    """Commands (rad), the present one included, along which the tool goes straight to a goal with a payload (kg), or
    where such a line ends.

    Args:
        begin: the arm where the line begins. follow: its state after a move; unchanged where it neither warms up nor
            remembers.

    Raises `NoEquilibrium`: the arm does not settle where it stands.
    """
    tips, rotations = _tools(begin.solver, payload, [begin.motion])
    line = ToolLine.to(tips[0], rotations[0], goal, len(begin.motion.q) >= 6)
    shares, path = [0.0], [begin]
    waiting = line.first_shares()[::-1]
    while waiting:
        check_cancelled()
        share, before = waiting[-1], shares[-1]
        step_to = _next(follow, payload, line, share, path[-1])
        reason = step_to.text if isinstance(step_to, NoPlan) else _bend(payload, line, path[-1], step_to)
        if reason:
            if share - before <= LEAST_SHARE or len(path) + len(waiting) > MOST_COMMANDS:
                x, y, z = line.place(before).tolist()
                where = f"after {before * line.length * 1e3:.1f} of {line.length * 1e3:.1f} mm"
                why = _at_limit(path[-1]) or reason
                return LineEnd(f"no straight line: it ends {where}: {why}", (x, y, z))
            waiting.append(0.5 * (before + share))
            continue
        assert isinstance(step_to, Waypoint)
        waiting.pop()
        shares.append(share)
        path.append(step_to)
    return [tuple(waypoint.motion.q.tolist()) for waypoint in path]


def _next(follow: Follow, payload: float, line: ToolLine, share: float, before: Waypoint) -> Waypoint | NoPlan:
    """The arm after a move on to a share of the line, by fixed-point iteration for its state there; or why not."""
    here, goal, solver = before.motion.q, line.goal(share), before.solver
    after, q = before, here
    for _ in range(PASSES):
        try:
            reply = solver.solve(goal, payload, here.tolist(), QUICKEST, motion=before.motion)
        except LrmError as error:
            return NoPlan(str(error))
        if not isinstance(reply, Solved):
            return NoPlan(str(reply))
        last, q = q, np.array(min(reply.branches, key=lambda branch: np.abs(np.array(branch.q) - here).max()).q)
        turned = np.abs(q - here)
        joint = int(turned.argmax())
        if turned[joint] > JUMP:
            degrees = math.degrees(turned[joint])
            why = "a singular pose, or the end of its branch"
            return NoPlan(f"joint {joint + 1} would have to jump by {degrees:.0f} deg: {why}")
        after = follow(before, before.motion.to(q))
        if after.solver is solver or apart(q.tolist(), last.tolist()) < ARRIVED:
            break
        solver = after.solver
    return after


def _at_limit(at: Waypoint) -> str:
    """Words for the joint that stands at its limit, of an arm whose line ends there; empty if none does."""
    joints = at.solver.arm.model.arm.joints
    for number, (joint, q) in enumerate(zip(joints, at.motion.q.tolist(), strict=True), start=1):
        if min(q - joint.lower, joint.upper - q) < AT_LIMIT:
            limit = joint.lower if q - joint.lower < joint.upper - q else joint.upper
            return f"joint {number} is at its limit of {math.degrees(limit):g} deg"
    return ""


def _bend(payload: float, line: ToolLine, before: Waypoint, after: Waypoint) -> str:
    """Why the tip's way between two commands is not straight enough; empty if it is."""
    here = before.motion
    ways = [here.to(here.q + share * (after.motion.q - here.q)) for share in BETWEEN]
    try:
        off = line.deviation(*_tools(after.solver, payload, [*ways, after.motion]))
    except NoEquilibrium as error:
        return str(error)
    return "" if off <= SHARE else f"the tip would leave it by {off * TOLERANCE * 1e3:.2f} mm where joints turn round"


def _tools(solver: CalibratedSolver, payload: float, records: Sequence[Motion]) -> tuple[Array, Array]:
    """(N, 3), tips in m, and (N, 3, 3), orientations, at the ends of records. Raises `NoEquilibrium`."""
    q, side, friction = (np.array([getattr(record, name) for record in records]) for name in ("q", "side", "friction"))
    settled = solve_equilibrium(solver.arm.model, poses_of(q, payload, side, friction))
    return settled.true_tcp, np.asarray(tool_rotation(settled))


def rotation_of(vector: Array) -> Array:
    """(3, 3), rotation by a rotation vector (3,) in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K)


def rotation_vector(R: Array) -> Array:
    """(3,), rotation vector (rad) of a rotation matrix; of a half turn one of its two."""
    skew = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(R)) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        return np.asarray(skew * (angle / sine))
    if cosine > 0.0:
        return skew
    axis = np.sqrt(np.maximum(0.5 * (np.diag(R) + 1.0), 0.0))
    largest = int(axis.argmax())
    signs = np.sign(R[largest])
    signs[largest] = 1.0
    return np.asarray(math.pi * axis * np.where(signs == 0.0, 1.0, signs))


def _between(a: Array, b: Array) -> Array:
    """(3,), rotation vector (rad) of the shortest turn from unit vector a to b."""
    normal = np.cross(a, b)
    sine = float(np.linalg.norm(normal))
    if sine < 1e-9:
        across = np.cross(a, np.eye(3)[int(np.abs(a).argmin())])
        return np.zeros(3) if float(a @ b) > 0.0 else np.asarray(math.pi * across / np.linalg.norm(across))
    return np.asarray(normal / sine * math.atan2(sine, float(a @ b)))
