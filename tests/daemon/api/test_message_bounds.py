"""Bounds of messages: a larger one than any valid one of its kind is refused before it takes memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import msgpack
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from lrmd.api.router_process import LONGEST_COMMAND, UNREADABLE, reason_of
from lrmd.messages.bounds import LONGEST, MessageBounds, bounds_of, excess
from lrmd.messages.codec import ErrorReply, Header, Message, MessageError, error_reply, pack, unpack
from lrmd.messages.control import DeployRequest, EstopCommand, HoldRequest, MoveRequest
from lrmd.messages.kinematics import IkReply, IkRequest
from lrmd.messages.surroundings import MOST_HEIGHTS, MOST_OBSTACLES
from lrmd.messages.zenoh_session import LARGEST_MESSAGE
from tests.support.message_schemas import every_message
from tests.support.sweep import soak

KINDS = {name: kind for name, kind in every_message().items() if issubclass(kind, Message)}
REQUESTS = {name: kind for name, kind in KINDS.items() if not issubclass(kind, Header | ErrorReply | IkReply)}
WIDE = "\N{OLD ITALIC LETTER A}"
"""A printable character of four bytes."""


def largest(schema: Mapping[str, Any], defs: Mapping[str, Any], number: int = 0) -> Any:
    """The longest content that a schema with limits everywhere allows."""
    match schema:
        case {"$ref": where}:
            return largest(defs[where.rpartition("/")[2]], defs)
        case {"anyOf": choices}:
            return max((largest(choice, defs) for choice in choices), key=lambda one: len(msgpack.packb(one)))
        case {"const": value}:
            return value
        case {"enum": values}:
            return max(values, key=len)
        case {"type": "number"}:
            return schema.get("maximum", 0.5) / 3
        case {"type": "integer"}:
            return schema.get("maximum", 1)
        case {"type": "boolean"}:
            return True
        case {"type": "null"}:
            return None
        case {"type": "string"}:
            return str(number).rjust(schema["maxLength"], WIDE)
        case {"type": "array"}:
            return [largest(schema["items"], defs)] * schema["maxItems"]
        case {"type": "object", "properties": fields}:
            return {key: largest(field, defs) for key, field in fields.items()}
        case {"type": "object"}:
            value = largest(schema["additionalProperties"], defs)
            names = {"type": "string", **schema["propertyNames"]}
            return {largest(names, defs, number): value for number in range(schema["maxProperties"])}
    raise AssertionError(schema)


ONE_OF: dict[str, list[dict[str, Any]]] = {
    "ArmRequest": [{"where": "given", "servos": None}, {"where": "stored", "q_rad": {}}],
    "IkRequest": [{}],
    "FkRequest": [{"near_rad": None}, {"direction": []}],
    "SkillRequest": [
        {
            "skill": "approach",
            "q_rad": None,
            "near_rad": None,
            "payload_kg": None,
            "payload_centre_m": None,
            "listen_s": 0.0,
        }
    ],
    "PlanRequest": [
        {"goal": None, "line": False, "stabilise": False},
        {"to_rad": None, "stabilise": False},
        {"to_rad": None, "goal": None, "line": False},
    ],
}
"""Fields that exclude each other."""


@pytest.mark.parametrize("name", REQUESTS)
def test_the_largest_valid_request_of_each_kind_is_read(name: str) -> None:
    kind = REQUESTS[name]
    schema = kind.model_json_schema()
    for change in ONE_OF.get(name, [{}]):
        content = {**largest(schema, schema.get("$defs", {})), **change}
        for goal in [*content.get("goals", ()), *([content["goal"]] if content.get("goal") else [])]:
            goal.update(rpy_rad=None, approach=None)
        for contact in content.get("may_touch", ()):
            contact.update(low_m=[-1.0 / 3] * 3)
        for obstacle in content.get("put", ()):
            obstacle.update(
                shape="heightfield", size_m=None, end_m=None, radius_m=None, columns=len(obstacle["heights_m"])
            )
        assert unpack(kind, msgpack.packb(content)) == kind.model_validate(content)


def test_only_long_texts_and_paths_may_be_long() -> None:
    sizes = {name: bounds_of(kind).size for name, kind in REQUESTS.items()}
    long = {name for name, size in sizes.items() if size > 12_000}
    assert long == {"DeployRequest", "MoveRequest", "IkRequest", "FkRequest", "SceneCommand"}
    assert sizes["SceneCommand"] < 40_000 + MOST_OBSTACLES * MOST_HEIGHTS * 9
    assert max(bounds_of(kind).size for kind in KINDS.values()) < LARGEST_MESSAGE


def hostile(kind: type[Message]) -> dict[str, bytes]:
    """Contents as long as the kind may be, of as many objects as that can hold."""
    size = bounds_of(kind).size
    elements = bounds_of(kind).elements
    row = b"\xdc" + elements.to_bytes(2, "big")
    return {
        "unknown fields": bytes(msgpack.packb({f"{i:x}": 1 for i in range(size // 10)})),
        "empty maps": row + b"\x80" * min(elements, size - 3),
        "rows of empty maps": row + (row + b"\x80" * elements) * (size // (elements + 3) - 1),
        "rows of texts": row + (row + b"\xa2ab" * elements) * (size // (3 * elements + 3) - 1),
        "deep rows of texts": (row + b"\xa2ab" * (elements - 1)) * (size // (3 * elements)),
        "open rows": row * ((size - 1) // 3),
        "open arrays": b"\xdd\xff\xff\xff\xff" * (size // 5),
        "open maps": b"\xdf\xff\xff\xff\xff" * (size // 5),
        "one level each": b"\x91" * (size - 1),
    }  # fmt: skip


LARGE_REPLIES = ("IkReply", "PlanReply", "Event", "ErrorReply", "InfoState")
"""Bounded as `FkReply` is, which takes most of them."""


@pytest.mark.long
@pytest.mark.parametrize("name", [*(name for name in KINDS if name not in LARGE_REPLIES), *soak(*LARGE_REPLIES)])
def test_no_bytes_of_a_kind_take_much_memory(name: str) -> None:
    """Measured by Python itself: a message of the daemon may hold a quarter of a million parts, a request far fewer."""
    kind = KINDS[name]
    most = 8e6 if name in REQUESTS else 40e6
    for what, data in hostile(kind).items():
        tracemalloc.start()
        try:
            with suppress(MessageError):
                unpack(kind, data)
            used = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert used < most, f"{what}: {used / 1e6:.0f} MB"


@pytest.mark.parametrize(
    ("kind", "data", "said"),
    [
        (HoldRequest, msgpack.packb({"v": True}), "v: input should be 1, not true"),
        (HoldRequest, msgpack.packb({"v": False}), "v: input should be 1, not false"),
        (HoldRequest, b"\x82\xa1v\x01\xa1v\x01", "v: given twice in one map; should be there once"),
        (
            MoveRequest, b"\x82\xa5lease\xa1t\xa9waypoints\x91\x82\xa1j\xcb" + bytes(8) + b"\xa1j\xcb" + bytes(8),
            "j: given twice in one map; should be there once",
        ),
        (HoldRequest, msgpack.packb({f"{i}": 1 for i in range(60)}), "60 entries; no valid message has more than 17"),
        (HoldRequest, msgpack.packb({"x": [1] * 99}), "an array of 99 elements; no valid message has more than 16"),
        (HoldRequest, msgpack.packb({"x": "y" * 999}), "a text of 999 bytes; no valid message has more than 257"),
        (HoldRequest, msgpack.packb({f"{i:300}": 1 for i in range(7000)}), "bytes; a HoldRequest has at most 1044"),
        (HoldRequest, msgpack.packb({"x": [[[0] * 9] * 9] * 9}), "keys and values; no valid message has so many"),
    ],
)  # fmt: skip
def test_each_fault_is_one_clear_line(kind: type[Message], data: bytes, said: str) -> None:
    with pytest.raises(MessageError) as caught:
        unpack(kind, data)
    assert str(caught.value).endswith(said)
    assert str(caught.value).isprintable()


@given(st.lists(st.text(max_size=3), min_size=2, max_size=8, unique=True), st.data())
def test_a_key_given_twice_is_found_at_any_depth(keys: list[str], data: st.DataObject) -> None:
    again = data.draw(st.sampled_from(keys))
    pairs = b"".join(msgpack.packb(key) + b"\x01" for key in [*keys, again])
    inner = bytes([0x80 + len(keys) + 1]) + pairs
    for content in (inner, b"\x91" + inner, b"\x81\xa1x" + inner):
        with pytest.raises(MessageError, match="given twice"):
            unpack(ErrorReply, content)


def test_a_model_file_of_the_longest_text_is_read() -> None:
    assert len(unpack(DeployRequest, pack(DeployRequest(text="x" * 1_000_000))).text) == 1_000_000
    assert bounds_of(IkRequest).size < LONGEST


def test_the_text_of_an_error_is_not_longer_than_its_reader_takes() -> None:
    reply = error_reply(MessageError("x" * 1_000_000), "boot")
    assert len(reply.msg) == 1000
    assert unpack(ErrorReply, pack(reply)) == reply


CONTENT = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(max_size=300),
    lambda inner: st.lists(inner, max_size=40) | st.dictionaries(st.text(), inner, max_size=40),
)


def extent(content: Any) -> MessageBounds:
    """The bounds that a content just keeps."""
    inside: list[Any] = []
    if isinstance(content, dict):
        inside = [*content.keys(), *content.values()]
    elif isinstance(content, list):
        inside = content
    parts = [extent(part) for part in inside]
    size = len(content.encode() if isinstance(content, str) else content) if isinstance(content, str | bytes) else 0
    return MessageBounds(
        len(msgpack.packb(content)), sum(1 + part.parts for part in parts),
        max([len(content) if isinstance(content, dict) else 0, *(part.entries for part in parts)]),
        max([len(content) if isinstance(content, list) else 0, *(part.elements for part in parts)]),
        max([size, *(part.text for part in parts)]),
    )  # fmt: skip


@pytest.mark.long
@given(content=CONTENT)
def test_the_walk_over_the_bytes_finds_what_is_there(content: Any) -> None:
    """Bounds that a content just keeps are kept, and each of them by one less is not."""
    exact, data = extent(content), msgpack.packb(content)
    assert excess(data, exact) is None
    for field in ("parts", "entries", "elements", "text"):
        value = getattr(exact, field)
        if value:
            assert excess(data, replace(exact, **{field: value - 1})) is not None


@given(data=st.binary(max_size=300))
def test_the_walk_ends_on_any_bytes(data: bytes) -> None:
    assert excess(data, MessageBounds(0, 9, 9, 9, 9)) is None or data


def test_the_router_reads_no_more_of_an_emergency_stop_than_one_has() -> None:
    assert bounds_of(EstopCommand).size == LONGEST_COMMAND
    assert reason_of(zenoh.ZBytes(pack(EstopCommand(why=WIDE * 64)))) == WIDE * 64
    assert reason_of(zenoh.ZBytes(msgpack.packb({f"{i}": 1 for i in range(300_000)}))) == UNREADABLE
