"""A walk over msgpack bytes that builds no objects: counts what is there, and stops where it is too much.

Format: msgpack specification (Furuhashi 2013). An array or map counts as large as it says it is.
"""

from __future__ import annotations

from typing import NamedTuple

from lrmd.messages.bounds import MessageBounds


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


def excess(data: bytes, bounds: MessageBounds) -> str | None:
    """Excess of a message beyond its bounds, as text; None if nothing is, as far as the bytes go."""
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


NAMES = {"text": "a text of {} bytes", "array": "an array of {} elements", "map": "a map of {} entries"}
