"""A small part of `tests.soak.fuzz_messages` on every run of the tests, and proof that it would find something."""

from __future__ import annotations

import pytest

from lrmd.messages.control import HoldRequest, LeaseRequest, pack
from tests.soak import fuzz_messages
from tests.soak.fuzz_messages import Tally, check, fuzz


def test_twenty_thousand_strings_are_messages_or_message_errors() -> None:
    tally = fuzz(20_000, seed=1)
    assert tally.lies == []
    assert tally.accepted > 2_000


def test_a_crash_and_a_lie_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    data, tally = pack(LeaseRequest(action="acquire", holder="me")), Tally()
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: 1 / 0)
    check(LeaseRequest, data, tally)
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: HoldRequest())
    check(LeaseRequest, data, tally)
    assert len(tally.lies) == 2
