"""Atomic writing of a file: a power cut leaves the old or the new one, whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from lrm_math.errors import FileError


def write_atomically(path: Path, content: bytes, check: Callable[[Path], object] = lambda _: None) -> None:
    """Temporary file beside the one that `path` leads to, fsync, rename, fsync of the folder; the mode of a file that
    was there stays.

    `check` sees the temporary file and may raise, which leaves everything as it was. Raises `FileError`.
    """
    try:
        _write(Path(os.path.realpath(path)), content, check)  # unlike `resolve`, of links in a circle, too
    except OSError as error:
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None


def _write(path: Path, content: bytes, check: Callable[[Path], object]) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        check(temporary)
        if path.exists():
            temporary.chmod(path.stat().st_mode & 0o777)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
