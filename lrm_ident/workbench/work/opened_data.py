"""Measurements that are open: a copy of them as they were read, and whether their file has changed since."""

from __future__ import annotations

import hashlib
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

LOOK_S = 0.5


@dataclass
class OpenedData:
    """A data file that is open.

    Attributes:
        path: of the file. sha256: of what was read of it. copy: where that is kept, or None if it changed too soon.
    """

    path: Path
    sha256: str
    copy: Path | None
    _seen: tuple[int, int] | None = None
    _looked: float = 0.0
    _differs: bool = False

    def changed(self, now: bool = False) -> bool:
        """Whether the file is no longer what was read, or is gone. Looks twice a second; `now`: at once."""
        clock = time.monotonic()
        if not now and clock - self._looked < LOOK_S:
            return self._differs
        self._looked = clock
        try:
            stat = self.path.stat()
            seen = stat.st_mtime_ns, stat.st_size
            if seen != self._seen:
                self._seen, self._differs = seen, _sha256(self.path) != self.sha256
        except OSError:
            self._seen, self._differs = None, True
        return self._differs


def keep_opened(path: Path, sha256: str, folder: Path) -> OpenedData:
    """Copies a data file that was read, with the metadata beside it, to a folder."""
    copy = folder / f"data-{sha256[:8]}" / path.name
    if path != copy:
        copy.parent.mkdir(parents=True, exist_ok=True)
        for source in (path, path.with_suffix(".toml")):
            if source.is_file():
                shutil.copyfile(source, copy.parent / source.name)
    return OpenedData(path, sha256, copy if copy.is_file() and _sha256(copy) == sha256 else None)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
