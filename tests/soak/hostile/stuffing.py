"""Contents of a stranger's messages that once took the daemon's memory or time: each is small, and no valid one."""

from __future__ import annotations

from collections.abc import Callable

import msgpack

HEAD = 'schema = "lrm/model/1"\n'


def model(arm: str = "lrm-rover", effects: str = '"compliance"', more: str = "") -> str:
    """The text of a model file."""
    return f'{HEAD}arm = "{arm}"\neffects = [{effects}]\n{more}'


def deployed(text: str) -> bytes:
    """A deployment of a text."""
    return bytes(msgpack.packb({"v": 1, "text": text}))


def rows(wide: int, inside: bytes, size: int) -> bytes:
    """Arrays of `wide` elements, within each other, each full of `inside`; so many bytes."""
    row = b"\xdc" + wide.to_bytes(2, "big") + inside * (wide - 1)
    return row * (size // len(row))


TEXTS: dict[str, Callable[[], str]] = {
    "dotted keys, 120 kB": lambda: ".".join("a" * 60_000) + " = 1",
    "dotted keys, 1 MB": lambda: ".".join("a" * 499_000) + " = 1",
    "/dev/zero as the arm": lambda: model("/dev/zero"),
    "20 000 effects of one name": lambda: model(effects='"compliance",' * 20_000),
    "76 000 effects of one name": lambda: model(effects='"compliance",' * 76_000),
    "nested arrays": lambda: "a = " + "[" * 900_000,
    "500 000 numbers": lambda: HEAD + "a = [" + "0," * 490_000 + "]",
    "100 000 tables": lambda: "".join(f"[a{i}]\n" for i in range(100_000)),
    "90 000 parameters": lambda: model(more="[parameters]\n" + "".join(f"k{i} = 1\n" for i in range(85_000))),
    "an effect of 900 kB": lambda: model(effects='"' + "x" * 900_000 + '"'),
    "30-part keys, 14 000 times": lambda: "".join(f"{'.'.join('a' * 30)}.b{i} = 1\n" for i in range(14_000)),
}
"""Of model files."""

CONTENTS: dict[str, Callable[[], bytes]] = {
    "300 000 unknown fields": lambda: bytes(msgpack.packb({f"k{i}": 1 for i in range(230_000)})),
    "2 MB of empty maps": lambda: b"\xdd" + (2_000_000).to_bytes(4, "big") + b"\x80" * 2_000_000,
    "4 MB of short texts": lambda: rows(1000, b"\xa2ab", 4_000_000),
    "an array that says it is long": lambda: b"\xdd\xff\xff\xff\xff" * 200_000,
    "1000 maps with wrong fields": lambda: bytes(
        msgpack.packb({"lease": "x", "waypoints": [{f"j{i}": "x" for i in range(16)}] * 1000})
    ),
    "100 MB": lambda: bytes(100_000_000),
}
"""Of requests."""
