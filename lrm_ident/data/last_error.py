"""The last error of the commands, kept for `lrm-ident report-bug` in the folder of what programs of a user keep."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from traceback import extract_tb

OWN = ("lrm_ident", "lrm_math", "lrmd")


def user_state() -> Path:
    """The tool's part of what programs of a user keep between runs (XDG Base Directory Specification)."""
    given = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(given) if given else Path.home() / ".local" / "state") / "lrm-ident"


def note_error(error: Exception, words: Sequence[str] = ()) -> None:
    """Keeps an error, readable by its owner alone; a folder that takes no file is no second error.

    Args:
        words: of the command; default: those of this process. Of paths only the file's name is kept.
    """
    command = " ".join(_file_name(word) for word in words or ("lrm-ident", *sys.argv[1:]))
    lines = [time.strftime("%Y-%m-%d %H:%M:%S"), command, f"{type(error).__name__}: {_shown(error)}", *places(error)]
    file = user_state() / "last-error.txt"
    with suppress(OSError, RuntimeError):  # a user without a home
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        file.chmod(0o600)


def last_error() -> tuple[str, ...]:
    """The lines that were kept; none if there was no error."""
    with suppress(OSError, RuntimeError, UnicodeDecodeError):
        return tuple((user_state() / "last-error.txt").read_text(encoding="utf-8").splitlines())
    return ()


def places(error: Exception) -> list[str]:
    """Lines of the project's code where an error came up, outermost first, without the machine's own paths."""
    frames = []
    for frame in extract_tb(error.__traceback__):
        parts = Path(frame.filename).parts
        start = next((len(parts) - 1 - parts[::-1].index(package) for package in OWN if package in parts), None)
        if start is not None:
            frames.append(f"  {'/'.join(parts[start:])}:{frame.lineno} {frame.name}")
    return frames


def _file_name(word: str) -> str:
    return Path(word).name if os.sep in word else word


def _shown(error: Exception) -> str:
    """The message, with the folders of its paths left out."""
    return " ".join(_file_name(word) for word in str(error).split())
