"""The stored state at a start: set aside, with an event, if it is damaged or of another arm."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from lrm_math.errors import FileError
from lrmd.config import Config
from lrmd.persistence import state_file
from lrmd.persistence.arm_identity import of_this_arm

Emit = Callable[[str, Literal["error"], str], object]
"""Called with an event's code, level and text."""


def restored_state(config: Config, emit: Emit) -> state_file.StoredState | None:
    """The state that the daemon left, or None if there is none that can be used."""
    folder = config.state
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stored = state_file.load(folder)
    except FileError as error:
        emit("state_damaged", "error", f"{error}; it is set aside, and the pose is unknown")
        _set_aside(folder, ".damaged", emit)
        return None
    except OSError as error:
        emit("state_not_saved", "error", f"{folder}: {error.strerror}")
        return None
    if stored is None:
        return None
    stored, why_not = of_this_arm(stored, config)
    if why_not:
        where = folder / state_file.NAME
        emit("state_foreign", "error", f"{where}: {why_not}; it is set aside, and the pose is unknown")
        _set_aside(folder, ".foreign", emit)
    return stored


def _set_aside(folder: Path, suffix: str, emit: Emit) -> None:
    try:
        state_file.set_aside(folder, suffix)
    except OSError as fault:
        emit("state_not_saved", "error", f"it cannot be set aside either ({fault.strerror})")
