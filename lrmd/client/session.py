"""A zenoh session with one daemon: queries, subscriptions and the command lease."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import zenoh

from lrm_math.errors import LrmError
from lrmd.client.identity import Daemon, DaemonRestarted, QueryAnswer, SeveralDaemons, Subscription, boot_ids
from lrmd.messages.codec import ErrorReply, Header, Message, field_named, pack, unpack_shown
from lrmd.messages.control import LeaseRequest, Reply
from lrmd.messages.zenoh_session import client, key

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ROBOT_NAME = r"[A-Za-z0-9_-]+"
RENEWAL_S = 0.3
EVENTS = "rpc/events"
"""The query that has many replies, all written before it."""
STOPS = ("rpc/estop", "rpc/hold")
"""Queries that are sent before it is known who the daemon is: nothing delays a stop."""
S = TypeVar("S", bound=Header)


class NoReply(LrmError):
    """No reply: no daemon of that name, or no permission."""


class RequestRefused(LrmError):
    """The daemon's error reply; carries `code`, `retryable` and `detail`."""

    def __init__(self, reply: ErrorReply) -> None:
        self.code, self.retryable, self.detail = reply.code, reply.retryable, reply.detail
        super().__init__(reply.msg)


@dataclass(frozen=True)
class HeldLease:
    """The lease that one start of the daemon gave."""

    token: str
    boot_id: str


class RoverSession:
    """A session with one daemon: that whose boot id `info` says at the first query.

    Replies and states of another boot id, and such as are older than what was known when they were asked for, are no
    replies and no states. A daemon that was restarted is recognised, and `info` asked again: states go on, and commands
    raise `DaemonRestarted` until the lease is taken anew.

    A command says how many stops this session knows of: those before it took the lease, its own, and those that it was
    told of by `mode` or an exception. After another one the daemon refuses it, once (`overtaken`).

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
        self._daemon: Daemon | None = None
        self._confirming, self._seeing = threading.Lock(), threading.Lock()
        self._lease: HeldLease | None = None
        self._stops: int | None = None
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
        expired, because this computer was busy or the network slow, is acquired anew, within 10 s and unless another
        client had it.
        """
        with field_named():
            request = LeaseRequest(action="acquire", holder=holder, take=take)
        reply = self._query(Reply, "rpc/lease", request)
        self._lease, self._stops = _held(reply), reply.stops
        ended = threading.Event()
        period = (reply.lease_ms or 400.0) / 4000
        beat = threading.Thread(target=self._keep_alive, args=(ended, period, holder), daemon=True)
        beat.start()
        try:
            yield self
        finally:
            ended.set()
            beat.join()
            with suppress(LrmError):
                self._query(Reply, "rpc/lease", LeaseRequest(action="release", lease=self._token()), RENEWAL_S)
            self._lease = None

    def _keep_alive(self, ended: threading.Event, period: float, holder: str) -> None:
        while not ended.wait(period):
            with suppress(LrmError):
                try:
                    self.renew(RENEWAL_S)
                except RequestRefused:
                    again = LeaseRequest(action="acquire", holder=holder, lease=self._token())
                    self._lease = _held(self._query(Reply, "rpc/lease", again))

    def renew(self, timeout: float | None = None) -> str:
        """Renews the lease, and returns its token. Raises `RequestRefused` if it is not this session's any more."""
        token = self._token()
        self._query(Reply, "rpc/lease", LeaseRequest(action="renew", lease=token), timeout)
        return token

    def _token(self) -> str:
        """The lease's token. Raises `DaemonRestarted` if the daemon that gave it is not there any more."""
        if self._lease is None:
            raise LrmError("commands need the lease: use `with rover.control('who I am'):`")
        self._check_restart()
        return self._lease.token

    def _check_restart(self) -> None:
        lease, daemon = self._lease, self._daemon
        if lease is not None and daemon is not None and lease.boot_id != daemon.boot_id:
            raise DaemonRestarted(self.robot, lease.boot_id, daemon.boot_id)

    # ---- queries and subscriptions

    def watch(self, kind: type[S], tail: str, callback: Callable[[S], None]) -> zenoh.Subscriber[None]:
        """Subscribes `callback` to a key, for instance `watch(JointsState, "state/joints", print)`."""
        self._identified()
        received = Subscription(lambda data: callback(unpack_shown(kind, data)), lambda: self._daemon, self._confirm)
        return self._session.declare_subscriber(
            key(self.robot, tail), lambda sample: received.take(str(sample.key_expr), sample.payload.to_bytes())
        )

    def listen(self, whole: str, callback: Callable[[bytes], None]) -> zenoh.Subscriber[None]:
        """Subscribes `callback` to the payloads of any key, of the robot or not."""
        try:
            return self._session.declare_subscriber(whole, lambda sample: callback(sample.payload.to_bytes()))
        except zenoh.ZError:
            raise LrmError(f"'{whole}' is no zenoh key; for instance lab/tracker") from None

    def _query(self, kind: type[S], tail: str, request: Message | None = None, timeout: float | None = None) -> S:
        payload = b"" if request is None else pack(request)
        return unpack_shown(kind, self._replies(tail, payload, timeout or self._timeout)[0])

    def _replies(
        self, tail: str, payload: bytes, timeout: float, source: zenoh.SourceInfo | None = None
    ) -> list[bytes]:
        """Payloads of the daemon's replies, one but for `rpc/events`.

        Raises `RequestRefused` on its error reply, `NoReply` without a reply of it, and `SeveralDaemons`.
        """
        daemon = self._daemon if tail in STOPS else self._identified()
        answers = self._query_all(tail, payload, timeout, source)
        if tail == EVENTS and daemon is not None:
            daemon = replace(daemon, seen=0)
        answers_of_daemon = self._of_daemon(answers, daemon)
        if refused := next((answer for answer in answers_of_daemon if answer.refused), None):
            self._check_restart()
            raise self._refusal(unpack_shown(ErrorReply, refused.data))
        if tail == EVENTS:
            return [answer.data for answer in answers_of_daemon]
        if not answers_of_daemon:
            raise self._no_reply(tail, answers)
        if len(answers_of_daemon) > 1 and daemon is not None:
            raise self._several(tail, answers_of_daemon)
        return [answers_of_daemon[0].data]

    def _refusal(self, reply: ErrorReply) -> RequestRefused:
        """The error of a refused request; who is told of a stop knows of it from then on."""
        if isinstance(stops := reply.detail.get("stops"), int):
            self._stops = stops
        return RequestRefused(reply)

    def _query_all(
        self, tail: str, payload: bytes, timeout: float, source: zenoh.SourceInfo | None = None
    ) -> list[QueryAnswer]:
        """Replies of everybody. Asked are all: who declares that he alone has the whole answer is not believed."""
        whole = key(self.robot, tail)
        replies = self._session.get(
            whole, payload=payload, timeout=timeout, target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE, source_info=source,
        )  # fmt: skip
        return [QueryAnswer.of(reply, whole) for reply in replies]

    def _of_daemon(self, answers: Sequence[QueryAnswer], daemon: Daemon | None) -> list[QueryAnswer]:
        """The daemon's own answers among those of everybody; asks `info` if they may be those of its next start."""
        if daemon is None:
            return [answer for answer in answers if answer.origin is not None]
        answers_of_daemon = [answer for answer in answers if answer.origin is not None and daemon.wrote(answer.origin)]
        if (
            others := []
            if answers_of_daemon
            else [boot_id for boot_id in boot_ids(answers) if boot_id != daemon.boot_id]
        ):
            now = self._confirm().boot_id
            return [a for a in answers if now in others and a.origin is not None and a.origin.boot_id == now]
        self._see(
            daemon.boot_id, max((a.origin.t_mono_ns for a in answers_of_daemon if a.origin is not None), default=0)
        )
        return answers_of_daemon

    def _see(self, boot_id: str, t_mono_ns: int) -> None:
        with self._seeing:
            if self._daemon is not None and self._daemon.boot_id == boot_id:
                self._daemon = replace(self._daemon, seen=max(self._daemon.seen, t_mono_ns))

    @property
    def boot_id(self) -> str:
        """Boot id of the daemon as last confirmed by its `info`. Raises `NoReply`, `SeveralDaemons`."""
        return self._identified().boot_id

    def _identified(self) -> Daemon:
        return self._daemon or self._confirm()

    def _confirm(self) -> Daemon:
        """Asks `info` which start of the daemon is there. Raises `NoReply`, `SeveralDaemons`."""
        with self._confirming:
            answers = self._query_all("info", b"", self._timeout)
            before = "" if self._daemon is None else self._daemon.boot_id
            named = [a for a in answers if a.origin is not None and not a.refused]
            answers_of_boot = [a for a in named if a.origin is not None and a.origin.boot_id == before] or named
            if not answers_of_boot or answers_of_boot[0].origin is None:
                raise self._no_reply("info", answers)
            if len(answers_of_boot) > 1:
                raise self._several("info", answers_of_boot)
            origin = answers_of_boot[0].origin
            with self._seeing:
                self._daemon = Daemon(origin.boot_id, origin.t_mono_ns, origin.t_mono_ns)
                return self._daemon

    def _source(self, tail: str) -> zenoh.SourceInfo:
        """This session's name, by its querier, which is of the first key that it is asked for."""
        if self._querier is None:
            self._querier = self._session.declare_querier(key(self.robot, tail))
        return zenoh.SourceInfo(self._querier.id, 0)

    def _several(self, tail: str, answers: Sequence[QueryAnswer]) -> SeveralDaemons:
        ids = ", ".join(boot_ids(answers))
        return SeveralDaemons(
            f"{len(answers)} programs answer {key(self.robot, tail)} (boot id {ids}), and one should: another daemon "
            "has the name, or somebody imitates it; end the others"
        )

    def _no_reply(self, tail: str, answers: Sequence[QueryAnswer]) -> NoReply:
        whole = key(self.robot, tail)
        if others := ", ".join(boot_ids(answers)):
            return NoReply(f"no answer of the daemon from {whole}; there is one of boot id {others}, or an old one")
        if answers:
            text = answers[0].data.decode(errors="replace")[:64]
            return NoReply(f"no answer from {self.robot} in time ({text if text.isprintable() else ascii(text)})")
        return NoReply(f"no answer from {whole} at {self._where}: no daemon of that name, or no permission")


def _held(reply: Reply) -> HeldLease | None:
    return None if reply.lease is None else HeldLease(reply.lease, reply.boot_id)
