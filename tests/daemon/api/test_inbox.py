"""Messages that wait: bounded in number and bytes, worked on in their order, their place free before the reply."""

from __future__ import annotations

import threading

import pytest

from lrmd.errors import RequestError
from lrmd.messages.inbox import Inbox, Send


def test_what_waits_is_bounded_in_number_and_bytes() -> None:
    go_on, done = threading.Event(), []

    def work(name: str) -> Send:
        go_on.wait(30)
        return lambda: done.append(name)

    few, short = Inbox(2, 100), Inbox(9, 10)
    few.put(1, lambda: work("a"))
    few.put(1, lambda: work("b"))
    short.put(6, lambda: work("c"))
    for inbox, size in ((few, 1), (short, 5)):
        with pytest.raises(RequestError, match="ask again") as refused:
            inbox.put(size, lambda: work("refused"))
        assert (refused.value.code, refused.value.retryable) == ("busy", True)
    ended = threading.Event()
    few.after(lambda: ended.set)
    short.put(4, lambda: work("d"))
    go_on.set()
    assert ended.wait(30)
    assert [name for name in done if name in "ab"] == ["a", "b"], "in their order, and the daemon's own after them"


def test_a_place_is_free_before_the_reply_is_sent() -> None:
    """So a client that asks again as soon as it has the reply is not told that somebody else is served."""
    inbox, again = Inbox(1), threading.Event()
    inbox.put(1, lambda: lambda: inbox.put(1, lambda: again.set))
    assert again.wait(30)
