"""zenoh sessions and queryables: no network access unless the configuration allows it.

Limit of the messages whose wildcards match the emergency stop's keys, per client, in the router itself: a put on
`lrm/**` matches the subscriber of `cmd/estop`, so that each one would call it. zenoh's downsampling limits every
message whose key expression intersects one of a rule. The rules here are keys next to the emergency stop's: with a
chunk or a letter put in somewhere. A wildcard that matches the stop's key matches one of these as well, since what it
leaves open may be longer, too. The stop's key itself, and that of all robots, match none: they are never limited.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from textwrap import shorten
from typing import Any

import zenoh
from zenoh.handlers import Callback

from lrm_math.errors import FileError, LrmError
from lrmd.config import ZenohTable
from lrmd.errors import RequestError
from lrmd.messages.codec import M, Message, check_size, error_reply, pack, unpack
from lrmd.messages.inbox import Inbox, Send

NO_SCOUTING = {"scouting/multicast/enabled": False, "scouting/gossip/enabled": False, "scouting/delay": 0}
NO_SHARED_MEMORY = {"transport/shared_memory/enabled": False}
"""Each client that used it would leave 17 MB in /dev/shm; messages of 500 bytes do not gain by it."""
LARGEST_MESSAGE = 4_400_000
"""Bytes; zenoh takes no longer one from anybody. The longest valid ones are shorter: a way of a thousand waypoints."""
SHORT_MESSAGES = {"transport/link/rx/max_message_size": LARGEST_MESSAGE}
GONE_KEY = "@lrmd/gone"
"""Prefix of the keys `<GONE_KEY>/<zenoh id>` of puts that tell of a client whose session ended."""
OWN_TIMEOUT_MS = 5000
"""Timeout of the daemon's own processes for reaching its router."""
LISTEN_TIMEOUT_MS = 2000
"""How long the router waits for its addresses: that of a killed daemon is free as soon as its router ended."""
ACCEPT_TIMEOUT_MS = 2000
"""How long a connection may take to introduce itself: a hundred that do not keep everybody else out so long."""
QUICK_RETRY = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}
RATE_HZ = 10.0
"""Messages per second and client that pass each rule, so that their sender is still told what is wrong."""
MESSAGES = {"cmd/estop": ["put", "delete"], "rpc/estop": ["query"]}
FILLER = "-"
LONGEST_WORDS = 200


def key(robot: str, tail: str) -> str:
    """Key expression of a robot's `tail`, such as `state/mode`."""
    return f"lrm/{robot}/{tail}"


def addresses(key_expr: object, robot: str, tail: str) -> bool:
    """Whether a message was put on a robot's `tail`, or on that of all robots: no wildcard that happens to match."""
    return str(key_expr) in (key(robot, tail), key("*", tail))


def router(table: ZenohTable) -> zenoh.Config:
    """Configuration of the daemon's session: a router, since peers do not relay between clients. Raises `FileError`."""
    values: dict[str, Any] = {"mode": "router", "listen/endpoints": table.listen, "connect/endpoints": table.connect}
    values |= {"listen/timeout_ms": LISTEN_TIMEOUT_MS, "listen/exit_on_failure": True, "listen/retry": QUICK_RETRY}
    values |= {"transport/unicast/accept_timeout": ACCEPT_TIMEOUT_MS}
    if table.connect:
        values |= {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    return _configured(table.config, values)


def client(endpoints: list[str], file: str | None = None) -> zenoh.Config:
    """Configuration of a client; access control is the router's. Raises `FileError`."""
    values = {"mode": "client", "listen/endpoints": [], "connect/endpoints": endpoints}
    return _configured(file, {**values, "access_control/enabled": False})


def own_client(table: ZenohTable) -> zenoh.Config:
    """Configuration of the daemon's other processes: clients of its router, which may come up later, or again."""
    config = client(own_endpoints(table), table.config)
    for place, value in {"connect/timeout_ms": OWN_TIMEOUT_MS, "connect/retry": QUICK_RETRY}.items():
        config.insert_json5(place, json.dumps(value))
    return config


def own_endpoints(table: ZenohTable) -> list[str]:
    """Endpoints at which the daemon's other processes reach its router."""
    return [e.replace("//", "/").replace("0.0.0.0", "127.0.0.1").replace("[::]", "[::1]") for e in table.listen]


def serve(
    session: zenoh.Session, own_key: str, kind: type[M] | None,
    answer: Callable[[zenoh.Query, Any], Sequence[bytes] | None],
    fail: Callable[[zenoh.Query, Exception], None], inbox: Inbox, wildcards: bool = False,
) -> None:  # fmt: skip
    """Declares a queryable on the key `own_key`: `answer(query, request)` returns the replies, None if they come later.

    `kind`: of the request; None: what it says is ignored, and `answer` gets an empty message.

    What it raises goes to `fail(query, error)`: an exception that left zenoh's callback would look to the client as if
    there were no daemon. Too long a query is refused in zenoh's own thread, without a copy, and so is one without a
    place in `inbox`. `wildcards`: whether queries to several keys at once are answered.
    """

    def work(query: zenoh.Query) -> Send:
        """Answers one query."""
        try:
            content = query.payload.to_bytes() if query.payload and kind else b""
            replies = answer(query, unpack(kind or Message, content))
        except Exception as error:
            return partial(fail, query, error)
        return partial(_reply, query, own_key, replies)

    def received(query: zenoh.Query) -> None:
        """Takes one query; nothing leaves zenoh's callback."""
        try:
            if not wildcards and str(query.key_expr) != own_key:
                raise wildcard_error(own_key)
            size = len(query.payload) if query.payload else 0
            check_size(kind or Message, size)
            inbox.put(size, partial(work, query))
        except Exception as error:
            fail(query, error)

    session.declare_queryable(own_key, Callback(received, indirect=False))


def subscribe(
    session: zenoh.Session, own_key: str, kind: type[M], take: Callable[[zenoh.Sample, M], None],
    fail: Callable[[Exception], None], inbox: Inbox,
) -> None:  # fmt: skip
    """Declares a subscriber on the key `own_key`: as `serve`, for commands, which have no reply."""

    def work(sample: zenoh.Sample) -> Send:
        """Takes one command."""
        try:
            take(sample, unpack(kind, sample.payload.to_bytes()))
        except Exception as error:
            return partial(fail, error)
        return lambda: None

    def received(sample: zenoh.Sample) -> None:
        """Takes one command; nothing leaves zenoh's callback."""
        try:
            size = len(sample.payload)
            check_size(kind, size)
            inbox.put(size, partial(work, sample))
        except Exception as error:
            fail(error)

    session.declare_subscriber(own_key, Callback(received, indirect=False))


def _reply(query: zenoh.Query, own_key: str, replies: Sequence[bytes] | None) -> None:
    if replies is not None:
        with query:
            for reply in replies:
                query.reply(own_key, reply)


def wildcard_error(own_key: str) -> RequestError:
    """The error of a query to several keys at once, `own_key` among them."""
    return RequestError("wildcard", f"ask {own_key} itself; requests to several at once are not carried out")


def reply_error(query: zenoh.Query, error: Exception, log: Any, boot_id: str) -> None:
    """Closes a query with an `ErrorReply` of this start of the daemon; logs software faults."""
    if not isinstance(error, LrmError):
        log.exception("internal_error", key=str(query.key_expr), exc_info=error)
    with query:
        query.reply_err(pack(error_reply(error, boot_id)))


def in_one_line(error: zenoh.ZError) -> str:
    """What zenoh says is wrong with a configuration, without its source files, at most `LONGEST_WORDS` characters."""
    text = " ".join(str(error).split(" at /")[0].split())
    said = re.search(r'msg: "([^"]*)', text)
    return shorten(said[1] if said else text, LONGEST_WORDS, placeholder=" ...")


def _from_file(path: str | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    if not Path(path).is_file():
        raise FileError(path, "zenoh config", "no such file")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise FileError(path, "zenoh config", "zenoh cannot read it", in_one_line(error)) from None


def _configured(path: str | None, values: dict[str, Any]) -> zenoh.Config:
    config = _from_file(path)
    for place, value in (values | NO_SCOUTING | NO_SHARED_MEMORY | SHORT_MESSAGES).items():
        config.insert_json5(place, json.dumps(value))
    return config


def neighbours(tail: str) -> list[str]:
    """Keys like `lrm/*/<tail>`, with a chunk put in anywhere, or a letter into any chunk but the robot's."""
    chunks = ["lrm", "*", *tail.split("/")]
    longer = [[*chunks[:i], FILLER, *chunks[i:]] for i in range(len(chunks) + 1)]
    other = [
        [*chunks[:i], chunk[:at] + FILLER + chunk[at:], *chunks[i + 1 :]]
        for i, chunk in enumerate(chunks) if chunk != "*"
        for at in range(len(chunk) + 1)
    ]  # fmt: skip
    return ["/".join(key) for key in (*longer, *other)]


def with_rate_limits(config: zenoh.Config) -> zenoh.Config:
    """The configuration of a router, with these limits beside those that it has."""
    rules: list[dict[str, Any]] = [
        {
            "id": f"lrm wildcards at {tail}", "flows": ["ingress"], "messages": messages,
            "rules": [{"key_expr": key, "freq": RATE_HZ} for key in neighbours(tail)],
        }
        for tail, messages in MESSAGES.items()
    ]  # fmt: skip
    config.insert_json5("downsampling", json.dumps([*json.loads(config.get_json("downsampling")), *rules]))
    return config
