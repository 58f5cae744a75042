"""A short run of `tests.soak.fuzz_messages`, and a check that it detects errors."""

from __future__ import annotations

import pytest

from lrmd.messages.codec import pack
from lrmd.messages.control import HoldRequest, LeaseRequest
from tests.soak import fuzz_messages
from tests.soak.fuzz_messages import check, fuzz
from tests.soak.fuzz_result import FuzzResult


@pytest.mark.slow
def test_twenty_thousand_strings_are_messages_or_message_errors() -> None:
    result = fuzz(20_000, seed=1)
    assert result.violations == []
    assert result.counts["accepted"] > 2_000


def test_a_crash_and_a_lie_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    data, result = pack(LeaseRequest(action="acquire", holder="me")), FuzzResult()
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: 1 / 0)
    check(LeaseRequest, data, result)
    monkeypatch.setattr(fuzz_messages, "unpack", lambda *_: HoldRequest())
    check(LeaseRequest, data, result)
    assert len(result.violations) == 2
