"""The router process is at work only as long as zenoh routes: its heartbeat passes through zenoh."""

from __future__ import annotations

from types import SimpleNamespace
from unittest import mock

import pytest

from lrmd.api import router_process
from lrmd.api.router_process import EstopReplies, RouterSetup
from lrmd.ramp.parent import SharedFd


class Panicked(BaseException):
    """Stand-in for zenoh's PanicException, which is no Exception."""


def test_a_router_whose_zenoh_panicked_ends_and_is_no_longer_alive() -> None:
    shared = SimpleNamespace(router=[0, 0])
    beats: list[int] = []

    def put(key: str, _: bytes) -> None:
        assert key == router_process.HEARTBEAT_KEY
        beats.append(shared.router[0])
        if len(beats) == 3:
            raise Panicked

    session = mock.MagicMock()
    session.__enter__.return_value = session
    session.__exit__.return_value = False
    session.put.side_effect = put
    setup = RouterSetup("{}", ("estop",), "rpc/estop", "gone", EstopReplies({}, {}, {}), SharedFd(0), SharedFd(0))
    with (
        mock.patch.object(router_process, "die_with_parent"),
        mock.patch.object(router_process.signal, "signal"),
        mock.patch.object(router_process, "SharedRecords", return_value=shared),
        mock.patch.object(router_process, "HEARTBEAT_S", 0.0),
        mock.patch.object(router_process.zenoh, "open", return_value=session),
        pytest.raises(Panicked),
    ):
        router_process.run(setup)
    assert len(beats) == 3
    assert beats[0] == 0
    assert 0 < beats[1] < beats[2] == shared.router[0]
    session.__exit__.assert_called_once()
