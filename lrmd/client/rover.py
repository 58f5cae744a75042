"""Synchronous zenoh client of one daemon."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Literal

from lrm_math.arrays import ORIGIN
from lrm_math.errors import LrmError
from lrmd.client.session import NoReply, RoverSession, S
from lrmd.messages.codec import Message, field_named, pack, unpack_shown
from lrmd.messages.control import (
    ArmRequest,
    DeployedKind,
    DeployRequest,
    DisarmRequest,
    EstopCommand,
    Event,
    FaultsState,
    GravityCommand,
    GravityState,
    HoldRequest,
    InfoState,
    JogRequest,
    JointsState,
    MetricsState,
    ModeState,
    MoveRequest,
    PayloadRequest,
    RelaxRequest,
    ReloadReply,
    ReloadRequest,
    Reply,
    ResetRequest,
    SceneCommand,
    SceneState,
    ThermalState,
    UndeployRequest,
)
from lrmd.messages.kinematics import (
    CANCEL,
    CancelRequest,
    FkReply,
    FkRequest,
    IkReply,
    IkRequest,
    PlanReply,
    PlanRequest,
)
from lrmd.messages.skills import SenseCommand, SkillName, SkillRequest, SkillState
from lrmd.messages.surroundings import ContactEntry, ObstacleEntry
from lrmd.messages.zenoh_session import key

RELOAD_S, PREDICTED_S = 10.0, 3.0
"""s more for the reply to a new model, and to a move, whose swing the daemon predicts while it answers."""
LOOK_S = 0.05
"""s between two looks at the skill under way."""
THERE = 1e-4
"""rad; a goal is rounded to whole nanoseconds, about 2e-6 rad."""
STOP_S, ONCE_S, AGAIN_S = 5.0, 0.5, 0.02
"""s: how long a stop is repeated, how long its answer is waited for, and from that to the next one."""


class MotionInterrupted(LrmError):
    """A motion that ended before its goal; carries the final `mode`, and `why`."""

    def __init__(self, mode: str, why: str) -> None:
        self.mode, self.why = mode, why
        super().__init__(f"the motion ended before its goal: {mode} ({why})")


class Rover(RoverSession):
    """A client of one daemon: commands, kinematics and state; opened as `RoverSession` says.

    Where no reply comes to a request that moves something, nobody knows whether it was carried out, or will be: the arm
    is told to hold before `NoReply` is raised.

    Methods raise `NoReply` without a reply of the daemon, `RequestRefused` on its error reply, `SeveralDaemons` if more
    than one program answers, and, if they command, `DaemonRestarted` when the daemon is not that of the lease any more.

    `unchecked`: why the last move was not checked for collisions; empty if it was. `settle_s`: how long after its end
    the tip usually swings, `settle_95_s`: in 95 % of the cases that the daemon simulates it swings no longer; None
    where the daemon has no motion model.
    """

    unchecked: str = ""
    settle_s: float | None = None
    settle_95_s: float | None = None

    # ---- commands

    @contextmanager
    def _held_if_unknown(self) -> Iterator[None]:
        """Holds the arm where no reply says whether a motion was begun, or goes on: it may yet begin. Once, for the
        daemon may be gone."""
        try:
            yield
        except NoReply:
            with suppress(LrmError):
                self._query(Reply, "rpc/hold", HoldRequest(), min(self._timeout, ONCE_S))
            raise

    def arm(
        self,
        where: Literal["given", "stored", "board"] = "board",
        q: Mapping[str, float] | None = None,
        servos: Sequence[str] | None = None,
    ) -> None:
        """Switches servos on at their present angles (`q`, rad by name, for `given`) and waits until they are on."""
        chosen = None if servos is None else list(servos)
        with field_named():
            request = ArmRequest(
                lease=self._token(), stops=self._stops, where=where, q_rad=dict(q or {}), servos=chosen
            )
        try:
            with self._held_if_unknown():
                reply = self._query(Reply, "rpc/arm", request)
                self._wait(("armed",), ("arming",), (reply.seconds or 0.0) + 2.0)
        except MotionInterrupted as ended:
            joints = self.joints()
            on = ", ".join(name for name, is_on in zip(joints.names, joints.on, strict=True) if is_on) or "no servo"
            raise MotionInterrupted(ended.mode, f"{ended.why}; with pulses: {on}") from None

    def move(
        self,
        *waypoints: Mapping[str, float],
        pace: Literal["together", "each"] = "together",
        speed: float = 1.0,
        payload_kg: float | None = None,
        wait: bool = True,
        stops: int | None = None,
        may_touch: Sequence[ContactEntry] = (),
        shaping: Literal["off", "zv", "zvd", "zvdd", "timed"] | None = None,
    ) -> float:
        """Moves servos (rad by name) through the waypoints; returns the duration (s). `stops`: of `mode` when the
        motion was asked for, if that was before now. `may_touch`: contacts that it is permitted. `shaping`: against
        swing, by the daemon's motion model; None: as the daemon is configured.

        Raises `RequestRefused`; while waiting `MotionInterrupted` if the motion ends before its goal.
        """
        path = [dict(w) for w in waypoints]
        with field_named():
            request = MoveRequest(
                lease=self._token(), stops=self._stops if stops is None else stops, waypoints=path, pace=pace,
                speed=speed, payload_kg=payload_kg, may_touch=list(may_touch), shaping=shaping,
            )  # fmt: skip
        with self._held_if_unknown():
            reply = self._query(Reply, "rpc/move", request, self._timeout + PREDICTED_S)
            seconds, self.unchecked = reply.seconds or 0.0, reply.unchecked
            self.settle_s, self.settle_95_s = reply.settle_s, reply.settle_95_s
            if wait:
                self._wait(("armed",), ("moving",), 2 * seconds + 5.0)
        if wait:
            self._check_there({name: angle for waypoint in path for name, angle in waypoint.items()})
        return seconds

    def _check_there(self, goal: Mapping[str, float]) -> None:
        """Raises `MotionInterrupted` if the servos were not sent to a goal (rad by name) last: another client took the
        lease and moved the arm, or it went to rest since a servo was hot."""
        joints = self.joints()
        commanded = dict(zip(joints.names, joints.q_rad, strict=True))
        if off := [name for name, angle in goal.items() if abs(commanded[name] - angle) > THERE]:
            why = f"another motion took its place: {off[0]} is not where it was sent"
            raise MotionInterrupted(self.mode().mode, why)

    def carry(self, payload_kg: float, centre_m: Sequence[float] = ORIGIN) -> None:
        """Tells what the gripper carries from now on: mass (kg) and centre, see `PayloadRequest`. Nothing moves.

        Raises `RequestRefused`.
        """
        with field_named():
            request = PayloadRequest(lease=self._token(), payload_kg=payload_kg, payload_centre_m=list(centre_m))
        self._query(Reply, "rpc/payload", request)

    def jog(self, rates: Mapping[str, float]) -> None:
        """Turns servos at rates (rad/s) until the command timeout (0.5 s): call it again to continue. Does not wait."""
        with field_named():
            request = JogRequest(lease=self._token(), stops=self._stops, rate_rad_per_s=dict(rates))
        self._put("cmd/jog", request)

    def tell_gravity(self, gravity_m_per_s2: Sequence[float]) -> None:
        """Tells the direction of gravity in the arm's frame, m/s², as often as it changes. Needs no lease; no reply.

        An accelerometer at rest reads the opposite.
        """
        with field_named():
            command = GravityCommand(gravity_m_per_s2=list(gravity_m_per_s2))
        self._session.put(key(self.robot, "cmd/gravity"), pack(command), express=True)

    def tell_obstacles(
        self,
        owner: str,
        *put: ObstacleEntry,
        remove: Sequence[str] = (),
        max_age_s: float | None = 10.0,
    ) -> None:
        """Tells of obstacles around the arm, in the frame of TCP positions; each is forgotten after `max_age_s` unless
        it is told again. Needs no lease; no reply: a refusal is an event."""
        with field_named():
            command = SceneCommand(owner=owner, put=list(put), remove=list(remove), max_age_s=max_age_s)
        self._session.put(key(self.robot, "cmd/scene"), pack(command), express=True)

    def hold(self) -> None:
        """Stops the motion with pulses on; returns when the ramp has read it. Needs no lease.

        Repeated until it is answered, for `STOP_S`. Raises `NoReply` then, `RequestRefused` in a mode without hold.
        """
        self._stops = self._insist("rpc/hold", HoldRequest()).stops

    def relax(self, servos: Sequence[str] | None = None) -> None:
        """Stops the pulses of some servos, or of all: their load falls."""
        with field_named():
            request = RelaxRequest(lease=self._token(), servos=None if servos is None else list(servos))
        self._stops = self._query(Reply, "rpc/relax", request).stops

    def disarm(self) -> None:
        """Stops all pulses of a stationary arm."""
        self._stops = self._query(Reply, "rpc/disarm", DisarmRequest(lease=self._token())).stops

    def reset_fault(self) -> None:
        """Leaves fault or estop. Nothing moves."""
        self._stops = self._query(Reply, "rpc/reset_fault", ResetRequest(lease=self._token())).stops

    def reload(self) -> ReloadReply:
        """Reloads the model file in the daemon. Needs no lease; nothing moves."""
        return self._query(ReloadReply, "rpc/reload", ReloadRequest(), self._timeout + RELOAD_S)

    def deploy(self, text: str, accept: bool = False, kind: DeployedKind = "model") -> ReloadReply:
        """Gives the daemon a model file's text, to keep as a version and use from now on. Needs no lease.

        `kind`: of poses, or of "motion". `accept`: also if the tip moves by much; without it `RequestRefused` is raised
        with the code `needs_accept`.
        """
        with field_named():
            request = DeployRequest(text=text, accept=accept, kind=kind)
        return self._query(ReloadReply, "rpc/deploy", request, self._timeout + RELOAD_S)

    def undeploy(self, kind: DeployedKind = "model") -> ReloadReply:
        """Takes the last deployment of a kind of model back. Needs no lease."""
        return self._query(ReloadReply, "rpc/undeploy", UndeployRequest(kind=kind), self._timeout + RELOAD_S)

    def estop(self, why: str = "") -> None:
        """Stops all pulses at the next tick. Needs no lease.

        Repeated until it is answered, for `STOP_S`: the router may be restarting. Raises `NoReply` then.
        """
        command = EstopCommand(why="".join(c for c in why if c.isprintable())[:64])
        self._insist("rpc/estop", command, lambda: self._put("cmd/estop", command))

    def _insist(self, tail: str, stop: Message, before: Callable[[], object] = lambda: None) -> Reply:
        """The reply to a stop, asked for again until one comes; `before` is done before each time."""
        end = time.monotonic() + STOP_S
        while True:
            before()
            try:
                return self._query(Reply, tail, stop, min(self._timeout, ONCE_S))
            except NoReply:
                if time.monotonic() > end:
                    raise
            time.sleep(AGAIN_S)

    def _put(self, tail: str, command: Message) -> None:
        self._session.put(key(self.robot, tail), pack(command), express=True)

    # ---- skills

    def skill(self, name: SkillName, *, wait: bool = True, stops: int | None = None, **fields: Any) -> SkillState:
        """Begins a skill, with the fields of `SkillRequest`, and waits for what comes of it.

        Returns its state, whose `outcome` says what happened: reached, touched_early, nothing_there, refused, stopped
        or replaced, or running without `wait`. Raises `RequestRefused` if it does not begin. `stops`: as in `move`.
        """
        with field_named():
            request = SkillRequest(
                lease=self._token(), stops=self._stops if stops is None else stops, skill=name, **fields
            )
        with self._held_if_unknown():
            begun = self._query(Reply, "rpc/skill", request)
        state = self._followed(begun.skill, name)
        return self.await_skill(state) if wait else state

    def await_skill(self, begun: SkillState) -> SkillState:
        """Waits for what comes of a skill that was begun without waiting; see `skill`."""
        state = begun
        while state.outcome == "running":
            time.sleep(LOOK_S)
            state = self.follow_skill(begun)
        return state

    def follow_skill(self, begun: SkillState) -> SkillState:
        """What a skill that was begun does now, or what came of it. Raises `LrmError` if another was begun since, or
        nothing is known of it: then the arm was told to hold."""
        return self._followed(begun.number, begun.skill)

    def _followed(self, number: int | None, name: str) -> SkillState:
        self._check_restart()
        with self._held_if_unknown():
            state = self._query(SkillState, "state/skill")
        if state.number != number:
            raise LrmError(f"{name}: another skill, {state.skill}, was begun meanwhile")
        if state.outcome == "stopped":
            self._stops = state.stops
        return state

    def skill_state(self) -> SkillState:
        """What the last skill does, or what came of it; who looks knows of the stops before."""
        state = self._query(SkillState, "state/skill")
        self._stops = state.stops
        return state

    def tell_sensed(self, what: Literal["touch", "empty"]) -> None:
        """Tells that the tool touches something, or that nothing is between the fingers: it can only end a skill. Needs
        no lease; no reply."""
        with field_named():
            command = SenseCommand(what=what)
        self._put("cmd/sense", command)

    # ---- kinematics

    def ik(self, request: IkRequest) -> IkReply:
        """Calibrated inverse kinematics: commanded angles for goals of the TCP."""
        return self._solve(IkReply, "rpc/ik", request)

    def fk(self, request: FkRequest) -> FkReply:
        """Calibrated forward kinematics: TCP poses of commanded angles."""
        return self._solve(FkReply, "rpc/fk", request)

    def plan(self, request: PlanRequest) -> PlanReply:
        """A collision-free joint path."""
        return self._solve(PlanReply, "rpc/plan", request)

    def _solve(self, kind: type[S], tail: str, request: IkRequest | FkRequest | PlanRequest) -> S:
        """Asks the ik process, in this session's name: it has a share of the queue of its own."""
        timeout = self._timeout + request.deadline_ms / 1000
        return unpack_shown(kind, self._replies(tail, pack(request), timeout, self._source(tail))[0])

    def cancel(self, name: str) -> None:
        """Cancels the query or plan with this `id`; its caller gets the verdict `cancelled`."""
        with field_named():
            request = CancelRequest(id=name)
        self._replies(CANCEL, pack(request), self._timeout)

    def commanded_q(self) -> list[float]:
        """Commanded joint angles of the arm, rad."""
        return self.joints().q_rad[: self.info().joints]

    # ---- state

    def joints(self) -> JointsState:
        """Commanded angles and pulses of every servo."""
        return self._query(JointsState, "state/joints")

    def mode(self) -> ModeState:
        """Mode of the daemon; who looks knows of the stops before."""
        state = self._query(ModeState, "state/mode")
        self._stops = state.stops
        return state

    def faults(self) -> FaultsState:
        """Faults that are not reset yet."""
        return self._query(FaultsState, "state/faults")

    def thermal(self) -> ThermalState:
        """Modelled servo temperatures."""
        return self._query(ThermalState, "state/thermal")

    def gravity(self) -> GravityState:
        """Gravity in use, and what says so."""
        return self._query(GravityState, "state/gravity")

    def scene(self) -> SceneState:
        """Obstacles that the daemon was told of."""
        return self._query(SceneState, "state/scene")

    def metrics(self) -> MetricsState:
        """Timing and link statistics of the ramp."""
        return self._query(MetricsState, "state/metrics")

    def info(self) -> InfoState:
        """Names, limits and rates of the servos."""
        return self._query(InfoState, "info")

    def events(self) -> list[Event]:
        """The last events, oldest first."""
        return [unpack_shown(Event, data) for data in self._replies("rpc/events", b"", self._timeout)]

    def _wait(self, wanted: Sequence[str], meanwhile: Sequence[str], limit: float) -> None:
        end = time.monotonic() + limit
        while (state := self._query(ModeState, "state/mode")).mode not in wanted:
            self._check_restart()
            if state.mode not in meanwhile:
                self._stops = state.stops
                raise MotionInterrupted(state.mode, state.why)
            if time.monotonic() > end:
                raise MotionInterrupted(state.mode, f"not there after {limit:.0f} s")
            time.sleep(0.02)
