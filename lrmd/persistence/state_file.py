"""The state file, which survives crashes and power cuts: written atomically (temporary file, fsync, rename)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError
from lrm_math.toml_file import StrictSchema

HOTTEST = 300.0
"""degC: higher modelled temperatures are stored as this one."""


class StoredState(StrictSchema):
    """The state file, schema `lrm/state/1`: last commanded pulse (ns) and modelled temperature of each servo.

    `still`: no motion was under way when it was written, so the pulses are the arm's final position. `arm`, `identity`:
    name and `arm_identity` of the arm that they are of, empty in files of older releases. `payload_kg`: its load.
    """

    schema_: Literal["lrm/state/1"] = Field(default="lrm/state/1", alias="schema")
    saved_wall_ns: int
    boots: Annotated[int, Field(ge=0)]
    arm: str = ""
    identity: str = ""
    mode: str
    still: bool
    pulse_ns: dict[str, Annotated[int, Field(ge=0, le=20_000_000)]]
    payload_kg: Annotated[float, Field(ge=0, le=2)] = 0.0
    temperature_c: dict[str, Annotated[float, Field(ge=-50, le=HOTTEST)]]


NAME = "state.json"


def save(folder: Path, state: StoredState) -> None:
    """Writes the state atomically: a power cut leaves the old or the new file. Raises `FileError`."""
    write_atomically(folder / NAME, state.model_dump_json(by_alias=True, indent=1).encode())


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


def set_aside(folder: Path, suffix: str = ".damaged") -> Path:
    """Renames a file that cannot be used, for inspection. Returns its new path."""
    path = folder / NAME
    aside = path.with_suffix(suffix)
    os.replace(path, aside)
    return aside
