"""zenoh sessions: closed to the network unless the configuration opens them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import zenoh

from lrm_math.errors import FileError
from lrmd.config import ZenohTable


def key(robot: str, tail: str) -> str:
    """The key of something of one robot."""
    return f"lrm/{robot}/{tail}"


def router(table: ZenohTable) -> zenoh.Config:
    """The daemon's own session: a router, since peers do not relay between their clients. Raises `FileError`."""
    config = _from_file(table.config)
    _insert(config, "mode", "router")
    _insert(config, "listen/endpoints", table.listen)
    _insert(config, "connect/endpoints", table.connect)
    if table.connect:
        _insert(config, "connect/timeout_ms", -1)
        _insert(config, "connect/exit_on_failure", False)
    return _quiet(config)


def client(endpoints: list[str], file: str | None = None) -> zenoh.Config:
    """A client of a daemon or of a router, which controls access: a client knows no user names. Raises `FileError`."""
    config = _from_file(file)
    _insert(config, "mode", "client")
    _insert(config, "listen/endpoints", [])
    _insert(config, "connect/endpoints", endpoints)
    _insert(config, "access_control/enabled", False)
    return _quiet(config)


def own_endpoints(table: ZenohTable) -> list[str]:
    """Where the daemon's other processes reach its router."""
    return [e.replace("//", "/").replace("0.0.0.0", "127.0.0.1").replace("[::]", "[::1]") for e in table.listen]


def _from_file(path: str | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    if not Path(path).is_file():
        raise FileError(path, "zenoh config", "no such file")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise FileError(path, "zenoh config", f"zenoh cannot read it ({error})") from None


def _quiet(config: zenoh.Config) -> zenoh.Config:
    _insert(config, "scouting/multicast/enabled", False)
    _insert(config, "scouting/gossip/enabled", False)
    _insert(config, "scouting/delay", 0)
    return config


def _insert(config: zenoh.Config, place: str, value: Any) -> None:
    config.insert_json5(place, json.dumps(value))
