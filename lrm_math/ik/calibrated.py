"""Calibrated inverse kinematics as a service uses it: one solver per deployed model, goals in, replies out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import checked_angles
from lrm_math.arm.pulse_rounding import RoundedCommand, Rounding, ServoCounts, round_to_counts
from lrm_math.arm.servo_table import PwmClock
from lrm_math.arrays import Vector3
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.answer import Branch, CalibratedReply, NoAllowedBranch, NotConverged, Solved, Unsolved, apart, distinct
from lrm_math.ik.calibrated_arm import (
    CalibratedArm,
    CancellationCheck,
    IkSolutions,
    Method,
    friction_of,
    nearest,
    uncancelled,
)
from lrm_math.ik.goal import Goal, IkQuery, Rotation, rotation_rows
from lrm_math.ik.methods import DEFAULT
from lrm_math.kinematics.known import Known
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.covariance import Covariance
from lrm_math.model.deployed_model import clock_of, deployed_part
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.sensed import tool_rotation
from lrm_math.model.uncertainty import PositionUncertainty, position_uncertainty

CommandFilter: TypeAlias = Callable[[IkQuery, Sequence[Branch]], NDArray[np.bool_]]
"""Which of K commands for a query may be answered, (K,)."""


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

    arm: CalibratedArm
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
                measurement_frame, depth_scale) have to be named here, so that none is dropped silently.
            covariance: of the model's parameters; None if it is not known.
            joint_sd: (n,), rad, repeatability of each servo; None if it is not known.
            clock: of the servo board; None takes it from the effect `quantisation`, if the model has that.

        Raises `LrmError`: an effect that cannot be compensated and is not left out; wrong names or shapes.
        """
        smooth = deployed_part(model, left_out)
        if joint_sd is not None and (len(joint_sd) != model.arm.dof or not all(sd >= 0.0 for sd in joint_sd)):
            raise LrmError(f"joint_sd = {list(joint_sd)}; should be {model.arm.dof} standard deviations in rad")
        clock = clock or clock_of(model)
        return cls(
            CalibratedArm(smooth),
            tuple(left_out),
            None if covariance is None else covariance.marginal(model, smooth),
            None if joint_sd is None else tuple(float(sd) for sd in joint_sd),
            None if clock is None else ServoCounts.of(model.arm, clock),
        )

    def under_gravity(self, down: Vector3) -> CalibratedSolver:
        """The solver where gravity's direction is known: a unit vector in the arm's frame."""
        return replace(self, arm=self.arm.under_gravity(down))

    def with_load_at(self, centre: Vector3) -> CalibratedSolver:
        """The solver where the load's centre is known (m), see `Arm.with_load_at`. Raises `LrmError`."""
        return replace(self, arm=self.arm.with_load_at(centre))

    def with_offsets(self, added: Mapping[str, float]) -> CalibratedSolver:
        """The solver where small amounts (rad, m) are added to constant offsets, by their keys."""
        return replace(self, arm=self.arm.with_offsets(added))

    def warm_up(self) -> None:
        """Fills the caches, so that the first goals need not wait."""
        _ = self.arm.nominal_solver, self.arm.kernel(0.0)

    def solve(
        self,
        goal: Goal,
        payload: float = 0.0,
        near: Sequence[float] | None = None,
        method: Method = DEFAULT,
        rounding: Rounding = Rounding.EACH,
        allowed: CommandFilter | None = None,
        motion: Motion | None = None,
        check_cancelled: CancellationCheck = uncancelled,
    ) -> CalibratedReply:
        """Commands for one goal.

        Args:
            payload: kg.
            near: (n,), present joint angles (rad): branches nearest to them come first, and joints whose error depends
                on the side of arrival are taken to come from there.
            method: see `methods`.
            rounding: to counts, where the board's clock is known.
            allowed: which commands may be answered, for instance collision-free ones; None: all.
            motion: record of the moves that led to `near`, from which follows the friction on arrival; None: as if the
                move to the goal were a long one.
            check_cancelled: called during the search.

        Raises `LrmError`: a negative or infinite payload, or `near` that is not n finite angles; and what
        `check_cancelled` raises.
        """
        started = time.perf_counter()
        query = IkQuery(goal, _checked_load(payload), self._angles("near", near), motion)
        reply = self._answer(query, method, rounding, allowed, check_cancelled)
        return replace(reply, left_out=self.left_out, elapsed=time.perf_counter() - started)

    def _answer(
        self, query: IkQuery, method: Method, rounding: Rounding, allowed: CommandFilter | None,
        check_cancelled: CancellationCheck,
    ) -> CalibratedReply:  # fmt: skip
        """The first command that is allowed and settles, or why there is none."""
        asked: dict[str, Any] = {"goal": query.goal, "method": method.name}
        solutions = method.find(self.arm, query, check_cancelled)
        if isinstance(solutions, NotConverged):
            return solutions
        solutions = solutions or IkSolutions((), 0)
        order = self._ordered(query, solutions)
        if allowed is not None and order:
            free = allowed(query, order)
            if not free.any():
                return NoAllowedBranch(branches=tuple(order), **asked)
            order = [branch for branch, may in zip(order, free, strict=True) if may]
        for k, branch in enumerate(order):
            tool = self.arm.tool_at(query.payload, branch.q, branch, branch.slots)
            if tool is not None:
                best_first = (branch, *order[:k], *order[k + 1 :])
                how: dict[str, Any] = {"branches": best_first, "steps": solutions.steps, "cube_error": solutions.error}
                return Solved(**asked, **how, **self._prediction(query, branch, tool, rounding))
        beyond = tuple(solutions.beyond)
        closest = nearest(self.arm, query, tuple(branch.q for branch in beyond))
        violation = self.arm.limits.violation(beyond[0].q) if beyond else None
        return Unsolved(nearest=closest, beyond=beyond, violation=violation, **asked)

    def forward(self, q: Sequence[float], payload: float = 0.0, near: Sequence[float] | None = None) -> ForwardResult:
        """The tool at commands q (n,) in rad, coming from `near`.

        Raises `NoEquilibrium` if the arm does not settle there, `LrmError` unless q and near are n finite angles.
        """
        command, here = checked_angles("q", q, self.arm.packed.joints), self._angles("near", near)
        arrival = Motion.at(command) if here is None else Motion.between(here, command)
        return self.predicted(Known().poses(arrival, _checked_load(payload)))

    def predicted(self, pose: Poses) -> ForwardResult:
        """The tool at one pose, with what is known of its circumstances. Raises `NoEquilibrium`."""
        settled = solve_equilibrium(self.arm.model, pose)
        rotation = rotation_rows(tool_rotation(settled)[0])
        x, y, z = settled.true_tcp[0].tolist()
        uncertainty = position_uncertainty(settled, self.covariance, self.joint_sd)
        return ForwardResult((x, y, z), rotation, tuple(settled.joint_torque[0].tolist()), uncertainty)

    def _angles(self, name: str, q: Sequence[float] | None) -> tuple[float, ...] | None:
        return None if q is None else checked_angles(name, q, self.arm.packed.joints)

    def _ordered(self, query: IkQuery, solutions: IkSolutions) -> list[Branch]:
        """Commands within the limits, best first, each branch once, without the round-off that leads beyond a limit."""
        near, limits = query.near, self.arm.limits
        commands = sorted(solutions.within, key=lambda c: -c.margin if near is None else apart(c.q, near))
        return [c._replace(q=limits.clipped(c.q), margin=max(c.margin, 0.0)) for c in distinct(commands)]

    def _prediction(self, query: IkQuery, branch: Branch, tool: list[float], rounding: Rounding) -> dict[str, Any]:
        """Reply part of the first branch, whose equilibrium takes the tool to a frame given by columns."""
        x, y, z = tool[9:]
        rotation, rounded = _rotation(tool), self._rounded(query, branch, rounding)
        there = None if rounded is None else self.arm.tool_at(query.payload, rounded.q, branch, branch.slots)
        return {
            "tcp": (x, y, z), "rotation": rotation, "predicted_error": math.dist((x, y, z), query.goal.position),
            "predicted_turn": query.goal.angle_from(rotation), "uncertainty": self._uncertainty_of(query, branch),
            "rounded": rounded, "rounded_turn": None if there is None else query.goal.angle_from(_rotation(there)),
        }  # fmt: skip

    def _uncertainty_of(self, query: IkQuery, branch: Branch) -> PositionUncertainty | None:
        if self.covariance is None and self.joint_sd is None:
            return None
        side = np.array([branch.direction], dtype=np.float64)
        poses = poses_of(branch.q, query.payload, side, friction_of([branch]))
        settled = solve_equilibrium(self.arm.model, poses, self.arm.chain_amounts(np.array([branch.slots])))
        return position_uncertainty(settled, self.covariance, self.joint_sd)

    def _rounded(self, query: IkQuery, branch: Branch, rounding: Rounding) -> RoundedCommand | None:
        if self.servos is None:
            return None

        def position(angles: tuple[float, ...]) -> list[float]:
            """m, of the tool in equilibrium. Raises `NoEquilibrium`."""
            tool = self.arm.tool_at(query.payload, angles, branch, branch.slots)
            if tool is None:
                raise NoEquilibrium([1], "the arm does not settle at the rounded command")
            return tool[9:]

        return round_to_counts(self.servos, branch.q, rounding, position, query.goal.position)


def _rotation(tool: Sequence[float]) -> Rotation:
    """Rows of the rotation of a tool frame by columns, twelve numbers."""
    ax, ay, az, bx, by, bz, cx, cy, cz = tool[:9]
    return (ax, bx, cx), (ay, by, cy), (az, bz, cz)


def _checked_load(payload: float) -> float:
    if not (math.isfinite(payload) and payload >= 0.0):
        raise LrmError(f"payload = {payload} kg; should be a weight of zero or more")
    return float(payload)
