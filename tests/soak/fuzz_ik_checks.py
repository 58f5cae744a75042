"""Checks of inverse kinematics answers by model, limits, collision shapes and servo tables alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.ik.goal import Goal
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.moving_slots import Indices
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import TOLERANCE, batch_equilibrium
from lrm_math.model.model import Model
from lrmd.ik.service import goal_of
from lrmd.messages.kinematics import IkAnswer, IkRequest
from tests.soak.fuzz_ik_queries import ServiceUnderTest

EXACT, TURNED = 1e-6, 1e-5
"""m and rad: the worst that a direct or cube answer may be off by the model's own equilibrium."""
CLOSE = 1e-3
"""m: the same for the thesis's first method, which is not polished."""
DETOUR = 0.1
"""rad: a joint further from its target than this approaches it from the side on which it is."""
ROUND_OFF = 1e-9
"""m, of a distance."""


@dataclass(frozen=True)
class AnsweredGoal:
    """One goal, by its number in a request, and its answer."""

    request: IkRequest
    number: int
    answer: IkAnswer

    @property
    def goal(self) -> Goal:
        """The goal."""
        return goal_of(self.request.goals[self.number])

    @property
    def polished(self) -> bool:
        """Whether the method ends with Newton's."""
        return self.request.method != "iterative"

    def __str__(self) -> str:
        return f"{self.request} goal {self.number}: {self.answer}"


@dataclass
class CommandErrors:
    """How many commands were checked, and the error (m) of the worst polished one."""

    commands: int = 0
    worst: float = 0.0


@dataclass(frozen=True, eq=False)
class IkCommand:
    """One branch of an answer: q (n,) in rad, the sides that the joints come from, whether it is the first."""

    answered: AnsweredGoal
    q: Array
    direction: Array
    first: bool

    @property
    def certain(self) -> bool:
        """Whether it is known which side its joints come from: an answer tells that of its first branch."""
        near = self.answered.request.near_rad
        return self.first or near is None or float(np.abs(self.q - near).min()) > DETOUR


def check(subject: ServiceUnderTest, answers: list[AnsweredGoal], errors: CommandErrors) -> Iterator[str]:
    """One line for everything that is wrong with the answers of one model."""
    solved = [s for s in answers if s.answer.verdict == "solved"]
    commands = [command for s in solved for command in commands_of(s)]
    if commands:
        yield from check_commands(subject, commands, errors)
        yield from check_counts(subject, solved)
    yield from check_nearest(subject, [s for s in answers if s.answer.verdict != "solved"])


def commands_of(answered: AnsweredGoal) -> Iterator[IkCommand]:
    """The branches of an answer."""
    near = answered.request.near_rad
    for k, branch in enumerate(answered.answer.branches_rad):
        q = np.array(branch)
        side = np.zeros(len(q)) if near is None else np.sign(q - near)
        yield IkCommand(answered, q, np.array(answered.answer.direction, dtype=float) if k == 0 else side, k == 0)


def check_commands(subject: ServiceUnderTest, commands: list[IkCommand], errors: CommandErrors) -> Iterator[str]:
    """Limits, distances, and where the tool is."""
    q = np.array([command.q for command in commands])
    joints, margin = subject.model.arm.joints, Scene.of(subject.model.arm).margin
    inside = np.all((q >= [j.lower for j in joints]) & (q <= [j.upper for j in joints]), axis=1)
    loads = loads_of([command.answered for command in commands])
    equilibria = CheckedEquilibria.of(
        subject.model, Poses(q, loads, np.array([command.direction for command in commands]))
    )
    errors.commands += len(q)
    for k, command in enumerate(commands):
        answered = command.answered
        off, turn = pose_errors(equilibria.tool[k], answered.goal)
        if not inside[k]:
            yield f"outside the limits: {answered}"
        if not equilibria.distance[k] >= margin - (ROUND_OFF if command.certain else CLOSE):
            yield f"{equilibria.distance[k] * 1e3:.3f} mm apart: {answered}"
        if command.certain and not off <= (EXACT if answered.polished else CLOSE):
            yield f"off by {off * 1e3:.2e} mm: {answered}"
        if command.certain and answered.polished and not turn <= TURNED:
            yield f"turned by {turn:.2e} rad: {answered}"
        if command.first and not abs((answered.answer.predicted_error_m or 0.0) - off) <= EXACT:
            yield f"off by {off * 1e3:.2e} mm, not as it says: {answered}"
        if command.certain and answered.polished and math.isfinite(off):
            errors.worst = max(errors.worst, off)


@dataclass(frozen=True, eq=False)
class CheckedEquilibria:
    """Equilibria of N commands: `distance` (N,) of the closest bodies (m), rigid or bent, and `tool` (N, 4, 4).

    Without an equilibrium the distance is minus infinity and the tool infinite.
    """

    distance: Array
    tool: Array

    @classmethod
    def of(cls, model: Model, poses: Poses) -> CheckedEquilibria:
        """By the model's own equilibrium, from the start."""
        scene, distance = Scene.of(model.arm), np.full(len(poses), -np.inf)
        bent, rows = frames_at(model, poses)
        if len(rows):
            distance[rows] = clearance_of(scene, bent[rows]).distance
        return cls(np.asarray(np.minimum(distance, clearance_of(scene, scene.frames(poses.q)).distance)), bent[:, -1])


def frames_at(model: Model, poses: Poses) -> tuple[Array, Indices]:
    """(N, F, 4, 4), all frames at rest, the tool's last, infinite where the arm comes to none; and where it does.

    Arms of high compliance converge so slowly that round-off decides whether the last allowed step is short enough:
    they have a wider tolerance here.
    """
    out, moving = np.full((len(poses), model.arm.dof + 2, 4, 4), np.inf), np.arange(len(poses))
    for tolerance in (TOLERANCE, 10.0 * TOLERANCE):
        if len(moving):
            equilibrium, rows = batch_equilibrium(model, poses.take(moving), tolerance=tolerance)
            if len(rows):
                out[moving[rows]] = frames(model.chain, equilibrium.slots, len(rows))
            moving = np.delete(moving, rows)
    return out, np.setdiff1d(np.arange(len(poses)), moving)


def pose_errors(tool: Array, goal: Goal) -> tuple[float, float]:
    """How far a tool's frame (4, 4) is from a goal: m, and rad of what the goal says of the orientation."""
    off = math.dist(tool[:3, 3], goal.position)
    if goal.rotation is not None:
        return off, float(np.linalg.norm(tool[:3, :3] - np.array(goal.rotation))) / math.sqrt(2.0)
    return off, 0.0 if goal.approach is None else float(np.linalg.norm(tool[:3, 2] - np.array(goal.approach)))


def check_counts(subject: ServiceUnderTest, solved: list[AnsweredGoal]) -> Iterator[str]:
    """Whether the counts leave the error that the answers say."""
    tables = [joint.servo for joint in subject.model.arm.joints if joint.servo is not None]
    pulses = [[subject.clock.pulse_of(count) for count in s.answer.counts or []] for s in solved]
    angles = [[float(t.angle_of(p)) for t, p in zip(tables, row, strict=True)] for row in pulses]
    side = np.array([s.answer.direction for s in solved], dtype=float)
    tools = frames_at(subject.model, Poses(np.array(angles), loads_of(solved), side))[0][:, -1]
    for tool, s in zip(tools, solved, strict=True):
        off = math.dist(tool[:3, 3], s.goal.position)
        if not abs(off - (s.answer.rounded_error_m or 0.0)) <= EXACT:
            yield f"the counts leave {off * 1e3:.2e} mm, not as it says: {s}"


def check_nearest(subject: ServiceUnderTest, unsolved: list[AnsweredGoal]) -> Iterator[str]:
    """Whether answers without a solution have no command but a nearest one, and that one is as near as they say, where
    the arm comes from `near_rad`."""
    for s in unsolved:
        if s.answer.q_rad is not None or s.answer.branches_rad or not s.answer.text:
            yield f"commands without a solution, or no reason: {s}"
    proposing = [s for s in unsolved if s.answer.nearest_rad is not None]
    if not proposing:
        return
    q, joints = np.array([s.answer.nearest_rad for s in proposing]), subject.model.arm.joints
    inside = np.all((q >= [j.lower for j in joints]) & (q <= [j.upper for j in joints]), axis=1)
    near = np.array([s.request.near_rad or s.answer.nearest_rad for s in proposing])
    tools = frames_at(subject.model, Poses(q, loads_of(proposing), np.sign(q - near)))[0][:, -1]
    for tool, within, s in zip(tools, inside, proposing, strict=True):
        if not within:
            yield f"nearest outside the limits: {s}"
        if not abs(math.dist(tool[:3, 3], s.goal.position) - (s.answer.nearest_distance_m or 0.0)) <= EXACT:
            yield f"nearest is elsewhere: {s}"


def loads_of(answered: list[AnsweredGoal]) -> Array:
    """(N,), kg."""
    return np.array([s.request.payload_kg or 0.0 for s in answered])
