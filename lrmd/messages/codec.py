"""The form of every message of the daemon: msgpack maps, validated by pydantic; packing, unpacking, errors.

Validation is strict: an unknown field or a wrong value is an error that names the field.
"""

from __future__ import annotations

import secrets
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal, TypeVar

import msgpack
from pydantic import BaseModel, BeforeValidator, ConfigDict, JsonValue, ValidationError

from lrm_math.errors import LrmError, UnknownName
from lrmd.errors import RequestError
from lrmd.messages.bounds import bounds_of, excess
from lrmd.messages.shown_text import shown_texts

LONGEST_TEXT = 1000
"""Characters of the text of an error."""


class MessageError(RequestError):
    """Bytes that are not a valid message."""

    def __init__(self, text: str) -> None:
        super().__init__("bad_message", text)


class Part(BaseModel):
    """A map within a message; unknown fields, wrong types and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, defer_build=True)


def _no_bool(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"input should be 1, not {str(value).lower()}")
    return value


class Message(Part):
    """A message of version 1."""

    v: Annotated[Literal[1], BeforeValidator(_no_bool)] = 1


class Header(Message):
    """Common fields of the daemon's messages. `seq` counts the messages of one key."""

    boot_id: str
    seq: int
    t_mono_ns: int
    t_wall_ns: int


class ErrorReply(Message):
    """Reply (`reply_err`) to a request that failed. `retryable`: the same request may succeed later."""

    code: str
    msg: str
    retryable: bool = False
    detail: dict[str, JsonValue] = {}
    boot_id: str = ""


def new_boot_id() -> str:
    """A random identifier of one start of the daemon, which all of its processes have in common."""
    return secrets.token_hex(8)


class HeaderSource:
    """Values of the `Header` fields of one process: the daemon's `boot_id`, a sequence number per key, both clocks."""

    def __init__(self, boot_id: str) -> None:
        self.boot_id = boot_id
        self._seq: Counter[str] = Counter()

    def next(self, key: str) -> dict[str, Any]:
        """The fields of the next message of a key."""
        self._seq[key] += 1
        mono, wall = time.monotonic_ns(), time.time_ns()
        return {"boot_id": self.boot_id, "seq": self._seq[key], "t_mono_ns": mono, "t_wall_ns": wall}


M = TypeVar("M", bound=Message)


def pack(message: Message) -> bytes:
    """A message as msgpack."""
    return bytes(msgpack.packb(message.model_dump(by_alias=True)))


def unpack(kind: type[M], data: bytes) -> M:
    """A message from msgpack. Raises `MessageError` that says which field is wrong, and how.

    What is larger than any valid message of the kind is refused before it is read, or before it is validated.
    """
    content = _content_of(kind, data)
    with field_named():
        return kind.model_validate(content)


def unpack_shown(kind: type[M], data: bytes) -> M:
    """The same of a message that came from elsewhere, with its texts as they may be shown on a terminal."""
    content = shown_texts(_content_of(kind, data))
    with field_named():
        return kind.model_validate(content)


def _content_of(kind: type[Message], data: bytes) -> dict[str, Any]:
    check_size(kind, len(data))
    if (much := excess(data, bounds_of(kind))) is not None:
        raise MessageError(much)
    try:
        content = msgpack.unpackb(data, strict_map_key=True, use_list=True, object_pairs_hook=_fields) if data else {}
    except (ValueError, msgpack.UnpackException) as error:
        raise MessageError(f"not msgpack ({error or type(error).__name__})") from None
    if not isinstance(content, dict):
        raise MessageError(f"a {type(content).__name__}; should be a map with the fields of {kind.__name__}")
    return content


def check_size(kind: type[Message], size: int) -> None:
    """Raises `MessageError` if no message of a kind has so many bytes."""
    most = bounds_of(kind).size
    if size > most:
        raise MessageError(f"{size} bytes; a {kind.__name__} has at most {most}")


def _fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A map of which every key is there once. Raises `MessageError`."""
    fields = dict(pairs)
    if len(fields) < len(pairs):
        twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise MessageError(f"{_shown(twice)}: given twice in one map; should be there once")
    return fields


def shortened(text: str) -> str:
    """A text for a reply, cut where it would be longer than clients read."""
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "..."


def error_reply(error: Exception, boot_id: str) -> ErrorReply:
    """The reply to a request that raised: with the code of a `RequestError`, else `error` or `internal`."""
    text = shortened(str(error))
    match error:
        case RequestError(code=code, retryable=again, detail=detail):
            return ErrorReply(code=code, msg=text, retryable=again, detail=detail, boot_id=boot_id)
        case UnknownName():
            valid: list[JsonValue] = list(error.valid)
            return ErrorReply(code="unknown_servo", msg=text, detail={"valid": valid}, boot_id=boot_id)
        case LrmError():
            return ErrorReply(code="error", msg=text, boot_id=boot_id)
        case _:
            return ErrorReply(code="internal", msg=shortened(f"{type(error).__name__}: {error}"), boot_id=boot_id)


@contextmanager
def field_named() -> Iterator[None]:
    """Context in which a message is validated: raises `MessageError`, one line that names the first wrong field."""
    try:
        yield
    except ValidationError as error:
        first, *others = error.errors(include_url=False)
        where = ".".join(_shown(part) for part in first["loc"]) or "fields"
        what = first["msg"].removeprefix("Value error, ")
        more = f" (and {len(others)} more)" if others else ""
        raise MessageError(f"{where}: {what[:1].lower()}{what[1:]}{more}") from None


def _shown(part: object) -> str:
    """A field name of the client's, short and without control characters."""
    text = str(part)
    text = text if text.isprintable() else ascii(text)
    return text if len(text) <= 64 else text[:61] + "..."
