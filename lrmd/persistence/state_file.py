"""The state file, which survives crashes and power cuts: written atomically (temporary file, fsync, rename)."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.errors import FileError
from lrm_math.toml_file import StrictSchema


class StoredState(StrictSchema):
    """The state file, schema `lrm/state/1`: last commanded pulse (ns) and modelled temperature of each servo.

    `still`: no motion was under way when it was written, so the pulses are the arm's final position.
    """

    schema_: Literal["lrm/state/1"] = Field(default="lrm/state/1", alias="schema")
    saved_wall_ns: int
    boots: Annotated[int, Field(ge=0)]
    mode: str
    still: bool
    pulse_ns: dict[str, Annotated[int, Field(ge=0, le=20_000_000)]]
    temperature_c: dict[str, Annotated[float, Field(ge=-50, le=300)]]


NAME = "state.json"


def save(folder: Path, state: StoredState) -> None:
    """Writes the state atomically: a power cut leaves the old or the new file. Raises `FileError`."""
    path = folder / NAME
    temporary = ""
    try:
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=".state.")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(state.model_dump_json(by_alias=True, indent=1))
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        directory = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None


def load(folder: Path) -> StoredState | None:
    """The stored state, or None if there is none. Raises `FileError` if the file is damaged."""
    path = folder / NAME
    try:
        return StoredState.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileError(path, "", f"cannot be read ({error.strerror})") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FileError(path, ".".join(map(str, first["loc"])), f"is damaged ({first['msg']})") from None


def set_aside(folder: Path) -> Path:
    """Renames a damaged file, for inspection. Returns its new path."""
    path = folder / NAME
    damaged = path.with_suffix(".damaged")
    os.replace(path, damaged)
    return damaged
