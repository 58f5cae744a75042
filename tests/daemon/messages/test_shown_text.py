"""Text of a peer reaches a terminal without its escapes and marks of direction."""

from __future__ import annotations

import msgpack
from hypothesis import given
from hypothesis import strategies as st

from lrmd.messages.codec import HeaderSource, unpack_shown
from lrmd.messages.control import Event
from lrmd.messages.shown_text import shown

HOSTILE = "held\x1b]0;own\x07\x1b[2J\u202eevil\u2066\r\nlrm: armed"


@given(st.text())
def test_what_is_shown_is_one_printable_line(text: str) -> None:
    assert shown(text).isprintable()
    assert shown(text) == text or not text.isprintable()


def test_no_text_of_a_message_has_an_escape_in_it() -> None:
    content = {"v": 1, "code": HOSTILE, "level": "info", "text": HOSTILE, "detail": {HOSTILE: [HOSTILE]}}
    event = unpack_shown(Event, msgpack.packb({**HeaderSource("b").next("event"), **content}))
    assert event.text == shown(HOSTILE) == "held\\x1b]0;own\\x07\\x1b[2J\\u202eevil\\u2066\\r\\nlrm: armed"
    assert event.detail == {shown(HOSTILE): [shown(HOSTILE)]}
    assert event.code.isprintable()
