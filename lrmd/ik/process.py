"""The ik process: kinematics queries answered by turns, apart from the real-time ramp."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import structlog
import zenoh
from zenoh.handlers import Callback

from lrm_math.errors import FileError, LrmError
from lrmd import log
from lrmd.config import MS, Config
from lrmd.control.motion_record import known_of
from lrmd.errors import RequestError
from lrmd.heap import return_freed_memory
from lrmd.ik.arm_memory import ArmMemory
from lrmd.ik.deployed_model import deploy, digest_of
from lrmd.ik.fair_queue import FairQueue
from lrmd.ik.planner import JointPath, NoPlan
from lrmd.ik.service import IkService
from lrmd.ik.straight_line import LineEnd
from lrmd.messages.codec import Header, HeaderSource, Message, pack
from lrmd.messages.inbox import Inbox, Send
from lrmd.messages.kinematics import (
    CANCEL,
    REQUESTS,
    CancelRequest,
    FkReply,
    FkRequest,
    IkReply,
    IkRequest,
    KinematicsReply,
    KinematicsRequest,
    PlanReply,
    PlanRequest,
)
from lrmd.messages.surroundings import unpacked
from lrmd.messages.zenoh_session import GONE_KEY, key, own_client, reply_error, serve
from lrmd.ramp.parent import SharedFd, die_with_parent
from lrmd.ramp.shared_memory import NO_MODEL, GravityRecord, LoadRecord, SharedRecords

QUEUE = 16_000
"""Capacity of the queue in goals; what has no room is refused as `busy`. Clients that do not name themselves (zenoh's
source info) are one client."""
LEAST_LOAD = QUEUE // 128
"""Goals that a query counts as at least: so there are no more than 128."""
TURN = 25 * MS
"""ns: a query whose turn it is computes goals until so much time has passed, one at least."""
SWITCH_INTERVAL = 0.5e-3
"""s: a query that arrives during a goal waits for the interpreter at most about so long, so its deadline is right."""
IDLE_S, FIRST_MODEL_S = 0.2, 0.005
"""s between two looks at the shared memory without a query; the same until the daemon has accepted its first model."""
Steps = Generator[None, None, Message]
"""The work on one query: pauses after every goal, and returns the reply."""


@dataclass(eq=False)
class QueuedQuery:
    """A query of a client: its request, deadline `until` (monotonic ns), whether it was cancelled, its work so far."""

    query: zenoh.Query
    client: str
    request: KinematicsRequest
    until: int
    cancelled: threading.Event = field(default_factory=threading.Event)
    steps: Steps | None = None

    @property
    def load(self) -> int:
        """Goals or poses, which take memory until they are answered."""
        match self.request:
            case IkRequest(goals=items) | FkRequest(q_rad=items):
                return max(len(items), LEAST_LOAD)
        return LEAST_LOAD

    @property
    def plans(self) -> bool:
        """Whether it is a plan: one at a time, whose pauses are the turns of the others."""
        return isinstance(self.request, PlanRequest)

    def check(self) -> None:
        """Raises `RequestError` if it is too late, or if nobody wants the answer any more."""
        if time.monotonic_ns() >= self.until:
            raise RequestError("deadline", "the deadline passed before the answer was there", retryable=True)
        if self.cancelled.is_set():
            raise RequestError("cancelled", "the request was cancelled")


class IkProcess:
    """The queue between zenoh's threads and the thread that solves."""

    def __init__(self, config: Config, memory: SharedFd, boot_id: str) -> None:
        self._config = config
        self._shared = SharedRecords(memory.number)
        self._log = structlog.get_logger().bind(robot=config.robot, process="ik")
        self._queue: FairQueue[QueuedQuery] = FairQueue(QUEUE, lambda queued: queued.load)
        self._ending = False
        self._headers = HeaderSource(boot_id)
        self._service: IkService | None = None
        self._checked: tuple[bytes, bytes] | None = None
        self._gravity, self._load = GravityRecord(), LoadRecord()
        self._scene_number = 0
        self._memory = ArmMemory()
        self._shared.values.ik_model = NO_MODEL
        self._update_model()

    def run(self) -> None:
        """Answers queries until SIGTERM."""
        signal.signal(signal.SIGTERM, lambda *_: setattr(self, "_ending", True))
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        sys.setswitchinterval(SWITCH_INTERVAL)
        with zenoh.open(own_client(self._config.zenoh)) as session:
            inbox = Inbox()
            for tail, kind in REQUESTS.items():
                serve(session, key(self._config.robot, tail), kind, self._enqueue, self._refuse, inbox)
            serve(session, key(self._config.robot, CANCEL), CancelRequest, self._cancel, self._refuse, Inbox())
            gone: Callback[zenoh.Sample] = Callback(
                lambda sample: inbox.after(partial(self._gone, str(sample.key_expr))), indirect=False
            )
            session.declare_subscriber(f"{GONE_KEY}/*", gone)
            while not self._ending:
                self._work()

    def _enqueue(self, query: zenoh.Query, request: KinematicsRequest) -> None:
        source = query.source_info
        asker = "" if source is None else str(source.source_id.zid)
        until = time.monotonic_ns() + int(request.deadline_ms * MS)
        for pushed_out in self._queue.add(asker, QueuedQuery(query, asker, request, until)):
            pushed_out.cancelled.set()
            gave_way = RequestError("busy", "it gave way to another client's; ask again", retryable=True)
            self._refuse(pushed_out.query, gave_way)

    def _cancel(self, _: zenoh.Query, request: CancelRequest) -> list[bytes]:
        for queued in self._queue:
            if queued.request.id == request.id:
                queued.cancelled.set()
        return [pack(Header(**self._headers.next("cancel")))]

    def _gone(self, told_on: str) -> Send:
        """Cancels the queries of a session that the router has seen closing, or breaking off."""
        for queued in self._queue:
            if queued.client == told_on.removeprefix(f"{GONE_KEY}/"):
                queued.cancelled.set()
        return lambda: None

    def _work(self) -> None:
        """One turn of the next query, and of a plan."""
        self._look_up()
        self._queue.wait(IDLE_S if self._service else FIRST_MODEL_S)
        if (queued := self._queue.next()) is not None:
            self._turn(queued)

    def _look_up(self) -> None:
        """Duties between two goals: sign of life, the daemon's model, queries that are over."""
        self._shared.ik[0] = time.monotonic_ns()
        self._update_model()
        self._update_gravity()
        self._update_load()
        self._update_scene()
        self._follow_arm()
        for queued in self._queue:
            try:
                queued.check()
            except RequestError as error:
                self._end(queued, error)

    def _turn(self, queued: QueuedQuery) -> None:
        """Continues a query for at least one goal, and for `TURN`."""
        end = time.monotonic_ns() + TURN
        try:
            queued.steps = queued.steps or self._steps(queued)
            while True:
                next(queued.steps)
                queued.check()
                if time.monotonic_ns() >= end:
                    return
        except StopIteration as finished:
            self._reply(queued, finished.value)
        except Exception as error:
            self._end(queued, error)

    def _working(self, queued: QueuedQuery) -> None:
        """Within a goal: sign of life, and the query's own deadline."""
        self._shared.ik[0] = time.monotonic_ns()
        queued.check()

    def _pause(self, plan: QueuedQuery) -> None:
        """Between two moves of a plan: a turn of another query, then the plan's own deadline."""
        self._look_up()
        if (other := self._queue.next(lambda queued: not queued.plans)) is not None:
            self._turn(other)
        plan.check()

    def _update_model(self) -> None:
        """Loads the model that the daemon accepted, once the file has its digest."""
        accepted = self._shared.values.model
        if accepted == NO_MODEL or (accepted == self._shared.values.ik_model and self._service is not None):
            return
        try:
            digest = digest_of(self._config)
        except FileError:
            digest = NO_MODEL
        if (accepted, digest) == self._checked:
            return
        self._checked = accepted, digest
        try:
            if digest != accepted:
                raise LrmError("the model's file is not the one that the daemon accepted; reload it")
            self._service = IkService.of(self._config, deploy(self._config))
            self._gravity, self._load, self._scene_number = GravityRecord(), LoadRecord(), 0
            self._shared.values.ik_model = self._service.deployed.digest
        except LrmError as error:
            self._log.error("model_refused", text=str(error))

    def _update_gravity(self) -> None:
        """Takes over the direction of gravity that the daemon uses."""
        now = self._shared.read_gravity()
        if now is None or now == self._gravity or self._service is None:
            return
        self._memory.stood(self._service, time.monotonic_ns())
        try:
            self._service = self._service.under_gravity((now.x, now.y, now.z) if now.known else None)
        except LrmError as error:
            self._log.error("gravity_refused", text=str(error))
        self._gravity = now

    def _update_load(self) -> None:
        """Takes over what the gripper carries."""
        now, before = self._shared.read_load(), self._load
        if now is None or now == before or self._service is None:
            return
        if (now.x, now.y, now.z) != (before.x, before.y, before.z):
            self._memory.stood(self._service, time.monotonic_ns())
            self._service = self._service.with_load_at((now.x, now.y, now.z))
        self._load = now

    def _update_scene(self) -> None:
        """Takes over the obstacles that the daemon knows."""
        number = self._shared.values.scene_number
        if number == self._scene_number or self._service is None or (told := self._shared.read_scene()) is None:
            return
        self._service = self._service.among(unpacked(told))
        self._scene_number = number

    def _follow_arm(self) -> None:
        """Takes over where the arm stands, for what of the model remembers it."""
        if self._service is not None and self._service.nothing_known is not None:
            now = time.monotonic_ns()
            known = known_of(self._shared.read_knowledge(), now)
            self._memory.follow(self._service, known, self._load.mass, now)

    def _steps(self, queued: QueuedQuery) -> Steps:
        self._update_gravity()
        self._update_load()
        self._update_scene()
        started, request = time.perf_counter(), queued.request.with_payload(self._load.mass)
        service = self._service
        if service is None:
            raise RequestError("no_model", "the model's file changed since the daemon loaded it; rpc/reload takes it")
        self._follow_arm()
        now = time.monotonic_ns()
        known = self._memory.added_to(known_of(self._shared.read_knowledge(), now), service, now)
        kind: type[KinematicsReply]
        content: dict[str, Any] = {"left_out": list(service.deployed.uncompensated)}
        match request:
            case IkRequest():
                kind, content["answers"] = IkReply, []
                content["residual_m"] = service.deployed.residual
                for answer in service.inverse(request, known, partial(self._working, queued)):
                    content["answers"].append(answer)
                    yield
            case FkRequest():
                kind, content["places"] = FkReply, []
                for place in service.forward(request, known):
                    content["places"].append(place)
                    yield
            case PlanRequest():
                path = service.plan(request, partial(self._pause, queued), known)
                kind, content = PlanReply, plan_content(service, path, request.payload_kg or 0.0)
        content |= {"model": service.deployed.path, "model_sha256": service.deployed.sha256}
        content["elapsed_ms"] = (time.perf_counter() - started) * 1e3
        return kind(**self._headers.next("ik"), **content)

    def _reply(self, queued: QueuedQuery, reply: Message) -> None:
        data = pack(reply)
        try:
            queued.check()
        except RequestError as error:
            self._end(queued, error)
            return
        if self._queue.remove(queued.client, queued):
            self._shared.ik[1] += 1
            with queued.query as query:
                query.reply(query.key_expr, data)

    def _end(self, queued: QueuedQuery, error: Exception) -> None:
        """Refuses a query, once."""
        if self._queue.remove(queued.client, queued):
            self._refuse(queued.query, error)

    def _refuse(self, query: zenoh.Query, error: Exception) -> None:
        self._shared.ik[2] += 1
        reply_error(query, error, self._log, self._headers.boot_id)


def plan_content(service: IkService, path: JointPath | NoPlan, payload: float) -> dict[str, Any]:
    """The fields of a `PlanReply`, of a payload (kg)."""
    if isinstance(path, NoPlan):
        ends = {"ends_at_m": list(path.at)} if isinstance(path, LineEnd) else {}
        return {"found": False, "text": path.text, **ends}
    angles = [angle for q in (path[0], path[-1]) if (angle := service.tip_over(q, payload)) is not None]
    waypoints = [list(q) for q in path]
    return {
        "found": True, "text": f"{len(path) - 1} straight moves", "waypoints_rad": waypoints,
        "tip_over_rad": angles if len(angles) == 2 else [],
    }  # fmt: skip


def run(config: Config, memory: SharedFd, boot_id: str) -> None:
    """Entry point of the process: answers queries until SIGTERM or until its parent ends."""
    die_with_parent()
    return_freed_memory()
    log.set_up()
    IkProcess(config, memory, boot_id).run()
