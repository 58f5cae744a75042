"""Bounds of a message, from its JSON Schema: how long, and of how many parts, a valid one of its kind may be.

They are checked before the parts become objects, by a walk over the bytes that stops where it is too much: what is far
larger than any valid message costs nothing to refuse. Format: msgpack specification (Furuhashi 2013).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

from pydantic import BaseModel

LONGEST = 2_097_152
"""Bytes of a message of the daemon, whose lists and texts have no limit of their own."""
NUMBER, HEAD = 9, 5
"""Bytes of a number, and of the head of a text, an array or a map, at most."""
CHARACTER = 4
"""Bytes of one in UTF-8, at most."""
PART = 8
"""Bytes of a key or value of a message of `LONGEST`, on average at least."""
TEXT, ITEMS = 4096, 256
"""Bytes of a text, and items of an array or a map, that have no limit of their own."""

LIMITS = {"string": ("maxLength", "enum", "const"), "array": ("maxItems",), "object": ("maxProperties", "properties")}
"""Types of a schema that have a size; one of them is needed."""


@dataclass(frozen=True)
class MessageBounds:
    """Largest `size` of a message in bytes, number of keys and values in all its maps and arrays (`parts`), of
    `entries` of one map, of `elements` of one array, and of bytes of one `text`."""

    size: int
    parts: int = 0
    entries: int = 0
    elements: int = 0
    text: int = 0

    def widened(self) -> MessageBounds:
        """The bounds with room for mistakes: a message with a field too many, or too long, is told which it is."""
        return MessageBounds(self.size + 1024, self.parts + 64, self.entries + 16, self.elements + 16, self.text + 256)


ANYTHING = MessageBounds(16 * TEXT, 4 * ITEMS, ITEMS, ITEMS, TEXT)
"""Bounds of a JSON value, as in the `detail` of an event."""
ANY_MESSAGE = MessageBounds(LONGEST, LONGEST // PART, ITEMS, LONGEST // PART, LONGEST)
"""Bounds of a message whose kind is not known yet."""


@cache
def bounds_of(kind: type[BaseModel]) -> MessageBounds:
    """The bounds of a kind of message, at most `LONGEST` where its fields do not limit it."""
    schema = kind.model_json_schema()
    bounds = _of(schema, schema.get("$defs", {}))
    limited = all(_limited(part) for part in (schema, *schema.get("$defs", {}).values()))
    if limited:
        return bounds.widened()
    size = min(bounds.size, LONGEST)
    return replace(bounds, size=size, parts=min(bounds.parts, size // PART)).widened()


def _limited(schema: Any) -> bool:
    """Whether every text, array and map in a schema has a limit."""
    if isinstance(schema, list):
        return all(map(_limited, schema))
    if not isinstance(schema, dict):
        return True
    limits = LIMITS.get(str(schema.get("type")))
    return (limits is None or any(limit in schema for limit in limits)) and all(map(_limited, schema.values()))


def _of(schema: Mapping[str, Any], defs: Mapping[str, Any]) -> MessageBounds:
    match schema:
        case {"$ref": "#/$defs/JsonValue"}:
            return ANYTHING
        case {"$ref": where}:
            return _of(defs[where.rpartition("/")[2]], defs)
        case {"anyOf": choices}:
            return _either(_of(choice, defs) for choice in choices)
        case {"const": str(value)}:
            return _key(value)
        case {"enum": values}:
            return _either(map(_key, values))
        case {"type": "string"}:
            return _text(CHARACTER * schema["maxLength"] if "maxLength" in schema else TEXT)
        case {"type": "array"}:
            count, item = schema.get("maxItems", ITEMS), _of(schema["items"], defs)
            whole = MessageBounds(HEAD + count * item.size, count * (1 + item.parts), elements=count)
            return _deepened(whole, [item])
        case {"type": "object", "properties": fields}:
            inside = [*map(_key, fields), *(_of(field, defs) for field in fields.values())]
            parts = sum(1 + part.parts for part in inside)
            return _deepened(
                MessageBounds(HEAD + sum(part.size for part in inside), parts, entries=len(fields)), inside
            )
        case {"type": "object"}:
            name = _of({"type": "string", **schema.get("propertyNames", {})}, defs)
            count, item = schema.get("maxProperties", ITEMS), _of(schema.get("additionalProperties", {}), defs)
            whole = MessageBounds(HEAD + count * (name.size + item.size), count * (2 + item.parts), entries=count)
            return _deepened(whole, [name, item])
        case {}:
            return MessageBounds(NUMBER) if "type" in schema or "const" in schema else ANYTHING
    raise AssertionError(f"no bounds of {schema}")


def _key(name: object) -> MessageBounds:
    return _text(len(str(name).encode()))


def _text(count: int) -> MessageBounds:
    return MessageBounds(HEAD + count, text=count)


def _either(choices: Iterable[MessageBounds]) -> MessageBounds:
    bounds = list(choices)
    return _deepened(
        MessageBounds(max(choice.size for choice in bounds), max(choice.parts for choice in bounds)), bounds
    )


def _deepened(whole: MessageBounds, parts: list[MessageBounds]) -> MessageBounds:
    """The size and parts of the whole, with the largest map, array and text of it and its parts."""
    bounds = [whole, *parts]
    return MessageBounds(
        whole.size, whole.parts, max(part.entries for part in bounds), max(part.elements for part in bounds),
        max(part.text for part in bounds),
    )  # fmt: skip


class Head(NamedTuple):
    """Meaning of a first byte: so many bytes or items `follow`, and as many more as `width` bytes say."""

    kind: str
    follow: int = 0
    width: int = 0


def _heads() -> list[Head]:
    """Meanings of the 256 first bytes."""
    heads = [Head("number")] * 256
    heads[0x80:0x90] = [Head("map", n) for n in range(16)]
    heads[0x90:0xA0] = [Head("array", n) for n in range(16)]
    heads[0xA0:0xC0] = [Head("text", n) for n in range(32)]
    heads[0xC4:0xC7] = heads[0xD9:0xDC] = [Head("text", 0, width) for width in (1, 2, 4)]
    heads[0xC7:0xCA] = [Head("text", 1, width) for width in (1, 2, 4)]
    heads[0xCA:0xCC] = [Head("number", 4), Head("number", 8)]
    heads[0xCC:0xD0] = heads[0xD0:0xD4] = [Head("number", size) for size in (1, 2, 4, 8)]
    heads[0xD4:0xD9] = [Head("text", 1 + size) for size in (1, 2, 4, 8, 16)]
    heads[0xDC:0xDE] = [Head("array", 0, width) for width in (2, 4)]
    heads[0xDE:0xE0] = [Head("map", 0, width) for width in (2, 4)]
    return heads


HEADS = _heads()
NAMES = {"text": "a text of {} bytes", "array": "an array of {} elements", "map": "a map of {} entries"}


def excess(data: bytes, bounds: MessageBounds) -> str | None:
    """Excess of a message beyond its bounds, as text; None if nothing is, as far as the bytes go.

    An array or map counts as large as it says it is.
    """
    at, parts, left, size = 0, 0, 1, len(data)
    most = {"text": bounds.text, "array": bounds.elements, "map": bounds.entries, "number": 8}
    while left and at < size:
        kind, count, width = HEADS[data[at]]
        if width:
            count += int.from_bytes(data[at + 1 : at + 1 + width], "big")
        at, left = at + 1 + width, left - 1
        if count > most[kind]:
            return f"{NAMES[kind].format(count)}; no valid message has more than {most[kind]}"
        if kind in ("array", "map"):
            items = count if kind == "array" else 2 * count
            left, parts = left + items, parts + items
            if parts > bounds.parts:
                return f"more than {bounds.parts} keys and values; no valid message has so many"
        else:
            at += count
    return None
