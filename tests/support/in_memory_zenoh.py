"""A daemon and its clients without processes or network: the real face, core, ramp and client on a wire in memory."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import zenoh

from lrm_math.errors import LrmError
from lrmd.api.publisher import Telling
from lrmd.api.supervisor import Child
from lrmd.api.zenoh_server import Face, error_reply
from lrmd.control.events import Done, Happening
from lrmd.messages.control import EstopCommand, LeaseRequest, Message, pack, unpack
from lrmd.ramp.shared_memory import Shared
from tests.support.in_memory_daemon import World

STRIDE = 15
"""Ticks that pass between two looks of a client, about 100 ms."""


@dataclass(frozen=True)
class Payload:
    """Bytes as zenoh hands them over."""

    data: bytes

    def to_bytes(self) -> bytes:
        return self.data


@dataclass(frozen=True)
class Sample:
    """What a subscriber sees."""

    key_expr: str
    payload: Payload


@dataclass(frozen=True)
class Answer:
    """One reply, good or bad."""

    ok: Sample | None = None
    err: Sample | None = None


@dataclass
class Query:
    """What a queryable sees."""

    key_expr: str
    payload: Payload | None
    answers: list[Answer] = field(default_factory=list)
    ended: bool = False

    def __enter__(self) -> Query:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended = True

    def reply(self, key: str, data: bytes) -> None:
        self.answers.append(Answer(ok=Sample(key, Payload(data))))

    def reply_err(self, data: bytes) -> None:
        self.answers.append(Answer(err=Sample(self.key_expr, Payload(data))))


class Wire:
    """One session for everybody: what is put or asked reaches who declared a key that meets it."""

    def __init__(self) -> None:
        self._queryables: list[tuple[str, Callable[[Query], None]]] = []
        self._subscribers: list[tuple[str, Callable[[Sample], None]]] = []
        self._lock = threading.RLock()

    def declare_queryable(self, key: str, callback: Callable[[Query], None]) -> None:
        self._queryables.append((key, callback))

    def declare_subscriber(self, key: str, callback: Callable[[Sample], None]) -> None:
        self._subscribers.append((key, callback))

    def declare_publisher(self, key: str, **_: object) -> mock.Mock:
        return mock.Mock(put=lambda data: self.put(key, data))

    def liveliness(self) -> mock.Mock:
        return mock.Mock()

    def put(self, key: str, data: bytes, **_: object) -> None:
        with self._lock:
            for own, callback in self._subscribers:
                if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(own)):
                    callback(Sample(key, Payload(data)))

    def get(self, key: str, payload: bytes = b"", **_: object) -> list[Answer]:
        with self._lock:
            queries = []
            for own, callback in self._queryables:
                if zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(own)):
                    queries.append(Query(key, Payload(payload) if payload else None))
                    callback(queries[-1])
            assert all(query.ended for query in queries), "a query that stays open also gives its asker a timeout"
            return [answer for query in queries for answer in query.answers]

    def close(self) -> None:
        """The client's end; the wire stays."""


class Daemon:
    """The owner behind the face. Time passes when a client looks at the mode, and a lease never runs out meanwhile."""

    def __init__(self, world: World) -> None:
        self.world, self.wire = world, Wire()
        self.told: list[bytes] = []
        self.shared = Shared.create()
        self._telling = Telling(world.config, world.core, self.shared, Child("ramp", print), Child("ik", print))
        self.face = Face(self.wire, world.config.robot, self, tuple(self._telling.states))

    def _flush(self) -> None:
        for happening in self.world.core.happenings:
            self.told.append(pack(self._telling.event(happening)))
            self.face.tell(happening.code, self.told[-1])
        self.world.core.happenings.clear()

    def carry_out(self, tail: str, request: Message) -> Message:
        self.world.core.observe(self.world.report, self.world.now)
        done = self.world.core.handle(request, self.world.now)
        self._flush()
        return self._telling.reply(tail, done)

    def refused(self, tail: str, error: LrmError) -> None:
        reply = error_reply(error)
        self.world.core.happenings.append(Happening("refused", "warning", f"{tail}: {reply.msg}", {"why": reply.code}))
        self._flush()

    def stop_everything(self, data: bytes) -> Message:
        self.world.rung = True
        self.world.core.estop(self.world.now, unpack(EstopCommand, data).why)
        self.world.run(2)
        return self._telling.reply("rpc/estop", Done())

    def state(self, tail: str) -> Message:
        core = self.world.core
        if tail == "state/mode":
            if core.lease is not None:
                core.handle(LeaseRequest(action="renew", lease=core.lease.token), self.world.now)
            self.world.run(STRIDE)
            self._flush()
        return self._telling.states[tail]()

    def events(self) -> list[bytes]:
        return self.told

    @contextmanager
    def reachable(self) -> Iterator[None]:
        """Lets every `Rover` that is made meanwhile reach this daemon."""
        with mock.patch("lrmd.client.rover.zenoh.open", side_effect=self._opened):
            yield

    def _opened(self, _: Any) -> Wire:
        return self.wire
