"""Strict reading of TOML files: validated by pydantic, every fault said in one line of a `FileError`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from lrm_math.errors import FileError, name_suggestion

LARGEST, PIECE = 32 << 20, 1 << 16
"""Bytes of a file that are read, since a device has no end; and at once, since a read reserves what it asks for."""
TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".xls")
OTHER_ORDER = "do the arguments stand in another order?"
DEPTH = 32
DEEP_KEY = re.compile(rf"""(?:[\w"'-][ \t]*\.[ \t]*(?=[\w"'-])[^.,={{}}\[\]\n]*){{{DEPTH}}}""")
"""Parts of a key, joined by dots: tomllib takes memory that grows with the square of their number."""


class StrictSchema(BaseModel):
    """Schema of a file's table: unknown keys, wrong types and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True, defer_build=True)


S = TypeVar("S", bound=StrictSchema)


def read_toml(path: Path, schema: type[S]) -> S:
    """Reads and validates one file. Raises `FileError`, `FileFaults` if there is more than one fault."""
    return validate(path, parse_toml(path), schema)


def bounded_content(path: Path) -> bytes:
    """The bytes of a file; of a longer one than `LARGEST` a little more than so many. Raises `OSError`."""
    with path.open("rb") as file:
        return b"".join(islice(iter(partial(file.read, PIECE), b""), LARGEST // PIECE + 1))


def parse_toml(path: Path) -> dict[str, Any]:
    """The raw tables of a TOML file. Raises `FileError` if it cannot be read or parsed."""
    try:
        content = bounded_content(path)
        if len(content) > LARGEST:
            raise FileError(path, "", f"more than {LARGEST >> 20} MB", "files of tables are shorter")
        text = content.decode("utf-8-sig")
        if deep := DEEP_KEY.search(text):
            row = text.count("\n", 0, deep.start()) + 1
            raise FileError(path, f"line {row}", f"a key of more than {DEPTH} parts", "tables nest a few levels deep")
        return tomllib.loads(text.replace("\r\n", "\n"))
    except FileNotFoundError:
        raise FileError(path, "", "no such file") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        if path.suffix.lower() in TABLES:
            raise FileError(path, "", f"a {path.suffix} is a table, no TOML", OTHER_ORDER) from None
        if isinstance(error, UnicodeDecodeError):
            row = 1 + error.object.count(b"\n", 0, error.start)
            raise FileError(path, f"line {row}", "is no text in UTF-8", "save it in that encoding") from None
        words = f"cannot be read ({error.strerror})" if isinstance(error, OSError) else f"not valid TOML: {error}"
        raise FileError(path, "", words) from None
    except RecursionError:
        raise FileError(path, "", "arrays or tables nest too deeply", "a few levels are meant") from None


def schema_of(path: Path) -> str | None:
    """The `schema` that a TOML file states; None if it states none or cannot be read.

    Keys of the file itself stand before its first table, so no more is parsed unless an array of the file's own has a
    line that looks like one.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        try:
            stated = tomllib.loads(text.partition("\n[")[0])
        except tomllib.TOMLDecodeError:
            stated = tomllib.loads(text)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return None
    schema = stated.get("schema")
    return schema if isinstance(schema, str) else None


def validate(path: Path, tables: dict[str, Any], schema: type[S]) -> S:
    """Validates parsed tables by a schema. Raises `FileError`: the first fault."""
    for fault in schema_faults(path, tables, schema):
        raise fault
    return schema.model_validate(tables)


def schema_faults(path: Path, tables: dict[str, Any], schema: type[BaseModel]) -> list[FileError]:
    """All faults of parsed tables by a schema; only that it is another kind of file, if it states another schema."""
    other = _other_kind(path, tables, schema)
    if other:
        return [other]
    try:
        schema.model_validate(tables)
    except ValidationError as error:
        faults = sorted(error.errors(include_url=False), key=lambda fault: fault["type"] != "extra_forbidden")
        return [_file_error(path, fault, schema) for fault in faults]
    return []


def _other_kind(path: Path, tables: dict[str, Any], schema: type[BaseModel]) -> FileError | None:
    field = schema.model_fields.get("schema_")
    expected = get_args(field.annotation) if field else ()
    stated = tables.get("schema")
    if not expected or not isinstance(stated, str) or stated in expected or not stated.startswith("lrm/"):
        return None
    model_of = tables.get("arm") if stated.startswith("lrm/model/") and expected[0].startswith("lrm/arm/") else None
    hint = f"it is a model of {model_of}: name that arm" if model_of else OTHER_ORDER
    if stated.rpartition("/")[0] in {schema_name.rpartition("/")[0] for schema_name in expected}:
        hint = "another version of the format: update the older of the two programs"
    return FileError(path, "", f"schema = '{stated}'", f"should be '{expected[0]}'; {hint}")


def _file_error(path: Path, fault: Mapping[str, Any], schema: type[BaseModel]) -> FileError:
    *table, key = fault["loc"] or ("",)
    if isinstance(key, int) and table:
        key = f"{table.pop()} {key + 1}"
    where = " ".join(str(part + 1 if isinstance(part, int) else part) for part in table)
    expected = ""
    match fault["type"]:
        case "missing":
            field = next((field for name, field in schema.model_fields.items() if key in (name, field.alias)), None)
            constant = get_args(field.annotation) if field is not None and not table else ()
            what = f"missing key {key}"
            expected = f'write {key} = "{constant[0]}"' if constant and isinstance(constant[0], str) else ""
        case "extra_forbidden":
            what, expected = f"unknown key {key}", name_suggestion(str(key), _valid_keys(schema, table))
        case _:
            what, expected = f"{key} = {_shown(fault['input'])}", _wanted(fault["msg"])
    return FileError(path, where, what, expected)


def _wanted(message: str) -> str:
    """What pydantic says a value should be, without its word for the value: `Input`, `String`, `List`."""
    _, should, rest = message.partition(" should ")
    return f"should {rest}" if should else f"should be {message.removeprefix('Value error, ')}"


def _shown(value: object) -> str:
    """A value of a file, short."""
    text = repr(value)
    return text if len(text) <= 200 else text[:197] + "..."


def _valid_keys(schema: type[BaseModel], table: list[int | str]) -> tuple[str, ...]:
    for part in table:
        if isinstance(part, str) and part in schema.model_fields:
            inner = _schemas_in(schema.model_fields[part].annotation)
            if inner:
                schema = inner[0]
    return tuple(field.alias or name for name, field in schema.model_fields.items())


def _schemas_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [schema for arg in get_args(annotation) for schema in _schemas_in(arg)]
