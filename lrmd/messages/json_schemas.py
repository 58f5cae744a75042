"""JSON Schemas (draft 2020-12) of all messages, for clients in other languages: `python -m lrmd.messages.json_schemas`.

They are made from the pydantic models and shipped as `schemas.json`. Those of requests are as strict as the daemon is;
those of the daemon's messages have every field, and may have more, which clients ignore.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from lrmd.messages.codec import ErrorReply, Header, Message
from lrmd.messages.control import Reply
from lrmd.messages.kinematics import IkReply
from lrmd.messages.skills import SkillState

FILE = Path(__file__).with_name("schemas.json")
DESCRIPTION = "Messages of lrmd on zenoh, as msgpack maps; which key carries which, and units: docs/api.md"


def _kinds(base: type[BaseModel]) -> Iterable[type[BaseModel]]:
    """Kinds of messages that derive from one, without those that only others derive from."""
    for kind in base.__subclasses__():
        if kind.__module__.startswith("lrmd.messages."):
            yield from (*_kinds(kind),) or (kind,)


def _definitions(kinds: Iterable[type[BaseModel]], mode: Literal["validation", "serialization"]) -> dict[str, Any]:
    chosen = [(kind, mode) for kind in sorted(kinds, key=lambda kind: kind.__name__)]
    _, schema = models_json_schema(chosen, ref_template="#/$defs/{model}")
    return dict(schema["$defs"])


def schemas() -> dict[str, Any]:
    """One schema document with every message under `$defs`."""
    replies: set[type[BaseModel]] = {*_kinds(Header), Reply, IkReply, SkillState, ErrorReply}
    requests = _definitions(set(_kinds(Message)) - replies, "validation")
    answers = _definitions(replies, "serialization")
    for definition in answers.values():
        if "properties" in definition:
            definition.pop("additionalProperties", None)
            definition["required"] = [*definition["properties"]]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "lrmd", "description": DESCRIPTION,
        "$defs": dict(sorted((answers | requests).items())),
    }  # fmt: skip


def text() -> str:
    """The content of the shipped file."""
    return json.dumps(schemas(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
    print(FILE)
