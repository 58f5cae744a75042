"""The shipped JSON Schemas are those of the code, and say what the daemon does."""

from __future__ import annotations

import json

from lrmd.messages.codec import Header, Message
from lrmd.messages.json_schemas import FILE, schemas, text
from tests.support.message_schemas import every_message

REQUESTS = {
    name for name, kind in every_message().items()
    if issubclass(kind, Message) and not issubclass(kind, Header) and name != "ErrorReply"
} | {"GoalEntry", "ContactEntry", "ObstacleEntry"}  # fmt: skip


def test_the_shipped_file_is_in_step_with_the_code() -> None:
    assert FILE.read_text(encoding="utf-8") == text(), "run `make schemas`"


def test_every_message_is_in_it_with_all_its_fields() -> None:
    definitions = schemas()["$defs"]
    for name, kind in every_message().items():
        assert set(definitions[name]["properties"]) == set(kind.model_fields)
    assert set(definitions) - set(every_message()) <= {"JsonValue"}


def test_requests_are_strict_and_replies_may_grow() -> None:
    """An unknown field of a request is an error; a client must not make one of an unknown field of the daemon's."""
    for name, definition in schemas()["$defs"].items():
        if name in REQUESTS:
            assert definition["additionalProperties"] is False, name
            assert "v" not in definition.get("required", []), "a request without v is of version 1"
        elif name != "JsonValue":
            assert "additionalProperties" not in definition, name
            assert set(definition["required"]) == set(definition["properties"]), "the daemon sends every field"


def test_all_references_lead_somewhere() -> None:
    document = schemas()
    found = json.dumps(document).split('"$ref": "#/$defs/')[1:]
    assert found
    assert {part.partition('"')[0] for part in found} <= set(document["$defs"])
