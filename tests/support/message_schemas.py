"""Every message that is defined in lrmd, and contents that its schema allows."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from typing import Any

from hypothesis import strategies as st
from pydantic import ValidationError

from lrmd import messages
from lrmd.messages.codec import Part
from lrmd.messages.skills import ALLOWED, CHOSEN, NEEDED
from lrmd.messages.surroundings import WANTED

Content = dict[str, Any]


def every_message() -> dict[str, type[Part]]:
    """The messages and their parts by name, wherever they are defined, without what others only derive from."""
    for module in pkgutil.iter_modules(messages.__path__, "lrmd.messages."):
        importlib.import_module(module.name)
    found: dict[str, type[Part]] = {}
    waiting: list[type[Part]] = [Part]
    while waiting:
        for kind in waiting.pop().__subclasses__():
            if kind.__module__.startswith("lrmd."):
                found[kind.__name__] = kind
                waiting.append(kind)
    return {name: kind for name, kind in sorted(found.items()) if not kind.__subclasses__()}


def contents(kind: type[Part]) -> st.SearchStrategy[Content]:
    """Contents that may be sent as a message, drawn from its JSON schema, with fields that go together."""
    schema = kind.model_json_schema()

    def consistent(content: Content) -> bool:
        try:
            kind.model_validate(content)
        except ValidationError as error:
            return any(fault["type"] != "value_error" for fault in error.errors())
        return True

    return _of(schema, schema.get("$defs", {})).map(TOGETHER.get(kind.__name__, dict)).filter(consistent)


def _one_histogram(content: Content) -> Content:
    """Fields that go together: ascending edges, one count more, and their sum."""
    edges = sorted(set(content["late_upper_us"]))
    counts = (2 * content["late_counts"])[: len(edges) + 1]
    return {**content, "late_upper_us": edges, "late_counts": counts, "ticks": sum(counts)}


def _of_its_shape(content: Content) -> Content:
    """The fields that an obstacle of its shape has, and no others."""
    wanted = {"name", "shape", "position_m", *WANTED[content["shape"]]}
    given = {
        "size_m": [1.0, 2.0, 3.0], "end_m": [0.0, 0.0, 1.0], "radius_m": 0.1, "cell_m": 0.1, "columns": 1,
        "heights_m": [0.1, None],
    }  # fmt: skip
    if content.get("heights_m"):
        content = {**content, "columns": len(content["heights_m"])}
    kept = {key: value for key, value in content.items() if key in wanted and value is not None}
    return {**{key: value for key, value in given.items() if key in wanted}, **kept}


def _of_the_skill(content: Content) -> Content:
    """The fields that a skill has, and no others."""
    needed, more = NEEDED[content["skill"]], ALLOWED.get(content["skill"], ())
    given = {
        "goal": {"position_m": [0.1, 0.2, 0.3]}, "height_m": 0.1, "q_rad": [0.1], "gripper_rad": 0.1, "payload_kg": 0.1
    }  # fmt: skip
    kept = {key: value for key, value in content.items() if key not in CHOSEN or key in more}
    return {**{key: content.get(key) or given[key] for key in needed}, **kept}


def _ascending(content: Content) -> Content:
    """A box whose low corner is below its high one."""
    ends = [sorted(pair) for pair in zip(content["low_m"], content["high_m"], strict=True)]
    low = [min(a, 99.0) for a, _ in ends]
    return {**content, "low_m": low, "high_m": [max(b, a + 1.0) for a, (_, b) in zip(low, ends, strict=True)]}


TOGETHER: dict[str, Callable[[Content], Content]] = {
    "MetricsState": _one_histogram,
    "ObstacleEntry": _of_its_shape,
    "ContactEntry": _ascending,
    "SkillRequest": _of_the_skill,
}


PRINTABLE = st.characters(codec="utf-8", exclude_categories=["C", "Z"], include_characters=" ")


def _of(schema: Mapping[str, Any], defs: Mapping[str, Any]) -> st.SearchStrategy[Any]:
    match schema:
        case {"$ref": "#/$defs/JsonValue"}:
            return st.integers(-5, 5)
        case {"$ref": where}:
            name = where.rpartition("/")[2]
            return _of(defs[name], defs).map(TOGETHER.get(name, _same))
        case {"anyOf": choices}:
            return st.one_of(*(_of(choice, defs) for choice in choices))
        case {"const": value}:
            return st.just(value)
        case {"enum": values}:
            return st.sampled_from(values)
        case {"type": "number" | "integer" as number}:
            return _number(schema, number)
        case {"type": "boolean"}:
            return st.booleans()
        case {"type": "null"}:
            return st.none()
        case {"type": "string"}:
            return st.text(PRINTABLE, min_size=schema.get("minLength", 0), max_size=min(8, schema.get("maxLength", 8)))
        case {"type": "array"}:
            most = min(schema.get("maxItems", 3), max(3, schema.get("minItems", 0)))
            return st.lists(_of(schema["items"], defs), min_size=schema.get("minItems", 0), max_size=most)
        case {"type": "object", "properties": fields}:
            needed = {k: _of(s, defs) for k, s in fields.items() if k in schema.get("required", ())}
            others = {k: _of(s, defs) for k, s in fields.items() if k not in needed}
            return st.fixed_dictionaries(needed, optional=others)
        case {"type": "object"}:
            inner = schema["additionalProperties"]
            keys = _of({"type": "string", **schema.get("propertyNames", {})}, defs)
            return st.dictionaries(keys, _of(inner, defs), max_size=3)
    raise AssertionError(f"no strategy for {schema}")


def _same(content: Any) -> Any:
    return content


def _number(schema: Mapping[str, Any], kind: str) -> st.SearchStrategy[Any]:
    low, high = (schema.get(key, schema.get(f"exclusive{key.capitalize()}")) for key in ("minimum", "maximum"))
    if kind == "integer":
        lowest = -(2**40) if low is None else low + ("exclusiveMinimum" in schema)
        return st.integers(lowest, 2**40 if high is None else high - ("exclusiveMaximum" in schema))
    return st.floats(
        low, high, exclude_min="exclusiveMinimum" in schema, exclude_max="exclusiveMaximum" in schema,
        allow_nan=False, allow_infinity=False,
    )  # fmt: skip
