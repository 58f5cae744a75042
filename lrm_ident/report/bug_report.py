"""Text that a bug report needs: versions, the last error, and the heads of files, without a number of the data."""

from __future__ import annotations

import json
import platform
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lrm_ident.data.last_error import last_error
from lrm_ident.data.table_text.csv_file import is_number, read_table
from lrm_ident.study.tool_version import tool_version
from lrm_math.errors import LrmError
from lrm_math.ik.kernel.shared_library import kernel

PACKAGES = ("numpy", "scipy", "pydantic", "typer", "rich", "matplotlib", "eclipse-zenoh", "nicegui", "lerobot")
PLAIN_KEYS = ("schema", "arm", "unit", "angle_unit", "axes", "frame", "bad_rows")
"""Keys of which the value is shown, if it is a word: they say how a file is read."""
MOST_KEYS = 60


def bug_report(files: Sequence[Path]) -> str:
    """The report on these files."""
    parts = {
        "Versions": versions(),
        "Last error (it may quote a cell or a name: read it before you send it)": last_error() or ("none is known",),
        "Files (no values; only what they are made of)": [line for file in files for line in file_head(file)]
        or ("none was named: lrm-ident report-bug MODEL DATA",),
    }
    return "\n".join(f"{title}\n" + "".join(f"  {line}\n" for line in lines) for title, lines in parts.items())


def versions() -> Iterator[str]:
    """Versions of the tool, Python, the machine, and the packages that it uses."""
    yield tool_version()
    yield f"Python {platform.python_version()} on {platform.system()} {platform.release()}, {platform.machine()}"
    yield f"compiled kernel: {_kernel()}"
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            yield f"{name} {version(name)}"
    yield f"encoding {sys.getfilesystemencoding()}, in a notebook: {'ipykernel' in sys.modules}"


def file_head(path: Path) -> Iterator[str]:
    """Lines that say what a file is made of: its size, the names of its columns or keys, kinds of cells; no value.

    Numbers in a place where names should be are shown as such.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        yield f"{path.name}: cannot be read ({error.strerror})"
        return
    yield f"{path.name}: {len(content)} bytes, {len(content.splitlines())} lines"
    if path.suffix in (".toml", ".json"):
        yield from _keys(content, path.suffix)
        return
    try:
        table = read_table(path)
    except LrmError as error:
        yield f"  no table: {str(error).replace(str(path), path.name)}"
        return
    yield from (f"  {words}" for words in table.notices)
    yield f"  {len(table.rows)} rows, names in line {table.header_line}"
    for column, cells in zip(table.columns, zip(*table.rows, strict=True), strict=True):
        name = "(a number in place of a name)" if is_number(column.stated) else column.stated
        yield f"  {name}: {_kinds(cells)}"


def _kernel() -> str:
    try:
        kernel()
    except LrmError as error:
        return str(error).rpartition("/")[2]
    return "is there"


def _keys(content: bytes, suffix: str) -> Iterator[str]:
    try:
        values = tomllib.loads(content.decode()) if suffix == ".toml" else json.loads(content)
    except (ValueError, RecursionError) as error:
        yield f"  cannot be parsed: {type(error).__name__}"
        return
    names = list(_names(values))
    yield from (f"  {name}" for name in names[:MOST_KEYS])
    if len(names) > MOST_KEYS:
        yield f"  and {len(names) - MOST_KEYS} more keys"


def _names(values: Any, above: str = "") -> Iterator[str]:
    """Dotted keys, with the kind of each value."""
    if not isinstance(values, dict):
        yield f"{above or 'the file'}: {type(values).__name__}"
        return
    for key, value in values.items():
        name = f"{above}.{key}" if above else str(key)
        if isinstance(value, dict):
            yield from _names(value, name)
        elif key in PLAIN_KEYS and isinstance(value, str):
            yield f"{name} = {Path(value).name if key == 'arm' else value}"
        else:
            yield f"{name}: {type(value).__name__}{f' of {len(value)}' if isinstance(value, list) else ''}"


def _kinds(cells: Iterable[str]) -> str:
    counted = Counter("empty" if not cell.strip() else "numbers" if is_number(cell) else "text" for cell in cells)
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counted.items(), key=lambda item: -item[1]))
