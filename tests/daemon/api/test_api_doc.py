"""docs/api.md agrees with the code: every field, type, default, unit, key, example and code, and no others."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from unittest import mock

import msgpack
import pytest

from lrmd.api.publisher import StatePublisher
from lrmd.api.supervisor import ChildProcess
from lrmd.api.zenoh_server import COMMANDS, REQUESTS
from lrmd.client import Rover
from lrmd.config import load_config
from lrmd.control.state_machine import Mode, Trigger
from lrmd.control.updates import FAULT_RESPONSES
from lrmd.messages.bounds import LONGEST, bounds_of
from lrmd.messages.codec import Header, Message, unpack
from lrmd.messages.control import HoldRequest, MoveRequest
from lrmd.ramp.shared_memory import SharedRecords
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.message_schemas import every_message
from tests.support.source_files import files, syntax_tree

TEXT = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
MESSAGES = every_message()

UNITS = {
    "rad": "rad", "rad_per_s": "rad/s", "us": "µs", "ms": "ms", "ns": "ns", "s": "s", "kg": "kg", "m": "m", "nm": "N·m",
    "c": "°C", "hz": "Hz", "m_per_s2": "m/s²",
}  # fmt: skip
"""The unit of a field by the end of its name."""
UNNAMED = {"waypoints": "rad", "seconds": "s"}
"""Units of fields whose name has none."""


@dataclass(frozen=True)
class Section:
    """Content of the section of a message."""

    fields: dict[str, tuple[str, str, str]]
    examples: tuple[Any, ...]


def rows(text: str, head: str) -> Iterator[list[str]]:
    """Cells of the tables whose first heading is `head`."""
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] if line.startswith("|") else []
        if not cells:
            inside = False
        elif cells[0] == head:
            inside = True
        elif inside and not set(cells[0]) <= set("-: "):
            yield cells


def sections() -> dict[str, Section]:
    """Every section of a message: its heading is the message's name."""
    found = {}
    for part in re.split(r"^#{2,4} ", TEXT, flags=re.MULTILINE)[1:]:
        heading, _, body = part.partition("\n")
        if (name := heading.strip().strip("`")) in {*MESSAGES, "Header"}:
            fields = {row[0].strip("`"): (row[1], row[2], row[3]) for row in rows(body, "field")}
            blocks = re.findall(r"^```json\n(.*?)^```", body, re.MULTILINE | re.DOTALL)
            found[name] = Section(fields, tuple(json.loads(block) for block in blocks))
    return found


SECTIONS = sections()


def own_fields(kind: type[Any]) -> dict[str, Any]:
    """Those that are not documented once for all, under Header."""
    common = {"v", *(Header.model_fields if issubclass(kind, Header) and kind is not Header else ())}
    return {name: field for name, field in kind.model_fields.items() if name not in common or kind is Header}


def bounds(schema: Mapping[str, Any], low: str, high: str) -> str:
    """`0 to 2`, `at most 64`, `more than 0, at most 1`."""
    least, most = schema.get(low), schema.get(high)
    if "exclusiveMinimum" in schema:
        return f"more than {schema['exclusiveMinimum']:g}, at most {most:g}"
    if "exclusiveMaximum" in schema:
        return f"{least:g} to less than 2^{schema['exclusiveMaximum'].bit_length() - 1}"
    if least is not None and most is not None:
        return f"{least:g}" if least == most else f"{least:g} to {most:g}"
    if most is not None:
        return f"at most {most:g}"
    return "" if least is None else f"at least {least:g}"


def type_of(schema: Mapping[str, Any]) -> str:
    """A JSON schema in the words of the document."""

    def limited(words: str, low: str, high: str) -> str:
        return words + (f" ({limits})" if (limits := bounds(schema, low, high)) else "")

    match schema:
        case {"$ref": where}:
            return f"`{where.rpartition('/')[2]}`"
        case {"anyOf": choices}:
            return " or ".join(type_of(choice) for choice in choices)
        case {"const": value}:
            return f"always {value}"
        case {"enum": values}:
            return " or ".join(f"`{value}`" for value in values)
        case {"type": "array"}:
            return f"{limited('list', 'minItems', 'maxItems')} of {type_of(schema['items'])}"
        case {"type": "object", "additionalProperties": {"type": _} as inner}:
            return f"{limited('map', 'minProperties', 'maxProperties')} of names to {type_of(inner)}"
        case {"type": "object"}:
            return "map of anything"
        case {"type": "string"}:
            return limited("text", "minLength", "maxLength")
        case {"type": "number" | "integer" as kind}:
            return limited(kind, "minimum", "maximum")
        case {"type": kind}:
            return str(kind)
    raise AssertionError(schema)


def unit_of(name: str) -> str:
    """By its longest ending that is a unit."""
    parts = name.split("_")
    endings = ["_".join(parts[i:]) for i in range(1, len(parts))]
    return next((UNITS[ending] for ending in endings if ending in UNITS), UNNAMED.get(name, ""))


def described(kind: type[Any]) -> dict[str, tuple[str, str, str]]:
    """Type, default and unit of every field, as they should stand in the document."""
    schema = kind.model_json_schema(mode="validation")
    table = {}
    for name, field in own_fields(kind).items():
        default = "–" if field.is_required() else f"`{json.dumps(field.get_default(call_default_factory=True))}`"
        table[name] = (type_of(schema["properties"][name]), default, unit_of(name))
    return table


def test_every_message_has_a_section_and_no_other() -> None:
    assert set(SECTIONS) == {*MESSAGES, "Header"}


@pytest.mark.parametrize("name", [*MESSAGES, "Header"])
def test_fields_types_defaults_and_units_are_those_of_the_code(name: str) -> None:
    assert SECTIONS[name].fields == described(Header if name == "Header" else MESSAGES[name])


def within(part: Any, whole: Any) -> bool:
    """Whether `part` says the same as `whole`, but for fields that it leaves to their defaults."""
    if isinstance(part, dict):
        return all(within(value, whole[key]) for key, value in part.items())
    if isinstance(part, list):
        return len(part) == len(whole) and all(map(within, part, whole))
    return bool(part == whole)


@pytest.mark.parametrize("name", [n for n, kind in MESSAGES.items() if issubclass(kind, Message)])
def test_every_example_is_a_message_and_none_is_missing(name: str) -> None:
    assert SECTIONS[name].examples
    for example in SECTIONS[name].examples:
        message = unpack(MESSAGES[name], msgpack.packb(example))
        assert within(example, json.loads(json.dumps(message.model_dump())))


def literals(pattern: str) -> set[str]:
    """Every text in lrmd that is like this and nothing else."""
    constants = (
        node for tree in map(syntax_tree, files("lrmd")) for node in ast.walk(tree) if isinstance(node, ast.Constant)
    )
    return {c.value for c in constants if isinstance(c.value, str) and re.fullmatch(pattern, c.value)}


def states() -> set[str]:
    config = load_config(CONFIG)
    ramp, ik = ChildProcess("ramp", print), ChildProcess("ik", print)
    return set(StatePublisher(config, SimulatedDaemon(config).core, SharedRecords.create(), ramp, ik, "boot").states)


def test_every_key_is_in_the_table_with_its_message() -> None:
    table = {row[0].strip("`"): row for row in rows(TEXT, "key")}
    named = set(REQUESTS) | set(COMMANDS) | states() | literals(r"(rpc|cmd|state|alive)/[a-z_]+")
    assert set(table) == named | {"event/<code>", "alive/boot/<boot_id>", "info"}
    for tail, kind in {**REQUESTS, **COMMANDS}.items():
        assert f"`{kind.__name__}`" in table[tail][2], tail
    for tail, row in table.items():
        for name in re.findall(r"`(\w+)`", row[2]):
            assert name in MESSAGES, (tail, name)


def calls(*names: str) -> Iterator[ast.Call]:
    for tree in map(syntax_tree, files("lrmd")):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                if called in names:
                    yield node


def codes_in(node: ast.expr) -> set[str]:
    """The codes that an argument may be: a text, or the name of a process and a text behind it."""
    if isinstance(node, ast.Constant):
        return {node.value}
    if isinstance(node, ast.JoinedStr):
        (last,) = [part.value for part in node.values if isinstance(part, ast.Constant)]
        children = [call.args[0] for call in calls("ChildProcess")]
        return {f"{child.value}{last}" for child in children if isinstance(child, ast.Constant)}
    return set()


def raised() -> dict[str, bool]:
    """Every code of an error reply, and whether it is retryable."""
    found = {}
    for call in calls("RequestError", "ErrorReply", "__init__"):
        given = {k.arg: k.value for k in call.keywords}
        retry = given.get("retryable")
        code = given.get("code", call.args[0] if call.args else None)
        if isinstance(code, ast.Constant):
            retryable = isinstance(retry, ast.Constant) and bool(retry.value)
            assert found.setdefault(code.value, retryable) is retryable, f"{code.value} has two values"
    return found


def test_every_error_code_is_documented_with_its_retryable_flag() -> None:
    table = {row[0].strip("`"): row[2] for row in rows(TEXT, "code")}
    assert table == {code: "yes" if retryable else "no" for code, retryable in raised().items()}


def test_every_event_is_documented_with_its_level() -> None:
    documented = {row[0].strip("`"): row[1] for row in rows(TEXT, "event")}
    fault_count = {what.code for what in FAULT_RESPONSES.values()}
    found = set(fault_count)
    for call in calls("emit", "_emit", "ControllerEvent"):
        codes = codes_in(call.args[0])
        found |= codes
        if isinstance(call.args[1], ast.Constant):
            assert all(documented[code] == call.args[1].value for code in codes), codes
    assert set(documented) == found


def test_every_fault_is_documented() -> None:
    documented = {row[0].strip("`") for row in rows(TEXT, "fault")}
    leads = {what.code for what in FAULT_RESPONSES.values() if what.trigger in (Trigger.FAILED, Trigger.OUTPUTS_LOST)}
    stopped = {what.code for what in FAULT_RESPONSES.values() if what.trigger is Trigger.STOPPED}
    fixed = {code for call in calls("add_fault") for code in codes_in(call.args[0])}
    assert leads | fixed <= documented <= leads | fixed | stopped


def test_modes_and_limits_that_the_text_names_are_the_codes() -> None:
    assert {row[0].strip("`") for row in rows(TEXT, "mode")} == set(Mode)
    assert f"{LONGEST:_}".replace("_", " ") in TEXT
    for kind in (HoldRequest, MoveRequest):
        size = f"{bounds_of(kind).size:_}".replace("_", " ") if bounds_of(kind).size > 9999 else bounds_of(kind).size
        assert f"{size} for" in " ".join(TEXT.split()) or f"{size} bytes for" in " ".join(TEXT.split())


def test_the_program_in_python_is_one() -> None:
    """Every call of the example is one that `Rover` has, with arguments that it takes."""
    (program,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    tree = ast.parse(program)
    double = mock.create_autospec(Rover, instance=True)
    used = [
        node for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name) and node.func.value.id == "rover"
    ]  # fmt: skip
    assert len(used) >= 5
    for call in used:
        assert isinstance(call.func, ast.Attribute)
        getattr(double, call.func.attr)(*[0] * len(call.args), **{k.arg: 0 for k in call.keywords if k.arg})
