"""Reading of a file that a person named: what cannot be read is one `FileError`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lrm_math.errors import FileError


def read_content(path: Path, hint: str = "") -> bytes:
    """Content of a file. `hint`: where such a file comes from. Raises `FileError`."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise FileError(path, "", "no such file", hint) from None
    except OSError as error:
        raise FileError(path, "", f"cannot be read ({error.strerror})") from None


def read_utf8(path: Path, hint: str = "") -> str:
    """Text of a file in UTF-8. `hint`: where such a file comes from. Raises `FileError`."""
    try:
        return read_content(path, hint).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, "", f"cannot be read as text ({error})") from None


def read_json(path: Path, hint: str = "") -> Any:
    """The value in a JSON file. `hint`: where such a file comes from. Raises `FileError`."""
    text = read_utf8(path, hint)
    try:
        return json.loads(text)
    except ValueError as error:
        raise FileError(path, "", f"cannot be read as JSON ({str(error).splitlines()[0]})") from None
