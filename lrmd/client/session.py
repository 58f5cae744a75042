"""A zenoh session with one daemon: queries, subscriptions and the command lease."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Self, TypeVar

import zenoh

from lrm_math.errors import LrmError
from lrmd.messages.codec import ErrorReply, Header, Message, field_named, pack, unpack
from lrmd.messages.control import LeaseRequest, Reply
from lrmd.messages.zenoh_session import client, key

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ROBOT_NAME = r"[A-Za-z0-9_-]+"
RENEWAL_S = 0.3
S = TypeVar("S", bound=Header)


class NoReply(LrmError):
    """No reply: no daemon of that name, or no permission."""


class RequestRefused(LrmError):
    """The daemon's error reply; carries `code`, `retryable` and `detail`."""

    def __init__(self, reply: ErrorReply) -> None:
        self.code, self.retryable, self.detail = reply.code, reply.retryable, reply.detail
        super().__init__(reply.msg)


class RoverSession:
    """A session with one daemon.

    `connect`: zenoh endpoints; default: the environment variable LRM_CONNECT (comma-separated), or this machine.
    `config`: a zenoh file with a password or certificates; default: LRM_ZENOH_CONFIG. `timeout`: s per query.
    """

    def __init__(
        self,
        robot: str = "rover",
        connect: Sequence[str] | None = None,
        config: str | None = None,
        timeout: float = 2.0,
    ) -> None:
        if not re.fullmatch(ROBOT_NAME, robot):
            raise LrmError(f"robot '{robot}': a name has letters, digits, _ and - only")
        endpoints = connect or os.environ.get("LRM_CONNECT", DEFAULT_ENDPOINT).split(",")
        self.robot = robot
        self._timeout = timeout
        self._where = ", ".join(endpoints)
        try:
            self._config = client(list(endpoints), config or os.environ.get("LRM_ZENOH_CONFIG"))
        except zenoh.ZError:
            raise LrmError(f"{self._where}: should be zenoh endpoints like {DEFAULT_ENDPOINT}") from None
        self._lease: str | None = None
        self._querier: zenoh.Querier | None = None

    def __enter__(self) -> Self:
        try:
            self._session = zenoh.open(self._config)
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0]
            raise NoReply(f"no connection to {self._where} ({reason}); is lrmd running, and allowed?") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    # ---- the lease

    @contextmanager
    def control(self, holder: str, take: bool = False) -> Iterator[Self]:
        """Holds the command lease during the block, renewed by a thread.

        Raises `RequestRefused` if another client has it (unless `take`). Losing it ends a motion in hold; a lease that
        expired, because this computer was busy or the network slow, is acquired anew unless another client had it.
        """
        with field_named():
            request = LeaseRequest(action="acquire", holder=holder, take=take)
        reply = self._query(Reply, "rpc/lease", request)
        self._lease = reply.lease
        ended = threading.Event()
        period = (reply.lease_ms or 400.0) / 4000
        beat = threading.Thread(target=self._keep_alive, args=(ended, period, holder), daemon=True)
        beat.start()
        try:
            yield self
        finally:
            ended.set()
            beat.join()
            lease, self._lease = self._lease, None
            if lease is not None:
                with suppress(RequestRefused, NoReply):
                    self._query(Reply, "rpc/lease", LeaseRequest(action="release", lease=lease), RENEWAL_S)

    def _keep_alive(self, ended: threading.Event, period: float, holder: str) -> None:
        while not ended.wait(period):
            if (lease := self._lease) is None:
                continue
            with suppress(RequestRefused, NoReply):
                try:
                    self._query(Reply, "rpc/lease", LeaseRequest(action="renew", lease=lease), RENEWAL_S)
                except RequestRefused:
                    again = LeaseRequest(action="acquire", holder=holder, lease=lease)
                    self._lease = self._query(Reply, "rpc/lease", again).lease

    def _token(self) -> str:
        if self._lease is None:
            raise LrmError("commands need the lease: use `with rover.control('who I am'):`")
        return self._lease

    # ---- queries and subscriptions

    def watch(self, kind: type[S], tail: str, callback: Callable[[S], None]) -> zenoh.Subscriber[None]:
        """Subscribes `callback` to a key, for instance `watch(JointsState, "state/joints", print)`."""
        return self._session.declare_subscriber(
            key(self.robot, tail), lambda sample: callback(unpack(kind, sample.payload.to_bytes()))
        )

    def listen(self, whole: str, callback: Callable[[bytes], None]) -> zenoh.Subscriber[None]:
        """Subscribes `callback` to the payloads of any key, of the robot or not."""
        try:
            return self._session.declare_subscriber(whole, lambda sample: callback(sample.payload.to_bytes()))
        except zenoh.ZError:
            raise LrmError(f"'{whole}' is no zenoh key; for instance lab/tracker") from None

    def _query(self, kind: type[S], tail: str, request: Message | None = None, timeout: float | None = None) -> S:
        payload = b"" if request is None else pack(request)
        return unpack(kind, self._replies(tail, payload, timeout or self._timeout)[0])

    def _replies(
        self, tail: str, payload: bytes, timeout: float, source: zenoh.SourceInfo | None = None
    ) -> list[bytes]:
        """Payloads of all replies. Raises `RequestRefused` on an error reply, `NoReply` without any."""
        whole = key(self.robot, tail)
        found: list[bytes] = []
        no_merging = zenoh.ConsolidationMode.NONE
        for reply in self._session.get(
            whole, payload=payload, timeout=timeout, consolidation=no_merging, source_info=source
        ):
            if reply.ok is not None:
                found.append(reply.ok.payload.to_bytes())
            elif reply.err is not None and not found:
                raise self._error(reply.err.payload.to_bytes())
        if not found and tail != "rpc/events":
            raise NoReply(f"no answer from {whole} at {self._where}: no daemon of that name, or no permission")
        return found

    def _source(self, tail: str) -> zenoh.SourceInfo:
        """This session's name, by its querier, which is of the first key that it is asked for."""
        if self._querier is None:
            self._querier = self._session.declare_querier(key(self.robot, tail))
        return zenoh.SourceInfo(self._querier.id, 0)

    def _error(self, data: bytes) -> LrmError:
        try:
            return RequestRefused(unpack(ErrorReply, data))
        except LrmError:
            return NoReply(f"no answer from {self.robot} in time ({data.decode(errors='replace')})")
