"""A daemon and its clients without processes or network: the real server, controller, ramp and client."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import zenoh

from lrm_math.errors import LrmError
from lrmd.api.children import estop_replies
from lrmd.api.publisher import StatePublisher
from lrmd.api.router_process import EstopServer
from lrmd.api.supervisor import ChildProcess
from lrmd.api.zenoh_server import ZenohServer
from lrmd.control.state import ControllerEvent
from lrmd.messages.codec import Message, error_reply, pack
from lrmd.messages.control import LeaseRequest
from lrmd.messages.inbox import Inbox, Send
from lrmd.messages.zenoh_session import key
from lrmd.ramp.shared_memory import SharedRecords
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

STRIDE = 15
"""Ticks that pass between two reads of the mode, about 100 ms."""


@dataclass(frozen=True)
class FakePayload:
    """`zenoh.ZBytes`."""

    data: bytes

    def to_bytes(self) -> bytes:
        return self.data

    def __len__(self) -> int:
        return len(self.data)


@dataclass(frozen=True)
class FakeSample:
    """`zenoh.Sample`."""

    key_expr: str
    payload: FakePayload


@dataclass(frozen=True)
class FakeReply:
    """`zenoh.Reply`."""

    ok: FakeSample | None = None
    err: FakeSample | None = None


@dataclass
class FakeQuery:
    """`zenoh.Query`."""

    key_expr: str
    payload: FakePayload | None
    answers: list[FakeReply] = field(default_factory=list)
    ended: bool = False

    def __enter__(self) -> FakeQuery:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended = True

    def reply(self, key: str, data: bytes) -> None:
        self.answers.append(FakeReply(ok=FakeSample(key, FakePayload(data))))

    def reply_err(self, data: bytes) -> None:
        self.answers.append(FakeReply(err=FakeSample(self.key_expr, FakePayload(data))))


class AtOnce(Inbox):
    """An inbox whose work is done when it is put in."""

    def put(self, size: int, work: Callable[[], Send]) -> None:
        self.came = time.monotonic_ns()
        work()()


class FakeZenohSession:
    """One session for everybody: puts and gets reach those who declared an intersecting key expression."""

    def __init__(self) -> None:
        self._queryables: list[tuple[str, Callable[[FakeQuery], None]]] = []
        self._subscribers: list[tuple[str, Callable[[FakeSample], None]]] = []
        self.lock = threading.RLock()

    def declare_queryable(self, key: str, callback: Callable[[FakeQuery], None]) -> None:
        self._queryables.append((key, callback))

    def declare_subscriber(self, key: str, callback: Callable[[FakeSample], None]) -> None:
        self._subscribers.append((key, callback))

    def declare_publisher(self, key: str, **_: object) -> mock.Mock:
        return mock.Mock(put=lambda data: self.put(key, data))

    def liveliness(self) -> mock.Mock:
        return mock.Mock()

    def put(self, key: str, data: bytes, **_: object) -> None:
        with self.lock:
            for own, callback in self._subscribers:
                if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(own)):
                    callback(FakeSample(key, FakePayload(data)))

    def get(self, key: str, payload: bytes = b"", **_: object) -> list[FakeReply]:
        with self.lock:
            queries = []
            for own, callback in self._queryables:
                if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(own)):
                    queries.append(FakeQuery(key, FakePayload(payload) if payload else None))
                    callback(queries[-1])
            assert all(query.ended for query in queries), "a query that stays open also gives its asker a timeout"
            return [answer for query in queries for answer in query.answers]

    def close(self) -> None:
        """The client's end; the session stays."""


class InMemoryDaemon:
    """The request handler behind the zenoh server. Time passes when a client looks at its motion, its lease renewed."""

    def __init__(self, sim: SimulatedDaemon, boot_id: str = "b00710000000000d") -> None:
        self.sim, self.session, self.boot_id = sim, FakeZenohSession(), boot_id
        self.published: list[bytes] = []
        self.shared = SharedRecords.create()
        self._publisher = StatePublisher(
            sim.config, sim.core, self.shared, ChildProcess("ramp", print), ChildProcess("ik", print), boot_id
        )
        states = tuple(self._publisher.states)
        self.server = ZenohServer(self.session, sim.config.robot, self, states, lambda _: AtOnce())
        command, query = (key(sim.config.robot, tail) for tail in ("cmd/estop", "rpc/estop"))
        replies, confirmed = estop_replies(query, boot_id), (lambda: True)
        self.estop = EstopServer(self.session, (command,), query, replies, self.emergency_stop, confirmed, AtOnce())

    def run(self, ticks: int) -> None:
        """Lets so many ticks pass, none beside a request of another thread: a client renews its lease in one."""
        with self.session.lock:
            self.sim.run(ticks)

    def _flush(self) -> None:
        for event in self.sim.core.events:
            self.published.append(pack(self._publisher.event(event)))
            self.server.publish_event(event.code, self.published[-1])
        self.sim.core.events.clear()

    def handle(self, tail: str, request: Message, came: int) -> Message:
        self.sim.settle()
        result = self.sim.core.handle(request, self.sim.now)
        self._flush()
        return self._publisher.reply(tail, result)

    def report_refusal(self, tail: str, error: LrmError) -> None:
        reply = error_reply(error, self.boot_id)
        self.sim.core.events.append(ControllerEvent("refused", "warning", f"{tail}: {reply.msg}", {"why": reply.code}))
        self._flush()

    def emergency_stop(self, reason: str) -> None:
        self.sim.estop_requested = True
        self.sim.core.estop(self.sim.now, reason)
        self.sim.run(2)

    def state(self, tail: str) -> Message:
        core = self.sim.core
        if tail in ("state/mode", "state/skill"):
            if core.lease is not None:
                core.handle(LeaseRequest(action="renew", lease=core.lease.token), self.sim.now)
            self.sim.run(STRIDE)
            self._flush()
        return self._publisher.states[tail]()

    def events(self) -> list[bytes]:
        return self.published

    @contextmanager
    def reachable(self) -> Iterator[None]:
        """Lets every `Rover` that is made meanwhile reach this daemon."""
        with mock.patch("lrmd.client.session.zenoh.open", side_effect=self._opened):
            yield

    def _opened(self, _: Any) -> FakeZenohSession:
        return self.session
