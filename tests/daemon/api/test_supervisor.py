"""The limit of restarts, with a clock that the test advances and processes that are not started."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lrmd.api import supervisor
from lrmd.api.supervisor import MAX_STARTS, WITHIN, ChildProcess, RestartLimitExceeded


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
