"""The ik process: a queue of kinematics queries and the loop that answers them, apart from the real-time ramp."""

from __future__ import annotations

import queue
import signal
import threading
import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import structlog
import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd import log
from lrmd.config import MS, Config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy, digest_of
from lrmd.ik.planner import JointPath
from lrmd.ik.service import IkService
from lrmd.messages.control import Header, HeaderSource, Message, pack, unpack
from lrmd.messages.kinematics import CancelRequest, FkReply, FkRequest, IkReply, IkRequest, PlanReply, PlanRequest
from lrmd.messages.zenoh_session import client, key, own_endpoints, reply_error, serve
from lrmd.ramp.process import die_with_parent
from lrmd.ramp.shared_fd import SharedFd
from lrmd.ramp.shared_memory import NO_MODEL, SharedRecords

QUEUE = 64
"""Capacity of the queue; a query beyond it is refused as `busy`."""
FK_DEADLINE = 1000 * MS
KinematicsRequest = IkRequest | FkRequest | PlanRequest
REQUESTS: dict[str, type[KinematicsRequest]] = {"rpc/ik": IkRequest, "rpc/fk": FkRequest, "rpc/plan": PlanRequest}


@dataclass(frozen=True, eq=False)
class QueuedQuery:
    """A queued query: its request, deadline `until` (monotonic ns), and whether it was cancelled."""

    query: zenoh.Query
    request: KinematicsRequest
    until: int
    cancelled: threading.Event


class IkProcess:
    """The queue between zenoh's threads and the thread that solves."""

    def __init__(self, config: Config, memory: SharedFd) -> None:
        self._config = config
        self._shared = SharedRecords(memory.number)
        self._log = structlog.get_logger().bind(robot=config.robot, process="ik")
        self._queue: queue.Queue[QueuedQuery] = queue.Queue(QUEUE)
        self._ending = False
        self._pending: list[QueuedQuery] = []
        self._headers = HeaderSource()
        self._service: IkService | None = None
        self._checked: tuple[bytes, bytes] | None = None
        self._shared.ik_model = NO_MODEL
        self._update_model()

    def run(self) -> None:
        """Answers queries until SIGTERM."""
        signal.signal(signal.SIGTERM, lambda *_: setattr(self, "_ending", True))
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        zenoh_table = self._config.zenoh
        with zenoh.open(client(own_endpoints(zenoh_table), zenoh_table.config)) as session:
            for tail, kind in REQUESTS.items():
                serve(session, key(self._config.robot, tail), partial(self._enqueue, kind), self._refuse)
            serve(session, key(self._config.robot, "rpc/cancel"), self._cancel, self._refuse)
            self._work()

    def _enqueue(self, kind: type[KinematicsRequest], query: zenoh.Query, data: bytes) -> None:
        request = unpack(kind, data)
        allowed = FK_DEADLINE if isinstance(request, FkRequest) else request.deadline_ms * MS
        queued = QueuedQuery(query, request, time.monotonic_ns() + int(allowed), threading.Event())
        self._pending.append(queued)
        try:
            self._queue.put_nowait(queued)
        except queue.Full:
            self._pending.remove(queued)
            raise RequestError("busy", f"{QUEUE} queries are waiting; ask again", retryable=True) from None

    def _cancel(self, query: zenoh.Query, data: bytes) -> None:
        request = unpack(CancelRequest, data)
        for queued in tuple(self._pending):
            if not isinstance(queued.request, FkRequest) and queued.request.id == request.id:
                queued.cancelled.set()
        with query:
            query.reply(query.key_expr, pack(Message()))

    def _work(self) -> None:
        while not self._ending:
            self._shared.ik[0] = time.monotonic_ns()
            try:
                queued = self._queue.get(timeout=0.2)
            except queue.Empty:
                self._update_model()
                continue
            self._update_model()
            try:
                self._answer(queued)
            finally:
                self._pending.remove(queued)

    def _update_model(self) -> None:
        """Loads the model that the daemon accepted, once the file has its digest."""
        accepted = self._shared.model
        if accepted == self._shared.ik_model and self._service is not None:
            return
        try:
            found = digest_of(self._config)
        except FileError:
            found = NO_MODEL
        if (accepted, found) == self._checked:
            return
        self._checked = accepted, found
        try:
            if found != accepted:
                raise LrmError(f"{self._config.model} is not the file that the daemon accepted; reload it")
            self._service = IkService(self._config, deploy(self._config))
            self._shared.ik_model = self._service.deployed.digest
        except LrmError as error:
            self._log.error("model_refused", text=str(error))

    def _answer(self, queued: QueuedQuery) -> None:
        try:
            reply = self._solve(queued, time.perf_counter())
        except Exception as error:
            self._refuse(queued.query, error)
        else:
            self._shared.ik[1] += 1
            with queued.query as query:
                query.reply(query.key_expr, pack(reply))

    def _solve(self, queued: QueuedQuery, started: float) -> Message:
        request, service = queued.request, self._service
        if service is None:
            raise RequestError("no_model", "the model's file changed since the daemon loaded it; rpc/reload takes it")

        def check_cancelled() -> None:
            self._shared.ik[0] = time.monotonic_ns()
            if time.monotonic_ns() > queued.until:
                raise RequestError("deadline", "the deadline passed before the answer was there", retryable=True)
            if queued.cancelled.is_set():
                raise RequestError("cancelled", "the request was cancelled")

        deployed = service.deployed
        kind: type[Header]
        content: dict[str, Any] = {"left_out": list(deployed.left_out)}
        if isinstance(request, IkRequest):
            kind, content["answers"] = IkReply, service.inverse(request, check_cancelled)
        elif isinstance(request, FkRequest):
            kind, content["places"] = FkReply, service.forward(request, check_cancelled)
        else:
            kind, content = PlanReply, _plan_content(service.plan(request, check_cancelled))
        content |= {"model": deployed.path, "model_sha256": deployed.sha256}
        content["elapsed_ms"] = (time.perf_counter() - started) * 1e3
        return kind(**self._headers.next("ik"), **content)

    def _refuse(self, query: zenoh.Query, error: Exception) -> None:
        self._shared.ik[2] += 1
        reply_error(query, error, self._log)


def _plan_content(path: JointPath | str) -> dict[str, Any]:
    if isinstance(path, str):
        return {"found": False, "text": path}
    moves = f"{len(path.waypoints) - 1} straight moves"
    return {"found": True, "text": moves, "waypoints_rad": [list(q) for q in path.waypoints]}


def run(config: Config, memory: SharedFd) -> None:
    """Entry point of the process: answers queries until SIGTERM or until its parent ends."""
    die_with_parent()
    log.set_up()
    IkProcess(config, memory).run()
