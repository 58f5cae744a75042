"""The calibrated inverse as a service uses it: one solver per deployed model, goals in, replies out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.servo_table import PwmClock
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NotSettled
from lrm_math.ik.answer import Branch, Verdict, Violation
from lrm_math.ik.cube import Cube
from lrm_math.ik.goal import Goal, Rotation, Triple
from lrm_math.ik.joint_laws import deployed
from lrm_math.ik.nearest import nearest
from lrm_math.ik.newton import LEVER, Aim
from lrm_math.ik.pulse_rounding import Rounded, Rounding, Servos, rounded
from lrm_math.ik.reply import Barred, NotConverged, Reply, Solved, Spread, Unsolved
from lrm_math.ik.scalar_linkage import Frame, frame_of, matrices
from lrm_math.ik.scalar_newton import way
from lrm_math.ik.solver_context import Ask, Deployment, Found, Method, Stalled
from lrm_math.ik.uncertainty import position_covariance
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.covariance import Covariance
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import Equilibrium, settle
from lrm_math.model.model import Model

SAME = 1e-6
"""rad: commands no further apart are one branch."""
CUBE = Cube()
Allowed: TypeAlias = Callable[[Poses, Sequence[Number]], NDArray[np.bool_]]
"""Which of K commands may be answered, (K,); with amounts of all slots that are near those at rest there."""


@dataclass(frozen=True, slots=True)
class Forward:
    """Where the model says that the tool is: position (m), orientation, gravity's joint torques (N·m), spread."""

    tcp: Triple
    rotation: Rotation
    joint_torque: tuple[float, ...]
    spread: Spread | None


@dataclass(frozen=True, eq=False)
class CalibratedSolver:
    """Goals to commands, and back, with a deployed model. Make it once with `of`; it keeps what it has reckoned.

    Attributes:
        left_out: ids of the model's effects that are not compensated.
        covariance: of the deployed parameters. joint_sd: (n,), rad.
        servos: the board that commands are rounded by.
    """

    deployment: Deployment
    left_out: tuple[str, ...] = ()
    covariance: Covariance | None = None
    joint_sd: tuple[float, ...] | None = None
    servos: Servos | None = None

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
            joint_sd: (n,), rad, how well each servo repeats a command; None if it is not known.
            clock: of the servo board; None takes it from the effect `quantisation`, if the model has that.

        Raises:
            LrmError: an effect that cannot be compensated and is not left out; wrong names or shapes.
        """
        smooth = deployed(model, left_out)
        if joint_sd is not None and (len(joint_sd) != model.arm.dof or not all(sd >= 0.0 for sd in joint_sd)):
            raise LrmError(f"joint_sd = {list(joint_sd)}; should be {model.arm.dof} standard deviations in rad")
        clock = clock or _clock_of(model)
        return cls(
            Deployment(smooth),
            tuple(left_out),
            None if covariance is None else _of_the_deployed(covariance, model, smooth),
            None if joint_sd is None else tuple(float(sd) for sd in joint_sd),
            None if clock is None else Servos.of(model.arm, clock),
        )

    def warm_up(self) -> None:
        """Reckons beforehand what the first goals would wait for."""
        deployment = self.deployment
        _ = deployment.drawing, deployment.likeness, deployment.leaps, deployment.one_start

    def solve(
        self,
        goal: Goal,
        payload: float = 0.0,
        near: Sequence[float] | None = None,
        method: Method = CUBE,
        rounding: Rounding = Rounding.EACH,
        allowed: Allowed | None = None,
    ) -> Reply:
        """Commands for one goal.

        Args:
            payload: load carried (kg).
            near: (n,), angles that the arm stands at (rad): branches nearest to them come first, and joints whose
                error depends on the side that they arrive from are taken to come from there.
            method: `Cube()`, `Direct()` or `Iterative()`.
            rounding: how commands become counts, where the board's clock is known.
            allowed: which commands may be answered, for instance those that keep the arm clear; None: all.

        Raises:
            LrmError: a load that is no weight, or `near` that is not n finite angles.
        """
        started = time.perf_counter()
        ask = Ask(goal, _checked_load(payload), self._checked_angles("near", near))
        found = method.find(self.deployment, ask)
        if isinstance(found, Stalled):
            spent = time.perf_counter() - started
            return NotConverged(goal, found.q, found.errors, method.name, self.left_out, spent)
        if found is not None:
            order = in_limits = self._ordered(ask, found)
            if allowed is not None and in_limits:
                free = allowed(*self._standing(ask, found, order))
                order = [row for row, may in zip(order, free, strict=True) if may]
                if not order:
                    return self._barred(ask, found, in_limits, method.name, started)
            for row in order:
                try:
                    best_first = [row, *(other for other in order if other != row)]
                    return self._solved(ask, found, best_first, method.name, rounding, started)
                except NotSettled:
                    continue
        return self._unsolved(ask, found, method.name, started)

    def forward(self, q: Sequence[float], payload: float = 0.0, near: Sequence[float] | None = None) -> Forward:
        """Where the tool is for commands q (n,) in rad, coming from `near`.

        Raises:
            NotSettled: the arm comes to no rest that the model could speak of.
            LrmError: numbers that are not finite, or not n of them.
        """
        command, here = self._checked_angles("q", q), self._checked_angles("near", near)
        ask = Ask(Goal((0.0, 0.0, 0.0)), _checked_load(payload), here)
        angles = np.array([command])
        side = None if here is None else np.sign(angles - here)
        rest = settle(self.deployment.model, self.deployment.poses(ask, angles, side))
        rotation = _columns(self._tcp(rest))
        return Forward(_triple(rest.true_tcp[0]), rotation, tuple(rest.joint_torque[0].tolist()), self._spread(rest))

    def _ordered(self, ask: Ask, found: Found) -> list[int]:
        """Rows of commands within the limits, best first, each branch once."""
        rows, q = np.flatnonzero(self.deployment.usable(found)).tolist(), found.q.tolist()
        if ask.near is not None:
            near = ask.near
            rows.sort(key=lambda row: _apart(q[row], near))
        else:
            limits = self.deployment.limits
            rows.sort(key=lambda row: -min(limits.margins(q[row])))
        kept: list[int] = []
        for row in rows:
            if all(_apart(q[row], q[other]) > SAME for other in kept):
                kept.append(row)
        return kept

    def _solved(
        self, ask: Ask, found: Found, order: list[int], method: str, rounding: Rounding, started: float
    ) -> Solved:
        """The reply with the rows `order` as branches, the first checked by the model's own equilibrium."""
        row = order[0]
        deployment = self.deployment
        poses, near_rest = self._standing(ask, found, [row])
        rest = settle(deployment.model, poses, near_rest)
        tcp = self._tcp(rest)
        return Solved(
            goal=ask.goal,
            q=tuple(poses.q[0].tolist()),
            branches=self._branches(found, order),
            tcp=_triple(rest.true_tcp[0]),
            rotation=_columns(tcp),
            predicted_error=math.dist(rest.true_tcp[0], ask.goal.position),
            predicted_turn=_turn_left(ask.goal, tcp),
            spread=self._spread(rest),
            direction=tuple(int(side) for side in found.direction[row]),
            detours=tuple(int(joint) + 1 for joint in np.flatnonzero(found.detour[row])),
            rounded=self._rounded(ask, rest, rounding),
            method=method,
            steps=found.steps,
            cube_error=found.error,
            left_out=self.left_out,
            elapsed=time.perf_counter() - started,
        )

    def _clipped(self, found: Found, rows: list[int]) -> Array:
        """(len(rows), n), commands without the round-off that leads beyond a limit."""
        band = self.deployment.band
        return np.asarray(np.minimum(np.maximum(found.q[rows], band.lower), band.upper))

    def _branches(self, found: Found, rows: list[int]) -> tuple[Branch, ...]:
        return tuple(Branch(tuple(q), -1, self.deployment.limits) for q in self._clipped(found, rows).tolist())

    def _barred(self, ask: Ask, found: Found, rows: list[int], method: str, started: float) -> Barred:
        spent = time.perf_counter() - started
        return Barred(ask.goal, self._branches(found, rows), method, self.left_out, spent)

    def _unsolved(self, ask: Ask, found: Found | None, method: str, started: float) -> Unsolved:
        limits, beyond = self.deployment.limits, np.empty((0, self.deployment.model.arm.dof))
        if found is not None:
            beyond = found.q[~self.deployment.usable(found)]
        branches = sorted((Branch(tuple(q), -1, limits) for q in beyond.tolist()), key=lambda branch: -branch.margin)
        violation = None
        if branches:
            margins = limits.margins(branches[0].q)
            worst = min(range(len(margins)), key=margins.__getitem__)
            violation = Violation(worst + 1, -margins[worst])
        verdict = Verdict.OUTSIDE_LIMITS if branches else Verdict.OUT_OF_REACH
        closest = nearest(self.deployment, ask, beyond)
        spent = time.perf_counter() - started
        return Unsolved(ask.goal, verdict, closest, tuple(branches), violation, method, self.left_out, spent)

    def _standing(self, ask: Ask, found: Found, rows: list[int]) -> tuple[Poses, list[Number]]:
        """Commands as poses, and amounts of all slots of the chain near those at rest there."""
        poses = self.deployment.poses(ask, self._clipped(found, rows), found.direction[rows])
        near: list[Number] = list(self.deployment.model.wiring.steady)
        moving = found.reached.amounts[rows].T
        amounts: list[Number] = moving[:, 0].tolist() if len(rows) == 1 else list(moving)
        for k, amount in zip(self.deployment.compensation.linkage.slots.tolist(), amounts, strict=True):
            near[k] = amount
        return poses, near

    def _tcp(self, rest: Equilibrium) -> Frame:
        """The tool's frame in a single pose at rest."""
        deployment = self.deployment
        linkage = deployment.compensation.linkage
        amounts = [float(rest.slots[k]) for k in linkage.slots.tolist()]
        if deployment.one_start is None:
            return frame_of(linkage.place(np.array([amounts])).tcp[0])
        return deployment.one_start.linkage.tool(amounts)

    def _spread(self, rest: Equilibrium) -> Spread | None:
        covariance = position_covariance(rest, self.covariance, self.joint_sd)
        if covariance is None:
            return None
        return Spread(_rotation(covariance[0]), math.sqrt(float(np.trace(covariance[0]))))

    def _rounded(self, ask: Ask, rest: Equilibrium, rounding: Rounding) -> Rounded | None:
        if self.servos is None:
            return None
        command = rest.poses.q[0]
        joints = self.deployment.model.chain.joint_slots

        def miss(q: tuple[float, ...]) -> float:
            slots = list(rest.slots)
            for k, change in zip(joints, (np.array(q) - command).tolist(), strict=True):
                slots[k] = slots[k] + change
            poses = Poses(np.array([q]), rest.poses.payload, rest.poses.direction)
            return math.dist(settle(self.deployment.model, poses, slots).true_tcp[0], ask.goal.position)

        return rounded(self.servos, command.tolist(), rounding, miss, lambda: joint_jacobian(rest)[0])

    def _checked_angles(self, name: str, q: Sequence[float] | None) -> tuple[float, ...] | None:
        if q is None:
            return None
        n = self.deployment.model.arm.dof
        angles = tuple(float(x) for x in q)
        if len(angles) != n or not all(map(math.isfinite, angles)):
            raise LrmError(f"{name} = {list(q)}; should be {n} finite joint angles in rad")
        return angles


def _apart(q: Sequence[float], other: Sequence[float]) -> float:
    """How far a joint has to turn at most (rad)."""
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


def _of_the_deployed(covariance: Covariance, model: Model, smooth: Model) -> Covariance:
    """The part of a covariance that speaks of the deployed parameters; the others are marginalised."""
    for key in covariance.keys:
        model.position(key)
    rows = [i for i, key in enumerate(covariance.keys) if key in smooth.keys]
    return Covariance(tuple(covariance.keys[i] for i in rows), covariance.matrix[np.ix_(rows, rows)])


def _triple(v: Array) -> Triple:
    x, y, z = v.tolist()
    return x, y, z


def _rotation(m: Array) -> Rotation:
    return _triple(m[0, :3]), _triple(m[1, :3]), _triple(m[2, :3])


def _columns(tcp: Frame) -> Rotation:
    ax, ay, az, bx, by, bz, cx, cy, cz = tcp[:9]
    return (ax, bx, cx), (ay, by, cy), (az, bz, cz)


def _turn_left(goal: Goal, tcp: Frame) -> float:
    """How far the tool is from being turned as the goal has it (rad)."""
    if goal.rotation is not None:
        return math.hypot(*way(goal.rotation, goal.position, tcp)[3:]) / LEVER
    return float(np.linalg.norm(Aim.of(goal).error(matrices([tcp]))[0, 3:])) / LEVER
