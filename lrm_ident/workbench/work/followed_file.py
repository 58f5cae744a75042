"""A file of measurements that is being written: its whole lines so far, copied whenever it has grown."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from lrm_math.errors import FileError

LOOK_S = 0.5


@dataclass
class FollowedFile:
    """A growing CSV. `copy`: where its whole lines are, with the metadata beside it; `size` bytes of it are there."""

    source: Path
    copy: Path
    size: int = -1
    looked: float = 0.0

    def grown(self) -> bool:
        """Whether it has changed; then the copy is new. Raises `FileError` if it is gone."""
        now = time.monotonic()
        if now - self.looked < LOOK_S:
            return False
        self.looked = now
        try:
            content = self.source.read_bytes()
        except OSError as error:
            raise FileError(self.source, "", f"cannot be followed any longer ({error.strerror})") from None
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) == self.size or whole.count(b"\n") < 2:
            return False
        self.size = len(whole)
        self.copy.write_bytes(whole)
        beside = self.source.with_suffix(".toml")
        if beside.is_file():
            shutil.copyfile(beside, self.copy.with_suffix(".toml"))
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
