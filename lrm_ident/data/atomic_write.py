"""The one place that writes files: whole or not at all, and never over one that the tool did not write.

The tool knows its own files by their content: a TOML or JSON file by its `schema`, any other by a line in the record
`.lrm-written` of its folder, which has the SHA-256 of what was written under which name. A file that somebody has
changed since is not the tool's any more.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError
from lrm_math.toml_file import schema_of

RECORD = ".lrm-written"
RESULTS = ("lrm/model/",)
"""Schemas of TOML files that hold results alone; arms, priors and metadata are descriptions that a person edits."""


def write_text(path: Path, text: str) -> None:
    """Writes text in UTF-8 as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Writes the file that `path` leads to. Raises `FileError` if that cannot be done, or if a file is there that the
    tool did not write."""
    target = path.resolve()
    check_replaceable(path)

    def noted(temporary: Path) -> None:
        """Lets everybody read it, and notes in the record what does not say itself that it is the tool's."""
        temporary.chmod(0o644)
        if not _says_itself(temporary, target.suffix):
            _record(target, content)

    write_atomically(path, content, check=noted)


def check_replaceable(path: Path, what: str = "this") -> None:
    """Raises `FileError` if a file is there that the tool did not write. `what`: the output that is to go there."""
    if path.exists() and not is_own(path):
        said = f"{what} would overwrite a file that lrm-ident did not write, or that was changed since"
        raise FileError(path, "", said, "name another file, or move that one away")


def is_own(path: Path) -> bool:
    """Whether the tool wrote a file as it stands there."""
    target = path.resolve()
    if not target.is_file():
        return False
    if _says_itself(target, target.suffix):
        return True
    try:
        return _line(target.name, target.read_bytes()) in (target.parent / RECORD).read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return False


def _says_itself(file: Path, suffix: str) -> bool:
    """Whether a file says by its schema that it is a result of the tool."""
    if suffix == ".json":
        try:
            found = json.loads(file.read_bytes())
        except (OSError, ValueError):
            return False
        return isinstance(found, dict) and str(found.get("schema", "")).startswith("lrm/")
    return suffix == ".toml" and (schema_of(file) or "").startswith(RESULTS)


def _record(target: Path, content: bytes) -> None:
    """Notes in the folder's record that the tool writes this file; one line, so that processes may write at once."""
    with (target.parent / RECORD).open("a", encoding="utf-8") as record:
        record.write(_line(target.name, content) + "\n")


def _line(name: str, content: bytes) -> str:
    return f"{hashlib.sha256(content).hexdigest()}  {name}"
