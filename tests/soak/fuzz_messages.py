"""Random, damaged and invalid bytes against the messages: `python -m tests.soak.fuzz_messages [STRINGS] [SEED]`.

Violations are an exception other than `MessageError`, an error that is not one printable line, and an accepted message
that is not the same after it was packed and read again, or that has lost or gained a field.
"""

from __future__ import annotations

import math
import random
import sys
from collections.abc import Mapping
from typing import Any

import msgpack

from lrmd.messages.codec import Message, MessageError, pack, unpack
from lrmd.messages.zenoh_session import LARGEST_MESSAGE
from tests.soak.fuzz_link import damaged
from tests.soak.fuzz_result import FuzzResult
from tests.support.message_schemas import every_message

STRINGS = 1_000_000
INVALID = (
    None, True, -1, 0, 1e-320, 2**63, -(2**63), 2**64 - 1, 1e308, math.nan, math.inf, "", "x" * 100, "\n\x1b[2J", "\0",
    "joint1", b"bytes", b"\xff\xfe", [], [[]], [None] * 20, {}, {"": {}}, {"v": 1}, {1: 2}, {b"v": 1},
    msgpack.ExtType(5, b"abc"), msgpack.Timestamp(1, 2),
)  # fmt: skip
"""Values that clients send by mistake."""
PLAIN = (None, True, -1, 0.5, "joint1", [1, [2.5]], {"a": {"b": None}})
"""Values of `JsonValue`."""


def message_types() -> list[type[Message]]:
    """Every message that is defined in lrmd."""
    return [kind for kind in every_message().values() if issubclass(kind, Message)]


class ContentGenerator:
    """Random contents that a JSON schema describes, some with invalid parts."""

    def __init__(self, schema: Mapping[str, Any], rng: random.Random) -> None:
        self._schema, self._parts, self._rng = schema, schema.get("$defs", {}), rng

    def content(self) -> Any:
        """One content: valid, or with invalid values, missing fields and unknown ones."""
        invalid = self._rng.choice((0.0, 0.0, 0.02, 0.2))
        whole = self._value(self._schema, invalid)
        if isinstance(whole, dict) and self._rng.random() < invalid:
            return whole | {self._rng.choice(("x", "lease", "V", "")): self._rng.choice(INVALID)}
        return whole

    def _value(self, schema: Mapping[str, Any], invalid: float) -> Any:
        rng = self._rng
        if invalid and rng.random() < invalid:
            return rng.choice(INVALID)
        match schema:
            case {"$ref": "#/$defs/JsonValue"}:
                return rng.choice(PLAIN)
            case {"$ref": where}:
                return self._value(self._parts[where.rpartition("/")[2]], invalid)
            case {"anyOf": choices}:
                return self._value(rng.choice(choices), invalid)
            case {"const": value}:
                return value
            case {"enum": values}:
                return rng.choice(values)
            case {"type": "object", "properties": fields}:
                needed = schema.get("required", ())
                wanted = [n for n in fields if rng.random() > invalid and (n in needed or rng.random() < 0.7)]
                return {name: self._value(fields[name], invalid) for name in wanted}
            case {"type": "object"}:
                value = schema["additionalProperties"]
                return {f"joint{n}": self._value(value, invalid) for n in range(rng.randrange(4))}
            case {"type": "array", "items": item}:
                few = schema.get("minItems", 0)
                return [self._value(item, invalid) for _ in range(rng.randint(few, max(few, 3)))]
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


def check(kind: type[Message], data: bytes, result: FuzzResult) -> None:
    """Reads one string as a message, and counts the outcome."""
    result.counts["strings"] += 1
    try:
        message = unpack(kind, data)
    except MessageError as error:
        if not str(error).isprintable():
            result.violations.append(f"{kind.__name__} {data.hex()}: not a line: {error!r}")
        return
    except Exception as error:  # every kind is a finding here
        result.violations.append(f"{kind.__name__} {data.hex()}: {error!r}")
        return
    result.counts["accepted"] += 1
    again = pack(message)
    fields = msgpack.unpackb(data) if data else {}
    if unpack(kind, again) != message or not fields.keys() <= msgpack.unpackb(again).keys():
        result.violations.append(f"{kind.__name__} {data.hex()}: became {again.hex()}")


def random_string(generator: ContentGenerator, rng: random.Random) -> bytes:
    """Noise, or a packed content, whole or damaged."""
    if rng.random() < 0.1:
        return rng.randbytes(rng.randrange(60))
    data = bytes(msgpack.packb(generator.content()))
    if rng.random() < 0.001:
        data += bytes(LARGEST_MESSAGE)
    for _ in range(rng.choice((0, 0, 1, 1, 2, 5))):
        data = damaged(data, rng) if data else data
    return data


def fuzz(strings: int, seed: int = 0) -> FuzzResult:
    """So many strings, the types of messages in turn."""
    rng, result = random.Random(seed), FuzzResult()
    generators = [(kind, ContentGenerator(kind.model_json_schema(), rng)) for kind in message_types()]
    for n in range(strings):
        kind, generator = generators[n % len(generators)]
        check(kind, random_string(generator, rng), result)
    return result


def main(strings: int = STRINGS, seed: int = 0) -> int:
    """Prints the counts; 1 if there was a violation."""
    result = fuzz(strings, seed)
    counts = f"{result.counts['strings']} strings: {result.counts['accepted']} were messages"
    print(f"{len(message_types())} kinds of messages, random, damaged and odd {counts}, {len(result.violations)} lies")
    print(*result.violations[:10], sep="\n")
    return bool(result.violations)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
