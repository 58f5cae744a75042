"""Places of results: never an input, a file beside one, any file that the tool did not write, a device or a folder."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from lrm_ident.data.atomic_write import RESULTS, check_replaceable
from lrm_math.errors import FileError
from lrm_math.toml_file import schema_of


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
        if any(_same(target, one) for one in read):
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
