"""Files that were dropped on the page: which is which, and the task that opens them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.workbench.work.tasks import OpenFiles, OpenTask
from lrm_math.errors import FileError
from lrm_math.toml_file import schema_of


@dataclass(frozen=True)
class DroppedFiles:
    """Files by their part: measurements (with the metadata beside them), a model, an arm."""

    data: Path | None = None
    model: Path | None = None
    arm: Path | None = None


def keep_dropped(folder: Path, contents: Mapping[str, bytes]) -> DroppedFiles:
    """Writes dropped files to a folder and tells which is which by ending and schema. Raises `FileError`."""
    found: dict[str, Path] = {}
    for name, content in contents.items():
        path = folder / Path(name).name
        path.write_bytes(content)
        kind = _kind(path)
        if kind in found:
            raise FileError(path.name, "", f"a second file that is {kind}", "drop one data set and one model at a time")
        if kind != "metadata":
            found[kind] = path
    return DroppedFiles(**found)


def task_for(dropped: DroppedFiles, now: OpenFiles | None) -> OpenTask:
    """The task that opens dropped files. To a data set alone a model is fitted, a model alone takes the data at hand.

    Raises `FileError`.
    """
    data = dropped.data or (now.data if now is not None else None)
    if data is None:
        raise FileError(dropped.model or dropped.arm, "", "there are no measurements yet", "drop a .csv with it")
    if dropped.data is not None and dropped.model is None and dropped.arm is None and now is not None:
        from lrm_ident.data.measurement_file.conventions import (
            metadata_of,  # here, since the page would wait for all that it needs
        )

        metadata = metadata_of(dropped.data)
        if metadata is None or metadata.arm is None:
            return OpenTask(data, now.model)
    return OpenTask(data, dropped.model, None if dropped.arm is None else str(dropped.arm))


def _kind(path: Path) -> str:
    if path.suffix == ".csv":
        return "data"
    if path.suffix != ".toml":
        raise FileError(path.name, "", f"a {path.suffix or 'nameless'} file", "should be a .csv or a .toml")
    schema = schema_of(path) or ""
    for prefix, kind in (("lrm/model/", "model"), ("lrm/arm/", "arm"), ("lrm/measurements/", "metadata")):
        if schema.startswith(prefix):
            return kind
    raise FileError(path.name, "schema", f"is {schema or 'not said'}", "should be a model, an arm or metadata of a CSV")
