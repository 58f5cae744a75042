"""Limit of the messages whose wildcards match the emergency stop's keys, per client, in the router itself.

A put on `lrm/**` matches the subscriber of `cmd/estop`, so that each one would call it. zenoh's downsampling limits
every message whose key expression intersects one of a rule. The rules here are keys next to the emergency stop's: with
a chunk or a letter put in somewhere. A wildcard that matches the stop's key matches one of these as well, since what it
leaves open may be longer, too. The stop's key itself, and that of all robots, match none: they are never limited.
"""

from __future__ import annotations

import json
from typing import Any

import zenoh

RATE_HZ = 10.0
"""Messages per second and client that pass each rule, so that their sender is still told what is wrong."""
MESSAGES = {"cmd/estop": ["put", "delete"], "rpc/estop": ["query"]}
FILLER = "-"


def neighbours(tail: str) -> list[str]:
    """Keys like `lrm/*/<tail>`, with a chunk put in anywhere, or a letter into any chunk but the robot's."""
    chunks = ["lrm", "*", *tail.split("/")]
    longer = [[*chunks[:i], FILLER, *chunks[i:]] for i in range(len(chunks) + 1)]
    other = [
        [*chunks[:i], chunk[:at] + FILLER + chunk[at:], *chunks[i + 1 :]]
        for i, chunk in enumerate(chunks) if chunk != "*"
        for at in range(len(chunk) + 1)
    ]  # fmt: skip
    return ["/".join(key) for key in (*longer, *other)]


def with_rate_limits(config: zenoh.Config) -> zenoh.Config:
    """The configuration of a router, with these limits beside those that it has."""
    rules: list[dict[str, Any]] = [
        {
            "id": f"lrm wildcards at {tail}", "flows": ["ingress"], "messages": messages,
            "rules": [{"key_expr": key, "freq": RATE_HZ} for key in neighbours(tail)],
        }
        for tail, messages in MESSAGES.items()
    ]  # fmt: skip
    config.insert_json5("downsampling", json.dumps([*json.loads(config.get_json("downsampling")), *rules]))
    return config
