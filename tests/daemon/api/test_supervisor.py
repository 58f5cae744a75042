"""Processes of the daemon are at work or started again: limits of restarts, and a heartbeat that zenoh routes."""

from __future__ import annotations

from types import SimpleNamespace
from unittest import mock

import pytest

from lrmd.api import router_process, supervisor
from lrmd.api.router_process import EstopReplies, RouterSetup
from lrmd.api.supervisor import MAX_STARTS, WITHIN, ChildProcess, RestartLimitExceeded
from lrmd.ramp.parent import SharedFd


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> ChildProcess:
    unstarted = SimpleNamespace(start=lambda: None)
    monkeypatch.setattr(supervisor, "get_context", lambda _: SimpleNamespace(Process=lambda **_: unstarted))
    child = ChildProcess("ik", print)
    child.start(0)
    return child


def restarts(child: ChildProcess, every: int, began: bool, after: int = 0) -> int:
    """Number of restarts until the limit, at most a hundred."""
    for number in range(1, 101):
        try:
            child.restart(after + number * every, began)
        except RestartLimitExceeded:
            return number
    return 100


@pytest.mark.parametrize("every", [WITHIN // 100, WITHIN])
def test_starts_that_fail_in_a_row_end_it_however_slow_they_are(child: ChildProcess, every: int) -> None:
    """And as many are tried again after it was given up."""
    assert restarts(child, every, began=False) == MAX_STARTS
    assert restarts(child, every, began=False, after=100 * WITHIN) == MAX_STARTS


def test_a_process_that_works_in_between_is_started_again_without_end(child: ChildProcess) -> None:
    for number in range(10 * MAX_STARTS):
        child.restart(number * WITHIN // 4, began=number % MAX_STARTS == 0)
    assert child.starts == 10 * MAX_STARTS + 1


def test_one_that_works_and_dies_at_once_ends_it_too(child: ChildProcess) -> None:
    assert restarts(child, 1, began=True) == MAX_STARTS
    assert restarts(child, WITHIN // 5, began=True, after=WITHIN) == 100


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
