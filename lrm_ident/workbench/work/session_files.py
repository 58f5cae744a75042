"""Files of a session: measurements that are open and may change, those that are followed, those that are dropped."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.workbench.work.tasks import OpenFiles, OpenTask
from lrm_math.errors import FileError
from lrm_math.toml_file import schema_of


@dataclass(frozen=True)
class OpenedData:
    """A data file that is open.

    Attributes:
        path: of the file. sha256: of what was read of it. copy: where that is kept, or None if it changed too soon.
    """

    path: Path
    sha256: str
    copy: Path | None

    @property
    def changed(self) -> bool:
        """Whether the file is no longer what was read, or is gone."""
        try:
            return _sha256(self.path) != self.sha256
        except OSError:
            return True


def keep_opened(path: Path, sha256: str, folder: Path) -> OpenedData:
    """Copies a data file that was read, with the metadata beside it, to a folder."""
    copy = folder / f"data-{sha256[:8]}" / path.name
    if path != copy:
        copy.parent.mkdir(parents=True, exist_ok=True)
        _copy_there(path, copy)
        _copy_there(path.with_suffix(".toml"), copy.with_suffix(".toml"))
    return OpenedData(path, sha256, copy if copy.is_file() and _sha256(copy) == sha256 else None)


def _copy_there(source: Path, copy: Path) -> None:
    if source.is_file():
        shutil.copyfile(source, copy)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@dataclass
class FollowedFile:
    """A growing CSV. `copy`: where its whole lines are, with the metadata beside it; `size` bytes of it are there."""

    source: Path
    copy: Path
    size: int = -1

    def grown(self) -> bool:
        """Whether it has changed; then the copy is new. Raises `FileError` if it is gone."""
        try:
            content = self.source.read_bytes()
        except OSError as error:
            raise FileError(self.source, "", f"cannot be followed any longer ({error.strerror})") from None
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) == self.size or whole.count(b"\n") < 2:
            return False
        self.size = len(whole)
        self.copy.write_bytes(whole)
        _copy_there(self.source.with_suffix(".toml"), self.copy.with_suffix(".toml"))
        return True


def follow_file(source: Path, folder: Path) -> FollowedFile:
    """Follows a file; its copies go to a folder. Raises `FileError`."""
    if not source.is_file():
        raise FileError(source, "", "no such file")
    if source.suffix != ".csv":
        raise FileError(source, "", f"a {source.suffix or 'nameless'} file", "only a .csv can be followed")
    place = folder / "followed"
    place.mkdir(exist_ok=True)
    return FollowedFile(source, place / source.name)


def keep_dropped(folder: Path, contents: Mapping[str, bytes]) -> dict[str, Path]:
    """Writes dropped files to a folder; by ending and schema they are `data`, `model` or `arm`. Raises `FileError`."""
    kept_files: dict[str, Path] = {}
    for name, content in contents.items():
        path = folder / Path(name).name
        path.write_bytes(content)
        kind = _kind(path)
        if kind in kept_files:
            raise FileError(path.name, "", f"a second file that is {kind}", "drop one data set and one model at a time")
        if kind != "metadata":
            kept_files[kind] = path
    return kept_files


def task_for(dropped: Mapping[str, Path], open_files: OpenFiles | None) -> OpenTask:
    """The task that opens dropped files. To a data set alone a model is fitted, a model alone takes the data at hand.

    Raises `FileError`.
    """
    data = dropped.get("data", None if open_files is None else open_files.data)
    if data is None:
        raise FileError(
            dropped.get("model", dropped.get("arm")), "", "there are no measurements yet", "drop a .csv with it"
        )
    if set(dropped) == {"data"} and open_files is not None:
        # here, since the page would wait for all that it needs
        from lrm_ident.data.measurement_file.conventions import metadata_of

        metadata = metadata_of(data)
        if metadata is None or metadata.arm is None:
            return OpenTask(data, open_files.model)
    return OpenTask(data, dropped.get("model"), str(dropped["arm"]) if "arm" in dropped else None)


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
