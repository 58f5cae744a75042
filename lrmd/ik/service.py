"""Inverse and forward kinematics requests to answers, for one deployed model. No zenoh, no threads."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.plausible_arm import reach
from lrm_math.arm.pulse_rounding import Rounding
from lrm_math.arrays import ORIGIN, Array, Vector3
from lrm_math.collision.contact import Contact
from lrm_math.collision.scene import Clearance, ClosestPair, Scene, clearance_of
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.answer import SAME, Branch, CalibratedReply, NoAllowedBranch, Solved, Unsolved, apart
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import CalibratedArm, CancellationCheck, Method, friction_of, uncancelled
from lrm_math.ik.goal import Goal, IkQuery, point, point_along, pose, pose_rpy
from lrm_math.ik.methods import QUICKEST, method_named
from lrm_math.kinematics.known import Known, MemoryState
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed_with, followed_parts, memorised, under_gravity, with_load_at
from lrm_math.model.equilibrium import solve_equilibrium, with_borne_loads
from lrm_math.model.memory_record import after_stand, nothing_known, when_powered
from lrm_math.model.model import Model
from lrm_math.model.tip_over import tip_over_angles
from lrm_math.model.unseen_states import beyond_session
from lrmd.config import SECOND, Config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.planner import JointPath, NoPlan, Planner, with_corners
from lrmd.ik.stabilise import steadier_poses
from lrmd.ik.straight_line import ARRIVED, PASSES, LineEnd, Waypoint, line_path
from lrmd.messages.codec import MessageError
from lrmd.messages.kinematics import (
    FkAnswer,
    FkRequest,
    GoalEntry,
    IkAnswer,
    IkRequest,
    KinematicsRequest,
    PlanRequest,
)
from lrmd.messages.surroundings import ObstacleEntry, contacts_of
from lrmd.safety.collision_guard import CollisionGuard
from lrmd.safety.contact_force import ContactRules, permits, permitting
from lrmd.safety.stability import Stability, stability_of

UNIT = 1e-3
"""Largest deviation of a quaternion's length from 1."""
NO_EQUILIBRIUM = "the model has no elastic equilibrium there, or more than one: the load may be too heavy for the arm"
UNIQUE_TOLERANCE = 1e-6
"""rad, m: slots of one equilibrium differ by less."""
NEAR, FAR, SMALLEST_SHARE = 0.01, 10.0, 0.05
"""Shares of an arm's length from its origin: nearer than `NEAR` and farther than `FAR` nobody means a goal; and the
nearest that a goal of another unit would be."""
CLOSE = 1e-7
"""m: tolerance of the tip by which an uncertain memory is judged."""
UNKNOWN = Known()


def goal_of(entry: GoalEntry) -> Goal:
    """The goal of a message. Raises `LrmError`."""
    if entry.rpy_rad is not None:
        roll, pitch, yaw = entry.rpy_rad
        return pose_rpy(entry.position_m, roll, pitch, yaw)
    if entry.quaternion_xyzw is not None:
        return goal_pose(entry.position_m, entry.quaternion_xyzw)
    if entry.approach is not None:
        return point_along(entry.position_m, entry.approach)
    return point(entry.position_m)


def goal_pose(position: Sequence[float], quaternion: Sequence[float]) -> Goal:
    """A pose (m) by a unit quaternion x, y, z, w. Raises `MessageError` if its length is not 1."""
    length = math.hypot(*quaternion)
    if abs(length - 1.0) > UNIT:
        raise MessageError(f"quaternion_xyzw has length {length:.4g}; should be 1")
    x, y, z, w = (part / length for part in quaternion)
    rotation = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return Goal((position[0], position[1], position[2]), rotation)


def solver_of(config: Config, deployed: DeployedModel) -> CalibratedSolver:
    """The solver of a deployed model. Raises `LrmError` for a model that it cannot use."""
    return CalibratedSolver.of(
        deployed.model, left_out=deployed.left_out, covariance=deployed.covariance, clock=config.clock
    )


@dataclass(frozen=True, eq=False)
class FeasibilityCheck:
    """Feasibility of commands: one elastic equilibrium; rigid and sagging bodies keep the margin of `scene`."""

    scene: Scene | None
    arm: CalibratedArm
    model: Model | None = None
    contacts: tuple[Contact, ...] = ()

    def _permitting(self, payload: float, q: Array) -> Scene | None:
        """The scene in which the request's contacts are permitted, in poses (N, n)."""
        if self.scene is None or not self.contacts:
            return self.scene
        each = [permits(self.scene, self.model, self.contacts, pose[None], payload) for pose in q]
        shallow = [min(permits_of_pair, key=lambda permit: permit.depth) for permits_of_pair in zip(*each, strict=True)]
        return permitting(self.scene, shallow)

    def feasible(self, query: IkQuery, branches: Sequence[Branch]) -> NDArray[np.bool_]:
        """(K,), for commands that a solver proposes.

        An overloaded arm may have several: a command is feasible only if the one that is reached from the rigid pose is
        the solver's.
        """
        feasible = np.zeros(len(branches), dtype=bool)
        q, side, slots = (np.array(part) for part in zip(*((b.q, b.direction, b.slots) for b in branches), strict=True))
        settled = self.arm.equilibria(query.payload, q, side, friction=friction_of(branches))
        same = (np.abs(settled.slots - slots[settled.rows]) < UNIQUE_TOLERANCE).all(axis=1)
        rows = settled.rows[same]
        feasible[rows] = True
        if len(rows) and (scene := self._permitting(query.payload, q[rows])) is not None:
            near = self._clearance(scene, query.payload, q[rows], settled.slots[same])
            feasible[rows] = near.distance.reshape(2, -1).min(axis=0) >= scene.margin
        return feasible

    def confirms_rounding(self, reply: Solved, payload: float) -> bool:
        """Whether the equilibrium at the rounded counts has the error that the reply states."""
        if reply.rounded is None:
            return True
        tool = self.arm.tool_at(payload, reply.rounded.q, reply.branches[0])
        if tool is None:
            return False
        return abs(math.dist(tool[9:], reply.goal.position) - reply.rounded.error) < UNIQUE_TOLERANCE

    def reason(self, q: tuple[float, ...], payload: float) -> tuple[str, ClosestPair | None]:
        """Reason why a command (rad) is infeasible, as text, and the two bodies of a collision."""
        command = np.array([q])
        settled = self.arm.equilibria(payload, command)
        if (scene := self._permitting(payload, command)) is not None and len(settled.rows):
            near = self._clearance(scene, payload, command, settled.slots)
            k = int(near.distance.argmin())
            closest = ClosestPair(float(near.distance[k]), str(near.first[k]), str(near.second[k]))
            if closest.distance < scene.margin:
                text = (
                    f"{closest.first} and {closest.second} would be {closest.distance * 1e3:.1f} mm apart; "
                    f"{scene.margin * 1e3:.1f} mm must be kept"
                )
                return text, closest
        return NO_EQUILIBRIUM, None

    def _clearance(self, scene: Scene, payload: float, q: Array, slots: Array) -> Clearance:
        """Clearance of twice as many arms: settled, amounts (K, V), then the rigid ones at the commands (K, n)."""
        bent, rigid = self.arm.kernel(payload).frames(slots), self.arm.nominal_solver.frames(q)
        return clearance_of(scene, np.concatenate([bent, rigid]))


@dataclass(frozen=True, eq=False)
class IkService:
    """Answers kinematics requests with one model.

    Attributes:
        measured: solver of the model as it was deployed.
        model, solver: the same with gravity and load as they are known, and with what follows the pose (`at`).
        feasibility: of commands, among the obstacles that are known.
        remembering: the arm with its effects with a memory; None of a model that follows none.
        down: gravity's direction, a unit vector in the arm's frame; None: as the model says. load_at: the load's centre
            (m).
    """

    config: Config
    deployed: DeployedModel
    measured: CalibratedSolver
    model: Model
    solver: CalibratedSolver
    feasibility: FeasibilityCheck
    remembering: Model | None
    down: Vector3 | None = None
    load_at: Vector3 = ORIGIN

    @classmethod
    def of(cls, config: Config, deployed: DeployedModel) -> IkService:
        """The service of a deployed model. Raises `LrmError` for a model that it cannot use."""
        solver, model = solver_of(config, deployed), deployed.model
        scene = Scene.of(config.arm) if config.arm.shapes.capsules else None
        solver.warm_up()
        feasibility = FeasibilityCheck(scene, solver.arm)
        return cls(config, deployed, solver, model, solver, feasibility, _remembering(model))

    def under_gravity(self, down: Vector3 | None) -> IkService:
        """The service where gravity's direction is known, a unit vector in the arm's frame; None: as the model says."""
        return self._in_state(down, self.load_at)

    def with_load_at(self, centre: Vector3) -> IkService:
        """The service where the load's centre is known (m), see `Arm.with_load_at`. Raises `LrmError`."""
        return self._in_state(self.down, centre)

    def _in_state(self, down: Vector3 | None, centre: Vector3) -> IkService:
        model, solver = self.deployed.model, self.measured
        if down is not None:
            model, solver = under_gravity(model, down), solver.under_gravity(down)
        if any(centre):
            model, solver = with_load_at(model, centre), solver.with_load_at(centre)
        solver.warm_up()
        other = replace(self, model=model, remembering=_remembering(model), down=down, load_at=centre)
        return other._solved_by(solver)

    def _solved_by(self, solver: CalibratedSolver) -> IkService:
        return replace(self, solver=solver, feasibility=replace(self.feasibility, arm=solver.arm))

    def at(self, now: Poses) -> IkService:
        """The service at one pose of which it is known since when the arm has power, which the drift of a joint may
        follow, and what it did before, which a memory follows."""
        added = followed_parts(self.model, self._bearing(now))
        return self._solved_by(self.solver.with_offsets(added)) if added else self

    @property
    def nothing_known(self) -> MemoryState | None:
        """Memory of an arm of which nothing is known; None of a model that follows none."""
        memory = memorised(self.model)
        return nothing_known(memory) if memory else None

    def when_powered(self, q: Array, payload: float) -> MemoryState:
        """Memory of an arm that has just got power at commands q (n,), rad, with a payload (kg)."""
        assert self.remembering is not None
        try:
            return when_powered(self.remembering, memorised(self.model), q, payload)
        except NoEquilibrium:
            return nothing_known(memorised(self.model))

    def after_stand(
        self, before: MemoryState, q: Array, payload: float, seconds: float, start: Array | None = None
    ) -> MemoryState:
        """Memory after a stand, see `lrm_math.model.memory_record`; as before where the arm does not settle there."""
        assert self.remembering is not None
        try:
            return after_stand(self.remembering, before, q, payload, seconds, start)
        except NoEquilibrium:
            return before

    def among(self, obstacles: Sequence[ObstacleEntry]) -> IkService:
        """The service of the arm among obstacles, beside those of its file."""
        if self.feasibility.scene is None:
            return self
        scene = Scene.of(self.config.arm, around=[entry.built() for entry in obstacles])
        return replace(self, feasibility=replace(self.feasibility, scene=scene))

    def inverse(
        self, request: IkRequest, known: Known = UNKNOWN, check_cancelled: CancellationCheck = uncancelled
    ) -> Iterator[IkAnswer]:
        """One answer per goal, each computed when it is taken.

        Raises `LrmError` for invalid goals, and what `check_cancelled` raises, which is called during each search.
        """
        self._check_angles("near_rad", request.near_rad)
        goals = [self._goal(number, entry) for number, entry in enumerate(request.goals)]
        settings: dict[str, Any] = {"side": request.cube_side_m, "points": request.cube_points}
        method = method_named(request.method, **settings)
        near, motion = _start(request.near_rad, known)
        payload, rounding = request.payload_kg or 0.0, Rounding(request.round)

        def ask(goal: Goal, at: IkService) -> IkAnswer:
            return at._permitting(request)._answer(goal, payload, near, method, rounding, motion, check_cancelled)

        here = self._here(known, payload)
        yield from (self._reaching(goal, here, known, payload, ask) for goal in goals)

    def _reaching(
        self, goal: Goal, here: IkService, known: Known, payload: float, ask: Callable[[Goal, IkService], IkAnswer]
    ) -> IkAnswer:
        """The answer to one goal, with what follows the time or the moves as it is at arrival. Raises `LrmError`.

        `here`: the service of the arm where it stands now.
        """
        answer = ask(goal, here)
        if here is self or answer.q_rad is None:
            return answer
        tool = here.solver.predicted(here._arriving(known, np.array(answer.q_rad), payload)).rotation
        held, free = (partial(ask, each) for each in (pose(goal.position, tool), goal))
        return self._at_arrival(answer, known, payload, held, free)

    def _at_arrival(
        self, answer: IkAnswer, known: Known, payload: float, held: Callable[[IkService], IkAnswer],
        free: Callable[[IkService], IkAnswer],
    ) -> IkAnswer:  # fmt: skip
        """The answer with the arm's warm-up and memory at the end of its own way, by fixed-point iteration.

        `held`: the question with the tool turned as in the first answer, which keeps the branch; `free`: without.
        """
        for _ in range(PASSES):
            before = answer.q_rad or []
            there = self._arriving(known, np.array(before), payload)
            answer = held(self.at(there))
            solved = answer.q_rad is not None
            answer = answer if solved else free(self.at(there))
            answer = answer.model_copy(update={"sd_m": self._with_followed(answer.sd_m, known, there)})
            if not solved or apart(answer.q_rad or [], before) < ARRIVED:
                break
        return answer

    def _here(self, known: Known, payload: float) -> IkService:
        """The service of the arm where it stands now, see `at`."""
        return self.at(known.poses(known.motion or Motion.at([0.0] * self.config.dof), payload))

    def _arriving(self, known: Known, q: Array, payload: float, arrival: Motion | None = None) -> Poses:
        """The pose at the end of the way to commands q (n,), rad, at full speed; `arrival`: its record, if given."""
        return known.poses(arrival or known.arrived(q), payload, self._seconds(known, q))

    def _moved(self, known: Known, motion: Motion, payload: float) -> Waypoint:
        """The arm at the end of a move, at full speed, to where a record of its moves ends."""
        seconds, remembered = self._seconds(known, motion.q), known.remembered
        if remembered is not None and known.motion is not None and self.remembering is not None:
            remembered = self.after_stand(remembered, motion.q, payload, seconds, known.motion.q)
        running = None if known.running is None else known.running + seconds
        there = replace(known, motion=motion, running=running, remembered=remembered)
        return Waypoint(there, self.at(there.poses(motion, payload)).solver)

    def _seconds(self, known: Known, q: Array) -> float:
        """Time of the way to commands q (n,), rad, at full speed; 0 where it is not known from where."""
        if known.motion is None:
            return 0.0
        pulses = ([s.pulse_ns(x) for s, x in zip(self.config.servos, p, strict=False)] for p in (known.motion.q, q))
        most = max(abs(after - before) for before, after in zip(*pulses, strict=True))
        return float(-(-most // self.config.step) * self.config.tick / SECOND)

    def _with_followed(self, sd: float | None, known: Known, now: Poses) -> float | None:
        """Standard deviation of the tip (m) at one pose, with what is not known of the arm's memory, and what is said
        beyond the states that the session had (`beyond_session`)."""
        if sd is None:
            return None
        try:
            unsure = [*self._other_memories(known, now), *beyond_session(self.model, self._bearing(now))]
        except NoEquilibrium:
            return None
        return math.hypot(sd, *(float(np.linalg.norm(apart)) for apart in unsure))

    def _other_memories(self, known: Known, now: Poses) -> Iterator[Array]:
        """(3,), how far the tip would be elsewhere (m) with each memory that is not known one standard deviation off.
        Raises `NoEquilibrium`."""
        if known.remembered is None or now.history is None or self.remembering is None:
            return
        begun = (known.remembered.now, *known.remembered.or_else)
        visits = [replace(now.history.visits, begun=memory) for memory in begun]
        tips = [self._tip(replace(now, history=replace(now.history, visits=visits_from))) for visits_from in visits]
        yield from (tip - tips[0] for tip in tips[1:])

    def _bearing(self, now: Poses) -> Poses:
        """The pose with the loads before it that the deployed arm bore, where something remembers them."""
        return now if now.history is None or self.remembering is None else with_borne_loads(self.remembering, now)

    def _tip(self, now: Poses) -> Array:
        assert self.remembering is not None
        return np.asarray(solve_equilibrium(self.remembering, now, tolerance=CLOSE).true_tcp[0])

    def _permitting(self, request: KinematicsRequest) -> IkService:
        """The service of one request, with the contacts that it permits. Raises `LrmError`."""
        contacts = contacts_of(request.may_touch)
        if not contacts or self.feasibility.scene is None:
            return self
        permitting(self.feasibility.scene, (contact.permit for contact in contacts))
        return replace(self, feasibility=replace(self.feasibility, model=self._bending, contacts=contacts))

    @property
    def _length(self) -> float:
        """How far from the origin the arm may reach (m)."""
        base = self.config.arm.base
        return reach(self.config.arm) + math.hypot(base.x, base.y, base.z)

    @property
    def _bending(self) -> Model | None:
        """The model by which the arm sags; None for the nominal arm."""
        return self.model if self.deployed.sha256 else None

    def _answer(
        self, goal: Goal, payload: float, near: Sequence[float] | None, method: Method, rounding: Rounding,
        motion: Motion | None = None, check_cancelled: CancellationCheck = uncancelled,
    ) -> IkAnswer:  # fmt: skip
        """The answer to one goal, with the time that it took. Raises what `check_cancelled` raises."""
        started = time.perf_counter()
        try:
            reply = self.solver.solve(
                goal, payload, near, method, rounding, self.feasibility.feasible, motion, check_cancelled
            )
            content = self._content(reply, payload)
        except RequestError:
            raise
        except LrmError as error:
            content = {"verdict": "not_converged", "text": str(error)}
        if content["verdict"] != "solved":
            content["text"] += unit_doubt(goal.position, self._length)
        command = content.get("q_rad") or content.get("nearest_rad")
        if command is not None:
            content["outside_range"] = self._outside(command)
            content["tip_over_rad"] = self.tip_over(command, payload)
        return IkAnswer(**content, elapsed_ms=(time.perf_counter() - started) * 1e3)

    def _goal(self, number: int, entry: GoalEntry) -> Goal:
        try:
            return goal_of(entry)
        except LrmError as error:
            raise MessageError(f"goals.{number}: {str(error).removeprefix('goal: ')}") from None

    def _check_angles(self, name: str, q: Sequence[float] | None) -> None:
        if q is not None and len(q) != self.config.dof:
            raise MessageError(f"{name}: {len(q)} angles; {self.config.arm.name} has {self.config.dof} joints")

    def forward(self, request: FkRequest, known: Known = UNKNOWN) -> Iterator[FkAnswer]:
        """One answer per row of angles, each computed when it is taken from the iterator. Raises `LrmError`."""
        self._check_angles("near_rad", request.near_rad)
        for number, q in enumerate(request.q_rad):
            self._check_angles(f"q_rad.{number}", q)
        for number, direction in enumerate(request.direction):
            self._check_angles(f"direction.{number}", direction)
        payload = request.payload_kg or 0.0
        here = self._here(known, payload)
        for number, q in enumerate(request.q_rad):
            arrival = self._arrival(request, number, known)
            now = self._arriving(known, arrival.q, payload, arrival)
            f = (here if here is self else self.at(now)).solver.predicted(now)
            yield FkAnswer(
                tcp_m=list(f.tcp), rotation=[list(row) for row in f.rotation], tau_nm=list(f.joint_torque),
                sd_m=self._with_followed(None if f.uncertainty is None else f.uncertainty.sd, known, now),
                outside_range=self._outside(q),
                direction=arrival.side.astype(int).tolist(), tip_over_rad=self.tip_over(q, payload),
            )  # fmt: skip

    def _arrival(self, request: FkRequest, number: int, known: Known) -> Motion:
        """The record of an arm at a row of a request. A joint moves if it gets another pulse, of whole ns."""
        q = np.array(request.q_rad[number])
        if request.direction:
            return Motion.towards(q, request.direction[number])
        if request.near_rad is not None:
            return Motion.between(request.near_rad, q)
        servos = zip(self.config.servos[: self.config.dof], q.tolist(), strict=True)
        return replace(known.arrived(np.array([s.angle(s.pulse_ns(angle)) for s, angle in servos])), q=q)

    def _outside(self, q: Sequence[float]) -> list[int]:
        """Joints, from 1, that a command (rad) puts outside the range that the model was fitted on."""
        within = self.deployed.model.within
        return [] if within is None else list(within.joints_outside(np.array(q)))

    def tip_over(self, q: Sequence[float], payload: float) -> float | None:
        """How far (rad) the vehicle is from tipping over at commands (rad); None where the arm file has none."""
        vehicle = self.config.arm.vehicle
        if vehicle is None or not any(gravity := self.model.constant_gravity):
            return None
        try:
            settled = solve_equilibrium(self.model, poses_of(np.array([q]), payload))
        except NoEquilibrium:
            return None
        return float(tip_over_angles(settled, payload, vehicle, gravity)[0])

    def plan(
        self, request: PlanRequest, check_cancelled: CancellationCheck, known: Known = UNKNOWN
    ) -> JointPath | NoPlan:
        """A path, or the reason why there is none. Raises `LrmError`, and what `check_cancelled` raises."""
        for name in ("from_rad", "to_rad"):
            self._check_angles(name, getattr(request, name))
        if request.stabilise:
            return self._steadied(request, check_cancelled)
        if request.line:
            return self._line(request, check_cancelled, known)
        goals = [request.to_rad] if request.to_rad is not None else self._commands(request, known)
        guard = self._guard(request, np.array([request.from_rad, *goals]))
        planner = Planner(self.config, guard, request.payload_kg or 0.0)
        return planner.find(request.from_rad, goals, request.seed, check_cancelled)

    def _steadied(self, request: PlanRequest, check_cancelled: CancellationCheck) -> JointPath | NoPlan:
        """A path to a pose in which the vehicle is further from tipping over. Raises `LrmError`."""
        vehicle, payload, start = self.config.arm.vehicle, request.payload_kg or 0.0, np.array(request.from_rad)
        if vehicle is None or not any(self.model.constant_gravity):
            raise RequestError("no_vehicle", f"the arm file of {self.config.arm.name} has no [vehicle], or no gravity")
        guard, stability = self._guard(request, start[None]), Stability(vehicle, 0.0, self.model)
        goals = steadier_poses(stability, guard, start, payload, request.seed, check_cancelled)
        if not len(goals):
            where = "than where the arm stands"
            return NoPlan(f"no pose was found in which the vehicle is further from tipping over {where}")
        planner = Planner(self.config, guard, payload)
        for goal in goals:
            check_cancelled()
            if (straight := planner.allowed((tuple(request.from_rad),), goal)) is not None:
                return straight
        return planner.find(request.from_rad, goals.tolist(), request.seed, check_cancelled)

    def _line(self, request: PlanRequest, check_cancelled: CancellationCheck, known: Known) -> JointPath | NoPlan:
        """A straight line of the tip, or where it ends. Raises `LrmError`."""
        assert request.goal is not None
        payload = request.payload_kg or 0.0
        _, here = _start(request.from_rad, known)
        motion = Motion.at(request.from_rad) if here is None else replace(here, q=np.array(request.from_rad))
        begin, goal = self._moved(known, motion, payload), self._goal(0, request.goal)
        path_found = line_path(
            begin, payload, goal, check_cancelled, lambda before, after: self._moved(before.known, after, payload)
        )
        if isinstance(path_found, LineEnd):
            return replace(path_found, text=path_found.text + unit_doubt(goal.position, self._length))
        path = with_corners(self.config, np.array(path_found))
        move, number = self._guard(request, np.array(path)).check(np.array(path), payload)
        if not move.free:
            tip = self.solver.forward(path[number], payload).tcp
            return LineEnd(f"no straight line: {move} of its part {number + 1} of {len(path) - 1}", tip)
        return path

    def _guard(self, request: PlanRequest, poses: Array) -> CollisionGuard:
        """The guard of a plan between poses (K, n), with the contacts that it permits. Raises `LrmError`."""
        if self.feasibility.scene is None:
            raise LrmError(f"{self.config.arm.name} has no collision shapes: no path can be checked")
        rules = ContactRules(contacts_of(request.may_touch))
        guard = CollisionGuard(self.feasibility.scene, self._bending, stability=stability_of(self.config, self.model))
        return guard.permitting(rules, poses, request.payload_kg or 0.0)

    def _commands(self, request: PlanRequest, known: Known) -> list[list[float]]:
        """Commands that reach the goal of a plan, nearest first. Raises `LrmError` if there are none."""
        assert request.goal is not None
        payload = request.payload_kg or 0.0

        def ask(goal: Goal, at: IkService) -> IkAnswer:
            return at._permitting(request)._answer(goal, payload, request.from_rad, QUICKEST, Rounding.EACH)

        answer = self._reaching(self._goal(0, request.goal), self._here(known, payload), known, payload, ask)
        if answer.verdict != "solved":
            raise RequestError(answer.verdict, answer.text)
        return answer.branches_rad

    def _content(self, reply: CalibratedReply, payload: float) -> dict[str, Any]:
        """The fields of an `IkAnswer`, without its time."""
        match reply:
            case Solved() if self.feasibility.confirms_rounding(reply, payload):
                return _solved(reply)
            case NoAllowedBranch():
                text, closest = self.feasibility.reason(reply.branches[0].q, payload)
                if closest is None:
                    return {"verdict": "not_converged", "text": text}
                bodies = [closest.first, closest.second]
                return {"verdict": "collision", "text": text, "bodies": bodies, "clearance_m": closest.distance}
            case Unsolved():
                return {
                    "verdict": "outside_limits" if reply.violation else "out_of_reach", "text": str(reply),
                    "nearest_rad": list(reply.nearest.q), "nearest_distance_m": reply.nearest.distance,
                }  # fmt: skip
        return {"verdict": "not_converged", "text": NO_EQUILIBRIUM if isinstance(reply, Solved) else str(reply)}


def unit_doubt(position: Sequence[float], length: float) -> str:
    """What to add where a goal (m) cannot be reached by an arm of a length (m), but could be in another unit; or ""."""
    size = math.dist(position, ORIGIN)
    for factor, words in ((1e3, "too small, m where mm are meant"), (1e-3, "too large, mm where m are meant")):
        if SMALLEST_SHARE * length <= size * factor <= length and not NEAR <= size / length <= FAR:
            return f"; the goal is {1e3 * size:.4g} mm from the origin: are its numbers 1000 times {words}?"
    return ""


def _remembering(model: Model) -> Model | None:
    """The deployed arm with its effects with a memory; None of a model that follows none."""
    memory = memorised(model)
    return as_deployed_with(model, memory) if memory else None


def _start(near: Sequence[float] | None, known: Known) -> tuple[Sequence[float] | None, Motion | None]:
    """Pose that the arm comes from (rad), and its record: where it stands, unless the request says another."""
    here = known.motion
    if here is None or (near is not None and apart(near, here.q.tolist()) > SAME):
        return near, None
    return here.q.tolist(), here


def _solved(reply: Solved) -> dict[str, Any]:
    content = {
        "verdict": "solved", "text": str(reply), "q_rad": list(reply.q), "tcp_m": list(reply.tcp), "sd_m": reply.sd,
        "branches_rad": [list(b.q) for b in reply.branches], "free_joints": [b.free or 0 for b in reply.branches],
        "predicted_error_m": reply.predicted_error,
        "predicted_turn_rad": reply.predicted_turn, "direction": list(reply.direction), "detours": list(reply.detours),
        "cube_error_m": reply.cube_error,
    }  # fmt: skip
    if (r := reply.rounded) is not None:
        content |= {"counts": list(r.counts), "rounded_q_rad": list(r.q), "rounded_error_m": r.error}
        content["rounded_turn_rad"] = reply.rounded_turn
    return content
