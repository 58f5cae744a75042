"""The router process: zenoh's router of the daemon, and the emergency stop.

Clients connect to it, and it signals the ramp itself: an emergency stop passes through no process that is busy, or
stopped. So it does nothing else, and imports little.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import msgpack
import zenoh
from zenoh.handlers import Callback

from lrm_math.errors import LrmError
from lrmd.heap import return_freed_memory
from lrmd.log import BackgroundFile
from lrmd.messages.inbox import Inbox
from lrmd.ramp.parent import SharedFd, die_with_parent
from lrmd.ramp.shared_memory import SharedRecords

HEARTBEAT_S = 0.2
HEARTBEAT_KEY = "@lrmd/heartbeat"
"""Key of a put that no `**` receives: it passes zenoh's routing tables, and raises after a thread panicked in them."""
CONFIRM_S, POLL_S = 0.1, 0.001
"""s: how long the ramp may take to confirm, 15 of its ticks, and how often that is looked for."""
READERS = "(rx: (worker_threads: 16))"
"""zenoh's setting of its runtime: threads that read from clients. One reads from a client for as long as there is
something, so two flooding clients would keep its usual two from all others."""
SOCKET_THREADS = "acc-"
"""Names of zenoh's threads that wait for its sockets and wake the readers. Beside two flooding clients they waited up
to 2 s for a processor in spite of their niceness: where Linux shares processors among groups (sessions, services), a
thread of little work weighs little beside a busy one of its group on another processor."""
NICENESS = -10
"""Before everything without a real-time priority, where the system allows it (`LimitNICE` of the unit)."""
LONGEST_REASON, LONGEST_COMMAND = 64, 1313
"""Characters of a reason that are kept, and bytes of an `EstopCommand`; what is longer is not read."""
UNREADABLE = "a message that cannot be read"


@dataclass(frozen=True)
class EstopReplies:
    """Contents of the replies to `rpc/estop`; the time and number of a reply are filled in."""

    stopped: dict[str, Any]
    unconfirmed: dict[str, Any]
    wildcard: dict[str, Any]


@dataclass(frozen=True)
class RouterSetup:
    """Start arguments. `zenoh`: the router's configuration as JSON; `keys`: on which a put is an emergency stop;
    `query`: the key of the query; `gone`: the prefix of the keys on which ended sessions of clients are told."""

    zenoh: str
    keys: tuple[str, ...]
    query: str
    gone: str
    replies: EstopReplies
    memory: SharedFd
    estop: SharedFd


def reason_of(payload: zenoh.ZBytes | None) -> str:
    """The `why` of an `EstopCommand`; also a message that cannot be read, or is too long to be one, stops the arm."""
    if payload is None or not len(payload):
        return ""
    if len(payload) > LONGEST_COMMAND:
        return UNREADABLE
    try:
        content = msgpack.unpackb(payload.to_bytes())
    except (ValueError, msgpack.UnpackException):
        return UNREADABLE
    reason = content.get("why", "") if isinstance(content, dict) else UNREADABLE
    if not isinstance(reason, str):
        return UNREADABLE
    return "".join(c for c in reason if c.isprintable())[:LONGEST_REASON]


class EstopServer:
    """The keys of the emergency stop on a session: `signal` stops for a reason, `confirmed` waits for the ramp.

    The signal is sent in zenoh's own thread, so that nothing piles up before it; only replies wait, in an inbox.
    """

    def __init__(
        self, session: zenoh.Session, keys: tuple[str, ...], query: str, replies: EstopReplies,
        signal: Callable[[str], None], confirmed: Callable[[], bool], inbox: Inbox,
    ) -> None:  # fmt: skip
        self._keys, self._query, self._replies, self._signal = keys, query, replies, signal
        self._confirmed, self._inbox, self._seq = confirmed, inbox, count(1)
        session.declare_subscriber(keys[0], Callback(self._command, indirect=False))
        session.declare_queryable(query, Callback(self._request, indirect=False))

    def _command(self, sample: zenoh.Sample) -> None:
        if str(sample.key_expr) in self._keys:
            self._signal(reason_of(sample.payload))

    def _request(self, query: zenoh.Query) -> None:
        if str(query.key_expr) != self._query:
            with query:
                query.reply_err(msgpack.packb(self._replies.wildcard))
            return
        self._signal(reason_of(query.payload))
        try:
            self._inbox.put(0, lambda: partial(self._reply, query, self._confirmed()))
        except LrmError:
            self._reply(query, False)

    def _reply(self, query: zenoh.Query, confirmed: bool) -> None:
        with query:
            if confirmed:
                now = {"seq": next(self._seq), "t_mono_ns": time.monotonic_ns(), "t_wall_ns": time.time_ns()}
                query.reply(self._query, msgpack.packb(self._replies.stopped | now))
            else:
                query.reply_err(msgpack.packb(self._replies.unconfirmed))


class RampSignal:
    """The ramp's eventfd, and its report."""

    def __init__(self, shared: SharedRecords, estop: int) -> None:
        self._shared, self._estop = shared, estop

    def send(self, reason: str) -> None:
        """Signals the ramp, then the api process."""
        os.eventfd_write(self._estop, 1)
        self._shared.estop_reason = reason
        self._shared.router[1] += 1

    def confirmed(self) -> bool:
        """Waits until the ramp has read the signal, which it does in every tick; whether it has."""
        before, deadline = self._tick(), time.monotonic() + CONFIRM_S
        while self._tick() < before + 2:
            if time.monotonic() > deadline:
                return False
            time.sleep(POLL_S)
        return True

    def _tick(self) -> int:
        report = self._shared.read_report()
        return 0 if report is None else report.tick


def tell_gone(session: zenoh.Session, gone: str, event: zenoh.TransportEvent) -> None:
    """Tells the daemon's other processes which client's session has been closed, or was broken off."""
    if event.kind == zenoh.SampleKind.DELETE:
        session.put(f"{gone}/{event.transport.zid}", b"")


def run(setup: RouterSetup) -> None:
    """Entry point of the process: routes until SIGTERM or until its parent ends."""
    die_with_parent()
    return_freed_memory()
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    shared = SharedRecords(setup.memory.number)
    _go_first()
    try:
        with zenoh.open(zenoh.Config.from_json5(setup.zenoh)) as session:
            _raise_socket_threads()
            session.info.declare_transport_events_listener(partial(tell_gone, session, setup.gone))
            ramp = RampSignal(shared, setup.estop.number)
            EstopServer(session, setup.keys, setup.query, setup.replies, ramp.send, ramp.confirmed, Inbox())
            while not ending:
                session.put(HEARTBEAT_KEY, b"")
                shared.router[0] = time.monotonic_ns()
                time.sleep(HEARTBEAT_S)
    except zenoh.ZError as error:
        text = str(error).split(" at /")[0]
        _log("error", "router_failed", text)
        sys.exit(1)


def _raise_socket_threads() -> None:
    """Lowest real-time priority, where the system allows it, for `SOCKET_THREADS`: short work, beside new sessions."""
    with suppress(PermissionError):
        for task in Path("/proc/self/task").iterdir():
            if (task / "comm").read_text().startswith(SOCKET_THREADS):
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(1))


def _go_first() -> None:
    """Threads of zenoh that start after this wait neither for each other nor for ordinary processes."""
    os.environ.setdefault("ZENOH_RUNTIME", READERS)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    except PermissionError:
        text = f"the system refuses niceness {NICENESS} to the router: beside other work an emergency stop takes longer"
        _log("info", "router_priority", text)


def _log(level: str, event: str, text: str) -> None:
    BackgroundFile().write(json.dumps({"level": level, "event": event, "text": text}) + "\n")
