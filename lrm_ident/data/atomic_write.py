"""The one place that writes files: whole or not at all, and never over one that the tool did not write.

Results never go to an input, a file beside one, a device or a folder. The tool knows its own files by their content: a
TOML or JSON file by its `schema`, any other by a line in the record `.lrm-written` of its folder, which has the SHA-256
of what was written under which name. A file that somebody has changed since is not the tool's any more.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Mapping
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
            content = json.loads(file.read_bytes())
        except (OSError, ValueError):
            return False
        return isinstance(content, dict) and str(content.get("schema", "")).startswith("lrm/")
    return suffix == ".toml" and (schema_of(file) or "").startswith(RESULTS)


def _record(target: Path, content: bytes) -> None:
    """Notes in the folder's record that the tool writes this file; one line, so that processes may write at once."""
    with (target.parent / RECORD).open("a", encoding="utf-8") as record:
        record.write(_line(target.name, content) + "\n")


def _line(name: str, content: bytes) -> str:
    return f"{hashlib.sha256(content).hexdigest()}  {name}"


def check_outputs(outputs: Mapping[str, Path], inputs: Iterable[Path], appended: Collection[str] = ()) -> None:
    """Raises `FileError` unless every output can be written, each to a file of its own that nothing else needs.

    Args:
        outputs: paths by the option that names them; symbolic and hard links are followed.
        inputs: files that are read; a `.toml` beside a `.csv` belongs to it.
        appended: options whose file, if there is one, goes on: its writer looks whether it may.
    """
    read = list(inputs)
    taken: dict[Path, str] = {}
    for option, path in outputs.items():
        target = path.resolve()
        if any(_same(target, source) for source in read):
            raise FileError(path, "", f"{option} is an input of the command", "write the result to another file")
        if target in taken:
            raise FileError(path, "", f"{taken[target]} and {option} are the same file", "give them different names")
        taken[target] = option
        _check_writable(option, path, target)
        if option not in appended:
            _check_kind(option, path, target)


def _same(target: Path, read: Path) -> bool:
    """Whether two names lead to one file, by symbolic or hard links or in other capitals."""
    return target == read.resolve() or (target.exists() and read.exists() and target.samefile(read))


def _check_writable(option: str, path: Path, target: Path) -> None:
    if target.is_dir():
        raise FileError(path, "", f"{option} is a folder", "name a file")
    if target.exists() and not target.is_file():
        raise FileError(path, "", f"{option} is a device, no file", "name a file")
    if not target.parent.is_dir():
        raise FileError(path, "", "cannot be written", f"there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK | os.X_OK) or (target.exists() and not os.access(target, os.W_OK)):
        raise FileError(path, "", "cannot be written", "you may not write there")


def _check_kind(option: str, path: Path, target: Path) -> None:
    """Raises `FileError` over a description, even one that the tool wrote, and over what it did not write."""
    schema = schema_of(target) if option.startswith("-") and target.suffix == ".toml" and target.exists() else None
    if schema is not None and not schema.startswith(RESULTS):
        raise FileError(path, "", f"{option} would overwrite a file of schema {schema}", "write to another file")
    check_replaceable(path, option)


def is_something_else(sidecar: Path) -> bool:
    """Whether a TOML file says by its schema that it is a model, an arm, or anything but metadata."""
    schema = schema_of(sidecar)
    return schema is not None and not schema.startswith("lrm/measurements/")
