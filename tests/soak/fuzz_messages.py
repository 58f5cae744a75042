"""Random, damaged and odd bytes against the messages: `python -m tests.soak.fuzz_messages [STRINGS] [SEED]`.

Counts what may never be: an exception other than `MessageError`, an error that is not one printable line, and a lie,
that is an accepted message that is not the same after it was packed and read again, or that has lost or gained a field.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
import random
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgpack

import lrmd
from lrmd.messages.control import LONGEST, Header, Message, MessageError, pack, unpack
from tests.soak.fuzz_link import damaged

STRINGS = 1_000_000
ODD = (
    None, True, -1, 0, 1e-320, 2**63, -(2**63), 2**64 - 1, 1e308, math.nan, math.inf, "", "x" * 100, "\n\x1b[2J", "\0",
    "joint1", b"bytes", b"\xff\xfe", [], [[]], [None] * 20, {}, {"": {}}, {"v": 1}, {1: 2}, {b"v": 1},
    msgpack.ExtType(5, b"abc"), msgpack.Timestamp(1, 2),
)  # fmt: skip
"""What clients send by mistake."""
PLAIN = (None, True, -1, 0.5, "joint1", [1, [2.5]], {"a": {"b": None}})
"""What may stand where anything plain may."""


def kinds() -> list[type[Message]]:
    """Every message that is defined in lrmd."""
    for module in pkgutil.iter_modules(lrmd.__path__, "lrmd."):
        if "messages" in module.name:
            importlib.import_module(module.name)
    return sorted(set(_below(Message)) - {Header}, key=lambda kind: kind.__name__)


def _below(kind: type[Message]) -> Iterator[type[Message]]:
    for sub in kind.__subclasses__():
        yield sub
        yield from _below(sub)


class Author:
    """Writes contents that a schema describes, with something odd in a part of them."""

    def __init__(self, schema: Mapping[str, Any], rng: random.Random) -> None:
        self._schema, self._parts, self._rng = schema, schema.get("$defs", {}), rng

    def content(self) -> Any:
        """One content: as it should be, or with odd values, missing fields and unknown ones."""
        odd = self._rng.choice((0.0, 0.0, 0.02, 0.2))
        whole = self._value(self._schema, odd)
        if isinstance(whole, dict) and self._rng.random() < odd:
            return whole | {self._rng.choice(("x", "lease", "V", "")): self._rng.choice(ODD)}
        return whole

    def _value(self, schema: Mapping[str, Any], odd: float) -> Any:
        rng = self._rng
        if odd and rng.random() < odd:
            return rng.choice(ODD)
        match schema:
            case {"$ref": "#/$defs/JsonValue"}:
                return rng.choice(PLAIN)
            case {"$ref": where}:
                return self._value(self._parts[where.rpartition("/")[2]], odd)
            case {"anyOf": choices}:
                return self._value(rng.choice(choices), odd)
            case {"const": value}:
                return value
            case {"enum": values}:
                return rng.choice(values)
            case {"type": "object", "properties": fields}:
                needed = schema.get("required", ())
                wanted = [n for n in fields if rng.random() > odd and (n in needed or rng.random() < 0.7)]
                return {name: self._value(fields[name], odd) for name in wanted}
            case {"type": "object"}:
                value = schema["additionalProperties"]
                return {f"joint{n}": self._value(value, odd) for n in range(rng.randrange(4))}
            case {"type": "array", "items": item}:
                few = schema.get("minItems", 0)
                return [self._value(item, odd) for _ in range(rng.randint(few, max(few, 3)))]
        return self._plain(schema)

    def _plain(self, schema: Mapping[str, Any]) -> Any:
        rng = self._rng
        low, high = schema.get("minimum", schema.get("exclusiveMinimum", -3)), schema.get("maximum", 20)
        match schema.get("type"):
            case "number":
                return rng.choice((low, high, rng.uniform(low, high)))
            case "integer":
                return rng.choice((low, high, rng.randint(low, high)))
            case "boolean":
                return rng.random() < 0.5
            case "null":
                return None
        return rng.choice(("joint1", "é", "x" * schema.get("minLength", 0)))


@dataclass
class Tally:
    """What came of the strings."""

    strings: int = 0
    accepted: int = 0
    lies: list[str] = field(default_factory=list)

    def line(self) -> str:
        """For people."""
        return f"{self.strings} strings: {self.accepted} were messages, {len(self.lies)} lies"


def check(kind: type[Message], data: bytes, tally: Tally) -> None:
    """Reads one string as a message, and books what came of it."""
    tally.strings += 1
    try:
        message = unpack(kind, data)
    except MessageError as error:
        if not str(error).isprintable():
            tally.lies.append(f"{kind.__name__} {data.hex()}: not a line: {error!r}")
        return
    except Exception as error:  # every kind is a finding here
        tally.lies.append(f"{kind.__name__} {data.hex()}: {error!r}")
        return
    tally.accepted += 1
    again = pack(message)
    told = msgpack.unpackb(data) if data else {}
    if unpack(kind, again) != message or not told.keys() <= msgpack.unpackb(again).keys():
        tally.lies.append(f"{kind.__name__} {data.hex()}: became {again.hex()}")


def some_string(author: Author, rng: random.Random) -> bytes:
    """Noise; or a content, whole or with damage."""
    if rng.random() < 0.1:
        return rng.randbytes(rng.randrange(60))
    data = bytes(msgpack.packb(author.content()))
    if rng.random() < 0.001:
        data += bytes(LONGEST)
    for _ in range(rng.choice((0, 0, 1, 1, 2, 5))):
        data = damaged(data, rng) if data else data
    return data


def fuzz(strings: int, seed: int = 0) -> Tally:
    """So many strings, the kinds of messages in turn."""
    rng, tally = random.Random(seed), Tally()
    authors = [(kind, Author(kind.model_json_schema(), rng)) for kind in kinds()]
    for n in range(strings):
        kind, author = authors[n % len(authors)]
        check(kind, some_string(author, rng), tally)
    return tally


def main(strings: int = STRINGS, seed: int = 0) -> int:
    """Prints the tally; 1 if there was a lie."""
    tally = fuzz(strings, seed)
    print(f"{len(kinds())} kinds of messages, random, damaged and odd", tally.line())
    print(*tally.lies[:10], sep="\n")
    return bool(tally.lies)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
