"""zenoh sessions and queryables: no network access unless the configuration allows it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from lrm_math.errors import FileError, LrmError
from lrmd.config import ZenohTable
from lrmd.errors import RequestError
from lrmd.messages.codec import error_reply, pack

NO_SCOUTING = {"scouting/multicast/enabled": False, "scouting/gossip/enabled": False, "scouting/delay": 0}
NO_SHARED_MEMORY = {"transport/shared_memory/enabled": False}
"""Each client that used it would leave 17 MB in /dev/shm; messages of 500 bytes do not gain by it."""
LARGEST_MESSAGE = 4_400_000
"""Bytes; zenoh takes no longer one from anybody. The longest valid ones are shorter: a way of a thousand waypoints."""
SHORT_MESSAGES = {"transport/link/rx/max_message_size": LARGEST_MESSAGE}
OWN_TIMEOUT_MS = 5000
"""For the daemon's own processes to reach its router."""


def key(robot: str, tail: str) -> str:
    """Key expression of a robot's `tail`, such as `state/mode`."""
    return f"lrm/{robot}/{tail}"


def addresses(key_expr: object, robot: str, tail: str) -> bool:
    """Whether a message was put on a robot's `tail`, or on that of all robots: no wildcard that happens to match."""
    return str(key_expr) in (key(robot, tail), key("*", tail))


def router(table: ZenohTable) -> zenoh.Config:
    """Configuration of the daemon's session: a router, since peers do not relay between clients. Raises `FileError`."""
    values: dict[str, Any] = {"mode": "router", "listen/endpoints": table.listen, "connect/endpoints": table.connect}
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
    retry = {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 2}
    for place, value in {"connect/timeout_ms": OWN_TIMEOUT_MS, "connect/retry": retry}.items():
        config.insert_json5(place, json.dumps(value))
    return config


def own_endpoints(table: ZenohTable) -> list[str]:
    """Endpoints at which the daemon's other processes reach its router."""
    return [e.replace("//", "/").replace("0.0.0.0", "127.0.0.1").replace("[::]", "[::1]") for e in table.listen]


def serve(
    session: zenoh.Session, own: str, handler: Callable[[zenoh.Query, bytes], None],
    fail: Callable[[zenoh.Query, Exception], None], wildcards: bool = False,
) -> None:  # fmt: skip
    """Declares a queryable on the key `own`. What `handler(query, payload)` raises goes to `fail(query, error)`.

    An exception that left zenoh's callback would look to the client as if there were no daemon. `wildcards`: whether
    queries to several keys at once are answered.
    """

    def received(query: zenoh.Query) -> None:
        """Handles one query; nothing leaves zenoh's callback."""
        try:
            if not wildcards and str(query.key_expr) != own:
                raise wildcard_error(own)
            handler(query, query.payload.to_bytes() if query.payload else b"")
        except Exception as error:
            fail(query, error)

    session.declare_queryable(own, received)


def wildcard_error(own: str) -> RequestError:
    """The error of a query to several keys at once, `own` among them."""
    return RequestError("wildcard", f"ask {own} itself; requests to several at once are not carried out")


def reply_error(query: zenoh.Query, error: Exception, log: Any) -> None:
    """Closes a query with an `ErrorReply`; logs software faults."""
    if not isinstance(error, LrmError):
        log.exception("internal_error", key=str(query.key_expr), exc_info=error)
    with query:
        query.reply_err(pack(error_reply(error)))


def _from_file(path: str | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    if not Path(path).is_file():
        raise FileError(path, "zenoh config", "no such file")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise FileError(path, "zenoh config", f"zenoh cannot read it ({error})") from None


def _configured(path: str | None, values: dict[str, Any]) -> zenoh.Config:
    config = _from_file(path)
    for place, value in (values | NO_SCOUTING | NO_SHARED_MEMORY | SHORT_MESSAGES).items():
        config.insert_json5(place, json.dumps(value))
    return config
