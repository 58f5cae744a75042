"""Versions of the model that were deployed over zenoh: files in `models/` of the state directory, and which are on top.

`deployed.json` is a stack: a deployment puts a version on it, an undo takes the last one off. The model in use is the
one on top, or that of the configuration while the stack is empty. Files of versions stay, for the record.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.errors import FileError
from lrm_math.toml_file import StrictSchema
from lrmd.config import Config

FOLDER, STACK = "models", "deployed.json"
VersionName = Annotated[str, Field(pattern=r"^\d{4,9}-[0-9a-f]{12}\.toml$")]


class DeployedStack(StrictSchema):
    """`deployed.json`, schema `lrm/deployed/1`: names of the version files, the one in use last."""

    schema_: Literal["lrm/deployed/1"] = Field(default="lrm/deployed/1", alias="schema")
    versions: tuple[VersionName, ...] = ()


def load_stack(state: Path) -> DeployedStack:
    """The stack in a state directory, empty if nothing was deployed yet. Raises `FileError` if it is damaged."""
    path = state / FOLDER / STACK
    try:
        return DeployedStack.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return DeployedStack()
    except OSError as error:
        raise FileError(path, "", f"cannot be read ({error.strerror})") from None
    except ValidationError:
        raise FileError(path, "", "is damaged; without it the model of the configuration is used") from None


def model_in_use(config: Config, stack: DeployedStack) -> Path | None:
    """The model file on top of a stack, else that of the configuration; None: the nominal arm."""
    return config.state / FOLDER / stack.versions[-1] if stack.versions else config.model


def active_model(config: Config) -> Path | None:
    """The model file in use; None: the nominal arm. Raises `FileError`."""
    return model_in_use(config, load_stack(config.state))


def write_version(state: Path, text: str) -> Path:
    """Writes a model's text as a new version, which is not in use yet. Raises `FileError`."""
    folder, content = state / FOLDER, text.encode()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = 1 + max((int(path.name.partition("-")[0]) for path in folder.glob("[0-9]*-*.toml")), default=0)
        path = folder / f"{number:04d}-{hashlib.sha256(content).hexdigest()[:12]}.toml"
        _write(path, content)
    except OSError as error:
        raise FileError(folder, "", f"cannot be written ({error.strerror})") from None
    return path


def save_stack(state: Path, stack: DeployedStack) -> None:
    """Writes the stack atomically: a power cut leaves the old or the new one. Raises `FileError`."""
    path = state / FOLDER / STACK
    try:
        _write(path, stack.model_dump_json(by_alias=True).encode())
    except OSError as error:
        raise FileError(path, "", f"cannot be written ({error.strerror})") from None


def _write(path: Path, content: bytes) -> None:
    """Temporary file, fsync, rename, fsync of the directory."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        Path(temporary).unlink(missing_ok=True)
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
