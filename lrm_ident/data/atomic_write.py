"""Atomic file writing."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from lrm_math.errors import FileError


def write_text(path: Path, text: str) -> None:
    """Writes to a temporary file beside `path` and renames it. Raises `FileError` if that cannot be done."""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None
