"""Questions of inverse and forward kinematics to answers, for one deployed model. No zenoh, no threads."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.collision.scene import Clearance, Closest, Scene, clearance_of
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import settled
from lrm_math.ik.calibrated import CUBE, CalibratedSolver
from lrm_math.ik.cube import Cube
from lrm_math.ik.direct import Direct
from lrm_math.ik.goal import Goal, point, point_along, pose, pose_rpy
from lrm_math.ik.iterative import Iterative
from lrm_math.ik.linkage import Indices
from lrm_math.ik.pulse_rounding import Rounding
from lrm_math.ik.reply import Barred, NotConverged, Reply, Solved, Unsolved
from lrm_math.ik.scalar_pose import OnePose
from lrm_math.ik.solver_context import Method
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import PLAIN_ITERATIONS, Equilibrium
from lrm_math.model.model import Model
from lrmd.config import Config
from lrmd.errors import Refused
from lrmd.ik.planner import Planner, Way
from lrmd.messages.control import MessageError
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkAnswer, IkRequest, Place, PlanRequest
from lrmd.safety.deployed_model import Deployed

UNIT = 1e-3
"""Largest deviation of a quaternion's length from 1."""
NO_REST = "the model has the arm come to no rest there, or to more than one: the load may be too heavy for it"
AT_REST = 1e-7
"""m: it is at rest when the TCP moves no further than this."""
ONE_REST = 1e-6
"""rad, m: amounts of slots that differ by less are of one equilibrium."""
GoesOn = Callable[[], None]
"""Called between goals; raises an `LrmError` if the rest is not wanted any more."""


def goal_of(entry: GoalEntry) -> Goal:
    """The goal that a message means. Raises `LrmError`."""
    if entry.rpy_rad is not None:
        roll, pitch, yaw = entry.rpy_rad
        return pose_rpy(entry.position_m, roll, pitch, yaw)
    if entry.quaternion_xyzw is not None:
        return pose(entry.position_m, rotation_of(entry.quaternion_xyzw))
    if entry.approach is not None:
        return point_along(entry.position_m, entry.approach)
    return point(entry.position_m)


def rotation_of(quaternion: Sequence[float]) -> np.ndarray:
    """(3, 3), the rotation matrix of a unit quaternion x, y, z, w. Raises `MessageError` if it is none."""
    q = np.array(quaternion)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > UNIT:
        raise MessageError(f"quaternion_xyzw has length {length:.4g}; should be 1")
    x, y, z, w = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def method_of(request: IkRequest) -> Method:
    """The method that a request asks for."""
    match request.method:
        case "direct":
            return Direct()
        case "iterative":
            return Iterative()
        case _:
            same = (request.cube_side_m, request.cube_points) == (CUBE.side, CUBE.points)
            return CUBE if same else Cube(request.cube_side_m, request.cube_points)


def solver_of(config: Config, deployed: Deployed) -> CalibratedSolver:
    """The solver that answers with a model. Raises `LrmError` for a model that cannot be used so."""
    return CalibratedSolver.of(
        deployed.model, left_out=deployed.left_out, covariance=deployed.covariance, clock=config.clock
    )


@dataclass(frozen=True, eq=False)
class Standing:
    """Whether the arm may stand at commands: it comes to rest, rigid and sagging bodies keep their margin."""

    scene: Scene | None
    model: Model

    def free(self, poses: Poses, near_rest: Sequence[Number]) -> NDArray[np.bool_]:
        """(K,), for commands that a solver proposes; `near_rest`: amounts of all slots that it has them come to."""
        free = np.zeros(len(poses), dtype=bool)
        rests = []
        for k, q in enumerate(poses.q):  # a few; one after the other is faster
            rest, rows = self._at_rest(OnePose.of(poses, k, q))
            if len(rows) and self._same(rest, near_rest, k):
                free[k] = True
                rests.append(rest)
        if rests and self.scene is not None:
            free[free] = self._near(self.scene, rests).distance.reshape(2, -1).min(axis=0) >= self.scene.margin
        return free

    def _same(self, rest: Equilibrium, near_rest: Sequence[Number], row: int) -> bool:
        """Whether it comes to the same rest from the rigid arm's pose: overloaded, an arm may have more than one."""
        for k in self.model.wiring.moving:
            there = near_rest[k]
            if abs(float(rest.slots[k]) - (there if isinstance(there, float) else float(there[row]))) >= ONE_REST:
                return False
        return True

    def _at_rest(self, poses: Poses) -> tuple[Equilibrium, Indices]:
        """As `settled`; whatever does not come to rest at once has to come to it entirely."""
        rest, rows = settled(self.model, poses, tolerance=AT_REST)
        return (rest, rows) if len(rows) and rest.iterations <= PLAIN_ITERATIONS else settled(self.model, poses)

    def rests_at_counts(self, reply: Solved, payload: float) -> bool:
        """Whether the board's counts leave the error that the reply says, wherever the arm comes from."""
        if reply.rounded is None:
            return True
        side = np.array([reply.direction], dtype=np.float64)
        poses = OnePose(np.array([reply.rounded.q]), np.array([payload]), side)
        rest, rows = self._at_rest(poses)
        if not len(rows):
            return False
        return abs(math.dist(rest.true_tcp[0], reply.goal.position) - reply.rounded.error) < ONE_REST

    def blocked(self, q: tuple[float, ...], payload: float) -> tuple[str, Closest | None]:
        """What is wrong with a command (rad) that is not free, in words, and the two bodies that are too close."""
        rest, rows = settled(self.model, poses_of(np.array([q]), payload))
        if self.scene is not None and len(rows):
            near = self._near(self.scene, [rest])
            k = int(near.distance.argmin())
            closest = Closest(float(near.distance[k]), str(near.first[k]), str(near.second[k]))
            if closest.distance < self.scene.margin:
                text = (
                    f"{closest.first} and {closest.second} would be {closest.distance * 1e3:.1f} mm apart; "
                    f"{self.scene.margin * 1e3:.1f} mm must be kept"
                )
                return text, closest
        return NO_REST, None

    def _near(self, scene: Scene, rests: Sequence[Equilibrium]) -> Clearance:
        """Of twice as many arms: those that sag, then the rigid ones at the same commands."""
        bent = [frames(self.model.chain, rest.slots, 1) for rest in rests]
        rigid = scene.frames(np.concatenate([rest.poses.q for rest in rests]))
        return clearance_of(scene, np.concatenate([*bent, rigid]))


class IkService:
    """Answers for one model; made anew when the model changes."""

    def __init__(self, config: Config, deployed: Deployed) -> None:
        self.deployed = deployed
        self._solver = solver_of(config, deployed)
        self._config, self._model = config, self._solver.deployment.model
        self._scene = Scene.of(config.arm) if config.arm.shapes.capsules else None
        self._standing = Standing(self._scene, self._model)
        self._solver.warm_up()

    def inverse(self, request: IkRequest, goes_on: GoesOn) -> list[IkAnswer]:
        """One answer per goal. Raises `LrmError` for goals that are none, and what `goes_on` raises."""
        self._check_angles("near_rad", request.near_rad)
        goals = [self._goal(number, entry) for number, entry in enumerate(request.goals)]
        method, rounding = method_of(request), Rounding(request.round)
        payload, near = request.payload_kg, request.near_rad
        answers = []
        for goal in goals:
            goes_on()
            started = time.perf_counter()
            try:
                reply = self._solver.solve(goal, payload, near, method, rounding, self._standing.free)
            except LrmError as error:
                answer = IkAnswer(verdict="not_converged", text=str(error), elapsed_ms=0.0)
            else:
                answer = self._answer(reply, payload)
            answers.append(answer.model_copy(update={"elapsed_ms": (time.perf_counter() - started) * 1e3}))
        return answers

    def _goal(self, number: int, entry: GoalEntry) -> Goal:
        try:
            return goal_of(entry)
        except LrmError as error:
            raise MessageError(f"goals.{number}: {str(error).removeprefix('goal: ')}") from None

    def _check_angles(self, name: str, q: Sequence[float] | None) -> None:
        if q is not None and len(q) != (n := self._config.dof):
            raise MessageError(f"{name}: {len(q)} angles; {self._config.arm.name} has {n} joints")

    def forward(self, request: FkRequest, goes_on: GoesOn) -> list[Place]:
        """One place per row of angles. Raises `LrmError`."""
        self._check_angles("near_rad", request.near_rad)
        for number, q in enumerate(request.q_rad):
            self._check_angles(f"q_rad.{number}", q)
        places = []
        for q in request.q_rad:
            goes_on()
            f = self._solver.forward(q, request.payload_kg, request.near_rad)
            places.append(
                Place(
                    tcp_m=list(f.tcp), rotation=[list(row) for row in f.rotation], tau_nm=list(f.joint_torque),
                    sd_m=None if f.spread is None else f.spread.sd,
                )
            )  # fmt: skip
        return places

    def plan(self, request: PlanRequest, goes_on: GoesOn) -> Way | str:
        """A way, or why there is none. Raises `LrmError`, and what `goes_on` raises."""
        if self._scene is None:
            raise LrmError(f"{self._config.arm.name} has no collision shapes: nobody can tell which way is free")
        for name in ("from_rad", "to_rad"):
            self._check_angles(name, getattr(request, name))
        ends = [request.to_rad] if request.to_rad is not None else self._commands(request, goes_on)
        planner = Planner(self._config, self._scene, self.deployed.model, request.payload_kg)
        return planner.find(request.from_rad, ends, request.seed, goes_on)

    def _commands(self, request: PlanRequest, goes_on: GoesOn) -> list[list[float]]:
        """Commands that take the goal of a plan, nearest first. Raises `LrmError` if there are none."""
        assert request.goal is not None
        ask = IkRequest(goals=[request.goal], near_rad=request.from_rad, payload_kg=request.payload_kg, method="direct")
        answer = self.inverse(ask, goes_on)[0]
        if answer.verdict != "solved":
            raise Refused(answer.verdict, answer.text)
        return answer.branches_rad

    def _answer(self, reply: Reply, payload: float) -> IkAnswer:
        match reply:
            case Solved():
                if self._standing.rests_at_counts(reply, payload):
                    return _solved(reply)
                return IkAnswer(verdict="not_converged", text=NO_REST, elapsed_ms=0.0)
            case Barred():
                text, closest = self._standing.blocked(reply.branches[0].q, payload)
                if closest is None:
                    return IkAnswer(verdict="not_converged", text=text, elapsed_ms=0.0)
                return IkAnswer(
                    verdict="collision", text=text, bodies=[closest.first, closest.second],
                    clearance_m=closest.distance, elapsed_ms=0.0,
                )  # fmt: skip
            case Unsolved():
                return IkAnswer(
                    verdict="outside_limits" if reply.violation else "out_of_reach", text=str(reply),
                    nearest_rad=list(reply.nearest.q), nearest_distance_m=reply.nearest.distance, elapsed_ms=0.0,
                )  # fmt: skip
            case NotConverged():
                return IkAnswer(verdict="not_converged", text=str(reply), elapsed_ms=0.0)


def _solved(reply: Solved) -> IkAnswer:
    rounded = reply.rounded
    return IkAnswer(
        verdict="solved", text=str(reply), q_rad=list(reply.q), branches_rad=[list(b.q) for b in reply.branches],
        tcp_m=list(reply.tcp), predicted_error_m=reply.predicted_error, predicted_turn_rad=reply.predicted_turn,
        sd_m=reply.sd, counts=None if rounded is None else list(rounded.counts),
        rounded_q_rad=None if rounded is None else list(rounded.q),
        rounded_error_m=None if rounded is None else rounded.error, direction=list(reply.direction),
        detours=list(reply.detours), cube_error_m=reply.cube_error, elapsed_ms=0.0,
    )  # fmt: skip
