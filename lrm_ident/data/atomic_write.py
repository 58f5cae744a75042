"""Atomic file writing."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from lrm_math.errors import FileError


def write_text(path: Path, text: str) -> None:
    """Writes text in UTF-8 as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Writes to a temporary file beside the file that `path` leads to, and renames it.

    Raises `FileError` if that cannot be done.
    """
    target = path.resolve()
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None
