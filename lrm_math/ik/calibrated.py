"""Calibrated inverse kinematics as a service uses it: one solver per deployed model, goals in, replies out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.servo_table import PwmClock
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.answer import Branch, IkVerdict
from lrm_math.ik.cube import Cube
from lrm_math.ik.goal import Goal, Rotation, rotation_rows
from lrm_math.ik.joint_laws import deployed
from lrm_math.ik.nearest import nearest
from lrm_math.ik.newton import CHAR_LENGTH, Target
from lrm_math.ik.pulse_rounding import RoundedCommand, Rounding, ServoCounts, round_to_counts
from lrm_math.ik.reply import CalibratedReply, NoAllowedBranch, NotConverged, PositionUncertainty, Solved, Unsolved
from lrm_math.ik.scalar_linkage import ScalarFrame, frame_of, matrices
from lrm_math.ik.scalar_newton import pose_residual
from lrm_math.ik.solver_context import CommandBatch, IkQuery, Method, SolverContext, Stalled
from lrm_math.ik.uncertainty import position_covariance
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.covariance import Covariance
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

SAME = 1e-6
"""rad: commands no further apart are one branch."""
CUBE = Cube()
CommandFilter: TypeAlias = Callable[[Poses, Sequence[Number]], NDArray[np.bool_]]
"""Which of K commands may be answered, (K,); given their poses and amounts of all slots near rest there."""


@dataclass(frozen=True, slots=True)
class ForwardResult:
    """Predicted tool position (m), orientation, joint torques of gravity (N·m), and uncertainty."""

    tcp: Vector3
    rotation: Rotation
    joint_torque: tuple[float, ...]
    uncertainty: PositionUncertainty | None


@dataclass(frozen=True, eq=False)
class CalibratedSolver:
    """Inverse and forward kinematics of a deployed model. Make it once with `of`; it caches what depends on the model.

    Attributes:
        left_out: ids of the model's effects that are not compensated.
        covariance: of the deployed parameters. joint_sd: (n,), rad.
        servos: the board that commands are rounded by.
    """

    context: SolverContext
    left_out: tuple[str, ...] = ()
    covariance: Covariance | None = None
    joint_sd: tuple[float, ...] | None = None
    servos: ServoCounts | None = None

    @classmethod
    def of(
        cls,
        model: Model,
        *,
        left_out: Sequence[str] = (),
        covariance: Covariance | None = None,
        joint_sd: Sequence[float] | None = None,
        clock: PwmClock | None = None,
    ) -> CalibratedSolver:
        """The solver of a model file's model.

        Args:
            left_out: effects to leave out. Those that only explain a measurement session (drift, session,
                measurement_frame) have to be named here, so that none is dropped silently.
            covariance: of the model's parameters; None if it is not known.
            joint_sd: (n,), rad, repeatability of each servo; None if it is not known.
            clock: of the servo board; None takes it from the effect `quantisation`, if the model has that.

        Raises `LrmError`: an effect that cannot be compensated and is not left out; wrong names or shapes.
        """
        smooth = deployed(model, left_out)
        if joint_sd is not None and (len(joint_sd) != model.arm.dof or not all(sd >= 0.0 for sd in joint_sd)):
            raise LrmError(f"joint_sd = {list(joint_sd)}; should be {model.arm.dof} standard deviations in rad")
        clock = clock or _clock_of(model)
        return cls(
            SolverContext(smooth),
            tuple(left_out),
            None if covariance is None else _marginal(covariance, model, smooth),
            None if joint_sd is None else tuple(float(sd) for sd in joint_sd),
            None if clock is None else ServoCounts.of(model.arm, clock),
        )

    def warm_up(self) -> None:
        """Fills the caches, so that the first goals need not wait."""
        context = self.context
        _ = context.nominal_solver, context.equivalent_arm, context.library_seeds, context.scalar_newton

    def solve(
        self,
        goal: Goal,
        payload: float = 0.0,
        near: Sequence[float] | None = None,
        method: Method = CUBE,
        rounding: Rounding = Rounding.EACH,
        allowed: CommandFilter | None = None,
    ) -> CalibratedReply:
        """Commands for one goal.

        Args:
            payload: kg.
            near: (n,), present joint angles (rad): branches nearest to them come first, and joints whose error depends
                on the side of arrival are taken to come from there.
            method: `Cube()`, `Direct()` or `Iterative()`.
            rounding: to counts, where the board's clock is known.
            allowed: which commands may be answered, for instance collision-free ones; None: all.

        Raises `LrmError`: a negative or infinite payload, or `near` that is not n finite angles.
        """
        started = time.perf_counter()
        query = IkQuery(goal, _checked_load(payload), self._checked_angles("near", near))
        found = method.find(self.context, query)
        if isinstance(found, Stalled):
            elapsed = time.perf_counter() - started
            return NotConverged(goal, found.q, found.errors, method.name, self.left_out, elapsed)
        if found is not None:
            order = in_limits = self._ordered(query, found)
            if allowed is not None and in_limits:
                free = allowed(*self._near_rest(query, found, order))
                order = [row for row, may in zip(order, free, strict=True) if may]
                if not order:
                    branches, elapsed = self._branches(found, in_limits), time.perf_counter() - started
                    return NoAllowedBranch(goal, branches, method.name, self.left_out, elapsed)
            for row in order:
                try:
                    best_first = [row, *(other for other in order if other != row)]
                    return self._solved(query, found, best_first, method.name, rounding, started)
                except NoEquilibrium:
                    continue
        return self._unsolved(query, found, method.name, started)

    def forward(self, q: Sequence[float], payload: float = 0.0, near: Sequence[float] | None = None) -> ForwardResult:
        """The tool at commands q (n,) in rad, coming from `near`.

        Raises `NoEquilibrium` if the arm does not settle there, `LrmError` unless q and near are n finite angles.
        """
        command, here = self._checked_angles("q", q), self._checked_angles("near", near)
        query = IkQuery(Goal((0.0, 0.0, 0.0)), _checked_load(payload), here)
        angles = np.array([command])
        side = None if here is None else np.sign(angles - here)
        rest = solve_equilibrium(self.context.model, self.context.poses(query, angles, side))
        rotation, torque = _columns(self._tcp(rest)), tuple(rest.joint_torque[0].tolist())
        return ForwardResult(_triple(rest.true_tcp[0]), rotation, torque, self._uncertainty(rest))

    def _ordered(self, query: IkQuery, found: CommandBatch) -> list[int]:
        """Rows of commands within the limits, best first, each branch once."""
        rows, q = np.flatnonzero(self.context.within_limits(found)).tolist(), found.q.tolist()
        near, limits = query.near, self.context.limits
        rows.sort(key=lambda row: -min(limits.margins(q[row])) if near is None else _apart(q[row], near))
        kept: list[int] = []
        for row in rows:
            if all(_apart(q[row], q[other]) > SAME for other in kept):
                kept.append(row)
        return kept

    def _solved(
        self, query: IkQuery, found: CommandBatch, order: list[int], method: str, rounding: Rounding, started: float
    ) -> Solved:
        """The reply with the rows `order` as branches, the first checked by the model's equilibrium."""
        row = order[0]
        poses, near_rest = self._near_rest(query, found, [row])
        rest = solve_equilibrium(self.context.model, poses, near_rest)
        tcp = self._tcp(rest)
        return Solved(
            goal=query.goal,
            q=tuple(poses.q[0].tolist()),
            branches=self._branches(found, order),
            tcp=_triple(rest.true_tcp[0]),
            rotation=_columns(tcp),
            predicted_error=math.dist(rest.true_tcp[0], query.goal.position),
            predicted_turn=_rotation_error(query.goal, tcp),
            uncertainty=self._uncertainty(rest),
            direction=tuple(int(side) for side in found.direction[row]),
            detours=tuple(int(joint) + 1 for joint in np.flatnonzero(found.detour[row])),
            rounded=self._rounded(query, rest, rounding),
            method=method,
            steps=found.steps,
            cube_error=found.error,
            left_out=self.left_out,
            elapsed=time.perf_counter() - started,
        )

    def _clipped(self, found: CommandBatch, rows: list[int]) -> Array:
        """(len(rows), n), commands without the round-off that leads beyond a limit."""
        bounds = self.context.bounds
        return np.asarray(np.minimum(np.maximum(found.q[rows], bounds.lower), bounds.upper))

    def _branches(self, found: CommandBatch, rows: list[int]) -> tuple[Branch, ...]:
        return tuple(Branch(tuple(q), -1, self.context.limits) for q in self._clipped(found, rows).tolist())

    def _unsolved(self, query: IkQuery, found: CommandBatch | None, method: str, started: float) -> Unsolved:
        limits, beyond = self.context.limits, np.empty((0, self.context.model.arm.dof))
        if found is not None:
            beyond = found.q[~self.context.within_limits(found)]
        branches = sorted((Branch(tuple(q), -1, limits) for q in beyond.tolist()), key=lambda branch: -branch.margin)
        violation = limits.violation(branches[0].q) if branches else None
        verdict = IkVerdict.OUTSIDE_LIMITS if branches else IkVerdict.OUT_OF_REACH
        closest = nearest(self.context, query, beyond)
        elapsed = time.perf_counter() - started
        return Unsolved(query.goal, verdict, closest, tuple(branches), violation, method, self.left_out, elapsed)

    def _near_rest(self, query: IkQuery, found: CommandBatch, rows: list[int]) -> tuple[Poses, list[Number]]:
        """Commands as poses, and amounts of all slots of the chain near rest there."""
        poses = self.context.poses(query, self._clipped(found, rows), found.direction[rows])
        return poses, self.context.chain_amounts(found.reached.amounts[rows])

    def _tcp(self, rest: Equilibrium) -> ScalarFrame:
        """Tool frame of a single pose at rest."""
        linkage, scalar = self.context.linkage, self.context.scalar_newton
        amounts = [float(rest.slots[k]) for k in linkage.slots.tolist()]
        if scalar is None:
            return frame_of(linkage.forward(np.array([amounts])).tcp[0])
        return scalar.linkage.tool_frame(amounts)

    def _uncertainty(self, rest: Equilibrium) -> PositionUncertainty | None:
        covariance = position_covariance(rest, self.covariance, self.joint_sd)
        if covariance is None:
            return None
        return PositionUncertainty(rotation_rows(covariance[0]), math.sqrt(float(np.trace(covariance[0]))))

    def _rounded(self, query: IkQuery, rest: Equilibrium, rounding: Rounding) -> RoundedCommand | None:
        if self.servos is None:
            return None
        command = rest.poses.q[0]
        joints = self.context.model.chain.joint_slots

        def position_error(q: tuple[float, ...]) -> float:
            slots = list(rest.slots)
            for k, change in zip(joints, (np.array(q) - command).tolist(), strict=True):
                slots[k] = slots[k] + change
            poses = Poses(np.array([q]), rest.poses.payload, rest.poses.direction)
            return math.dist(solve_equilibrium(self.context.model, poses, slots).true_tcp[0], query.goal.position)

        return round_to_counts(self.servos, command.tolist(), rounding, position_error, lambda: joint_jacobian(rest)[0])

    def _checked_angles(self, name: str, q: Sequence[float] | None) -> tuple[float, ...] | None:
        if q is None:
            return None
        n = self.context.model.arm.dof
        angles = tuple(float(x) for x in q)
        if len(angles) != n or not all(map(math.isfinite, angles)):
            raise LrmError(f"{name} = {list(q)}; should be {n} finite joint angles in rad")
        return angles


def _apart(q: Sequence[float], other: Sequence[float]) -> float:
    """Largest difference of a joint (rad)."""
    return max([abs(a - b) for a, b in zip(q, other, strict=True)])


def _checked_load(payload: float) -> float:
    if not (math.isfinite(payload) and payload >= 0.0):
        raise LrmError(f"payload = {payload} kg; should be a weight of zero or more")
    return float(payload)


def _clock_of(model: Model) -> PwmClock | None:
    for effect, p in model.parts():
        if effect.id == "quantisation":
            return PwmClock(p[0], p[1])
    return None


def _marginal(covariance: Covariance, model: Model, smooth: Model) -> Covariance:
    """The covariance of the deployed parameters, the others marginalised."""
    for key in covariance.keys:
        model.position(key)
    rows = [i for i, key in enumerate(covariance.keys) if key in smooth.keys]
    return Covariance(tuple(covariance.keys[i] for i in rows), covariance.matrix[np.ix_(rows, rows)])


def _triple(v: Array) -> Vector3:
    x, y, z = v.tolist()
    return x, y, z


def _columns(tcp: ScalarFrame) -> Rotation:
    ax, ay, az, bx, by, bz, cx, cy, cz = tcp[:9]
    return (ax, bx, cx), (ay, by, cy), (az, bz, cz)


def _rotation_error(goal: Goal, tcp: ScalarFrame) -> float:
    """Remaining rotation to the goal's orientation (rad)."""
    if goal.rotation is not None:
        rodrigues = math.hypot(*pose_residual(goal.rotation, goal.position, tcp)[3:]) / CHAR_LENGTH  # 2 tan(angle / 2)
        return 2.0 * math.atan(rodrigues / 2.0)
    return float(np.linalg.norm(Target.of(goal).error(matrices([tcp]))[0, 3:])) / CHAR_LENGTH
