"""Questions of inverse and forward kinematics to answers, for one deployed model. No zenoh, no threads."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from lrm_math.collision import Scene, clearance_of
from lrm_math.equilibrium import equilibrium
from lrm_math.errors import LrmError
from lrm_math.ik.calibrated import CUBE, CalibratedSolver
from lrm_math.ik.cube import Cube
from lrm_math.ik.deployment import Method
from lrm_math.ik.direct import Direct
from lrm_math.ik.goal import Goal, point, point_along, pose, pose_rpy
from lrm_math.ik.iterative import Iterative
from lrm_math.ik.reply import NotConverged, Reply, Solved, Unsolved
from lrm_math.ik.rounding import Rounding
from lrm_math.model import Model
from lrm_math.poses import poses_of
from lrm_math.walk import frames
from lrmd.config import Config
from lrmd.deployed import Deployed
from lrmd.ik_messages import FkRequest, GoalEntry, IkAnswer, IkRequest, Place, PlanRequest
from lrmd.messages import MessageError
from lrmd.planner import Way, find_way
from lrmd.refusal import Refused

UNIT = 1e-3
"""Largest deviation of a quaternion's length from 1."""
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


class Clear:
    """Which commands keep the arm's bodies apart: as the rigid arm, and as the model has it sag."""

    def __init__(self, scene: Scene | None, model: Model) -> None:
        self._scene, self._model = scene, model

    def first(self, branches: Sequence[tuple[float, ...]], payload: float) -> tuple[list[int], str]:
        """Numbers of the branches (rad) that are free, and what is wrong with the first that is not."""
        if self._scene is None:
            return list(range(len(branches))), ""
        rest = equilibrium(self._model, poses_of(np.array(branches), payload))
        sagging = clearance_of(self._scene, frames(self._model.chain, rest.slots, len(branches)))
        rigid = clearance_of(self._scene, self._scene.frames(np.array(branches)))
        worst = np.minimum(sagging.distance, rigid.distance)
        free = np.flatnonzero(worst >= self._scene.margin).tolist()
        hit = int(np.argmax(worst < self._scene.margin))
        seen = sagging if sagging.distance[hit] <= rigid.distance[hit] else rigid
        text = (
            f"{seen.first[hit]} and {seen.second[hit]} would be {worst[hit] * 1e3:.0f} mm apart; "
            f"{self._scene.margin * 1e3:.0f} mm must be kept"
        )
        return free, text


class IkService:
    """Answers for one model; made anew when the model changes."""

    def __init__(self, config: Config, deployed: Deployed) -> None:
        self.deployed = deployed
        self._solver = CalibratedSolver.of(
            deployed.model, left_out=deployed.left_out, covariance=deployed.covariance, clock=config.clock
        )
        self._config, self._model = config, self._solver.deployment.model
        self._scene = Scene.of(config.arm) if config.arm.shapes.capsules else None
        self._clear = Clear(self._scene, self._model)
        self._solver.warm_up()

    def inverse(self, request: IkRequest, goes_on: GoesOn) -> list[IkAnswer]:
        """One answer per goal. Raises `LrmError` for goals that are none, and what `goes_on` raises."""
        goals = [goal_of(entry) for entry in request.goals]
        method, rounding = method_of(request), Rounding(request.round)
        answers = []
        for goal in goals:
            goes_on()
            started = time.perf_counter()
            reply = self._solver.solve(goal, request.payload_kg, request.near_rad, method, rounding)
            answer = self._answer(reply, request)
            answers.append(answer.model_copy(update={"elapsed_ms": (time.perf_counter() - started) * 1e3}))
        return answers

    def forward(self, request: FkRequest, goes_on: GoesOn) -> list[Place]:
        """One place per row of angles. Raises `LrmError`."""
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
        ends = [request.to_rad] if request.to_rad is not None else self._commands(request, goes_on)
        for end in ends:
            ask = request.payload_kg, request.seed
            way = find_way(self._config, self._scene, self._model, (request.from_rad, end), *ask, goes_on)
            if isinstance(way, Way):
                return way
        return way

    def _commands(self, request: PlanRequest, goes_on: GoesOn) -> list[list[float]]:
        """Commands that take the goal of a plan, nearest first. Raises `LrmError` if there are none."""
        assert request.goal is not None
        ask = IkRequest(goals=[request.goal], near_rad=request.from_rad, payload_kg=request.payload_kg, method="direct")
        answer = self.inverse(ask, goes_on)[0]
        if answer.verdict != "solved":
            raise Refused(answer.verdict, answer.text)
        return answer.branches_rad

    def _answer(self, reply: Reply, request: IkRequest) -> IkAnswer:
        match reply:
            case Solved():
                return self._solved(reply, request)
            case Unsolved():
                return IkAnswer(
                    verdict="outside_limits" if reply.violation else "out_of_reach", text=str(reply),
                    nearest_rad=list(reply.nearest.q), nearest_distance_m=reply.nearest.distance, elapsed_ms=0.0,
                )  # fmt: skip
            case NotConverged():
                return IkAnswer(verdict="not_converged", text=str(reply), elapsed_ms=0.0)

    def _solved(self, reply: Solved, request: IkRequest) -> IkAnswer:
        branches = [branch.q for branch in reply.branches]
        free, why = self._clear.first(branches, request.payload_kg)
        if not free:
            return IkAnswer(verdict="collision", text=why, elapsed_ms=0.0)
        rounded = reply.rounded
        return IkAnswer(
            verdict="solved", text=str(reply), q_rad=list(reply.q), branches_rad=[list(branches[i]) for i in free],
            tcp_m=list(reply.tcp), predicted_error_m=reply.predicted_error, predicted_turn_rad=reply.predicted_turn,
            sd_m=reply.sd, counts=None if rounded is None else list(rounded.counts),
            rounded_q_rad=None if rounded is None else list(rounded.q),
            rounded_error_m=None if rounded is None else rounded.error, direction=list(reply.direction),
            detours=list(reply.detours), cube_error_m=reply.cube_error, elapsed_ms=0.0,
        )  # fmt: skip
