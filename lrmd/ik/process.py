"""The ik process: answers queries for kinematics. Whatever it is busy with, the ramp does not notice."""

from __future__ import annotations

import queue
import secrets
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import structlog
import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd import log
from lrmd.api.zenoh_server import error_reply
from lrmd.config import Config
from lrmd.errors import Refused
from lrmd.ik.planner import Way
from lrmd.ik.service import IkService
from lrmd.messages.control import Message, pack, unpack
from lrmd.messages.kinematics import CancelRequest, FkReply, FkRequest, IkReply, IkRequest, PlanReply, PlanRequest
from lrmd.messages.zenoh_session import client, key, own_endpoints
from lrmd.ramp.process import die_with_parent
from lrmd.ramp.shared_fd import SharedFd
from lrmd.ramp.shared_memory import NO_MODEL, Shared
from lrmd.safety.deployed_model import deploy, digest_of

QUEUE = 64
"""Queries that may wait; one more is told to come again."""
MS = 1_000_000
FK_DEADLINE = 1000 * MS


Request = IkRequest | FkRequest | PlanRequest


@dataclass(frozen=True)
class IkSetup:
    """What the ik process is given at its start."""

    config: Config
    memory: SharedFd


@dataclass(frozen=True, eq=False)
class Waiting:
    """A query in the queue: who asked, what, until when (monotonic ns) an answer is wanted, and if not any more."""

    query: zenoh.Query
    request: Request
    until: int
    cancelled: threading.Event


class IkProcess:
    """The queue between zenoh's threads and the one that solves."""

    def __init__(self, setup: IkSetup) -> None:
        self._config = setup.config
        self._shared = Shared(setup.memory.number)
        self._log = structlog.get_logger().bind(robot=setup.config.robot, process="ik")
        self._queue: queue.Queue[Waiting] = queue.Queue(QUEUE)
        self._ending = False
        self._unanswered: list[Waiting] = []
        self._boot_id, self._seq = secrets.token_hex(8), 0
        self._service: IkService | None = None
        self._tried: tuple[bytes, bytes] | None = None
        self._shared.ik_model = NO_MODEL
        self._follow()

    def run(self) -> None:
        """Answers until it is told to stop."""
        signal.signal(signal.SIGTERM, lambda *_: setattr(self, "_ending", True))
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        zenoh_table = self._config.zenoh
        with zenoh.open(client(own_endpoints(zenoh_table), zenoh_table.config)) as session:
            self._declare(session, "rpc/ik", lambda q, data: self._enqueue(q, unpack(IkRequest, data)))
            self._declare(session, "rpc/fk", lambda q, data: self._enqueue(q, unpack(FkRequest, data)))
            self._declare(session, "rpc/plan", lambda q, data: self._enqueue(q, unpack(PlanRequest, data)))
            self._declare(session, "rpc/cancel", lambda q, data: self._cancel(q, unpack(CancelRequest, data)))
            self._work()

    def _declare(self, session: zenoh.Session, tail: str, take: Callable[[zenoh.Query, bytes], None]) -> None:
        own = key(self._config.robot, tail)

        def received(query: zenoh.Query) -> None:
            try:
                if str(query.key_expr) != own:
                    raise Refused("wildcard", f"ask {own} itself; requests to several at once are not carried out")
                take(query, query.payload.to_bytes() if query.payload else b"")
            except LrmError as error:
                self._refuse(query, error)
            except Exception as error:
                self._log.exception("internal_error", key=own)
                self._refuse(query, Refused("internal", f"{type(error).__name__}: {error}"))

        session.declare_queryable(own, received)

    def _enqueue(self, query: zenoh.Query, request: Request) -> None:
        wanted = FK_DEADLINE if isinstance(request, FkRequest) else request.deadline_ms * MS
        waiting = Waiting(query, request, time.monotonic_ns() + int(wanted), threading.Event())
        self._unanswered.append(waiting)
        try:
            self._queue.put_nowait(waiting)
        except queue.Full:
            self._unanswered.remove(waiting)
            raise Refused("busy", f"{QUEUE} queries are waiting; ask again", retryable=True) from None

    def _cancel(self, query: zenoh.Query, request: CancelRequest) -> None:
        for waiting in tuple(self._unanswered):
            if not isinstance(waiting.request, FkRequest) and waiting.request.id == request.id:
                waiting.cancelled.set()
        with query:
            query.reply(query.key_expr, pack(Message()))

    def _work(self) -> None:
        while not self._ending:
            self._shared.ik[0] = time.monotonic_ns()
            try:
                waiting = self._queue.get(timeout=0.2)
            except queue.Empty:
                self._follow()
                continue
            self._follow()
            try:
                self._answer(waiting)
            finally:
                self._unanswered.remove(waiting)

    def _follow(self) -> None:
        """Takes the model that the daemon accepted, as soon as the file is that one, and no other."""
        accepted = self._shared.model
        if accepted == self._shared.ik_model and self._service is not None:
            return
        try:
            found = digest_of(self._config)
        except FileError:
            found = NO_MODEL
        if (accepted, found) == self._tried:
            return
        self._tried = accepted, found
        try:
            if found != accepted:
                raise LrmError(f"{self._config.model} is not the file that the daemon accepted; reload it")
            self._service = IkService(self._config, deploy(self._config))
            self._shared.ik_model = self._service.deployed.digest
        except LrmError as error:
            self._log.error("model_refused", text=str(error))

    def _answer(self, waiting: Waiting) -> None:
        started = time.perf_counter()
        try:
            reply = self._solved(waiting, started)
        except LrmError as error:
            self._refuse(waiting.query, error)
        except Exception as error:
            self._log.exception("internal_error")
            self._refuse(waiting.query, Refused("internal", f"{type(error).__name__}: {error}"))
        else:
            self._shared.ik[1] += 1
            with waiting.query as query:
                query.reply(query.key_expr, pack(reply))

    def _solved(self, waiting: Waiting, started: float) -> Message:
        request, service = waiting.request, self._service
        if service is None:
            raise Refused("no_model", "the model's file changed since the daemon loaded it; rpc/reload takes it")
        deployed = service.deployed

        def goes_on() -> None:
            self._shared.ik[0] = time.monotonic_ns()
            if time.monotonic_ns() > waiting.until:
                raise Refused("deadline", "the deadline passed before the answer was there", retryable=True)
            if waiting.cancelled.is_set():
                raise Refused("cancelled", "the request was cancelled")

        said: dict[str, Any] = {
            "model": deployed.path, "model_sha256": deployed.sha256, "left_out": list(deployed.left_out)
        }  # fmt: skip
        if isinstance(request, IkRequest):
            answers = service.inverse(request, goes_on)
            return IkReply(**self._header(), **said, answers=answers, elapsed_ms=(time.perf_counter() - started) * 1e3)
        if isinstance(request, PlanRequest):
            return self._planned(service, request, goes_on, started)
        places = service.forward(request, goes_on)
        return FkReply(**self._header(), **said, places=places, elapsed_ms=(time.perf_counter() - started) * 1e3)

    def _planned(
        self, service: IkService, request: PlanRequest, goes_on: Callable[[], None], started: float
    ) -> PlanReply:
        way, deployed = service.plan(request, goes_on), service.deployed
        found = isinstance(way, Way)
        return PlanReply(
            **self._header(), found=found,
            text=f"{len(way.waypoints) - 1} straight moves" if isinstance(way, Way) else way,
            waypoints_rad=[list(q) for q in way.waypoints] if isinstance(way, Way) else [],
            model=deployed.path, model_sha256=deployed.sha256, elapsed_ms=(time.perf_counter() - started) * 1e3,
        )  # fmt: skip

    def _header(self) -> dict[str, Any]:
        self._seq += 1
        now = {"t_mono_ns": time.monotonic_ns(), "t_wall_ns": time.time_ns()}
        return {"boot_id": self._boot_id, "seq": self._seq, **now}

    def _refuse(self, query: zenoh.Query, error: LrmError) -> None:
        self._shared.ik[2] += 1
        with query:
            query.reply_err(pack(error_reply(error)))


def run(setup: IkSetup) -> None:
    """The process: answers until it is told to stop or its parent is gone."""
    die_with_parent()
    log.set_up()
    IkProcess(setup).run()
