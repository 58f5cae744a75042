"""Versions of the model that were deployed over zenoh: files in `models/` of the state directory, and which are on top.

`deployed.json` is a stack: a deployment puts a version on it, an undo takes the last one off. The model in use is the
one on top, or that of the configuration while the stack is empty. The last `KEPT` files of versions stay, for the
record; those in the stack are among them, so the stack forgets its oldest ones.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError, LrmError
from lrm_math.toml_file import StrictSchema
from lrmd.config import Config

FOLDER, STACK = "models", "deployed.json"
KEPT = 10
"""Files of versions, and versions to which an undo goes back, the one in use among them."""
PATTERN = r"^\d{4,9}-[0-9a-f]{12}\.toml$"
VersionName = Annotated[str, Field(pattern=PATTERN)]


class DeployedStack(StrictSchema):
    """`deployed.json`, schema `lrm/deployed/1`: names of the version files, the one in use last."""

    schema_: Literal["lrm/deployed/1"] = Field(default="lrm/deployed/1", alias="schema")
    versions: tuple[VersionName, ...] = ()

    def with_version(self, name: str) -> DeployedStack:
        """The stack with a version on top, without its oldest one if there are more than `KEPT`."""
        return DeployedStack(versions=(*self.versions, name)[-KEPT:])


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


def was_deployed(config: Config, path: Path) -> bool:
    """Whether a file is a version that came over zenoh, not one of the administrator's."""
    return path.parent == config.state / FOLDER


def _versions(folder: Path) -> list[Path]:
    """Files of versions, the oldest first."""
    found = [path for path in folder.iterdir() if re.match(PATTERN, path.name)]
    return sorted(found, key=lambda path: _number(path.name))


def _number(name: str) -> int:
    return int(name.partition("-")[0])


def prune(state: Path) -> None:
    """Deletes the oldest files of versions beyond `KEPT` that are not in the stack. Raises `FileError`."""
    in_use, files = set(load_stack(state).versions), _versions(state / FOLDER)
    others = [path for path in files if path.name not in in_use]
    for path in others[: max(0, len(files) - KEPT)]:
        path.unlink(missing_ok=True)


def write_version(state: Path, text: str) -> Path:
    """Writes a model's text as a new version, which is not in use yet. Raises `FileError`."""
    folder, content = state / FOLDER, text.encode()
    try:
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        number = 1 + max((_number(path.name) for path in _versions(folder)), default=0)
    except OSError as error:
        raise FileError(folder, "", f"cannot be written ({error.strerror})") from None
    path = folder / f"{number:04d}-{hashlib.sha256(content).hexdigest()[:12]}.toml"
    write_atomically(path, content)
    return path


def undo_offline(state: Path) -> str:
    """Takes the last deployed model back without a daemon, whatever is in its file; what was done, in one line.

    A damaged stack is set aside, and the model of the configuration is in use. Raises `FileError`.
    """
    path = state / FOLDER / STACK
    try:
        stack = load_stack(state)
    except FileError:
        aside = path.with_suffix(".damaged")
        path.replace(aside)
        return f"{path} is damaged and was renamed to {aside.name}: the model of the configuration is in use"
    if not stack.versions:
        return "no deployed model is in use; the one of the configuration is"
    save_stack(state, DeployedStack(versions=stack.versions[:-1]))
    before = stack.versions[-2] if stack.versions[1:] else "the model of the configuration"
    return f"{stack.versions[-1]} was taken back; in use: {before}"


@contextmanager
def undo_named(config: Config) -> Iterator[None]:
    """Adds to the error of a deployed model how to take it back without a daemon."""
    try:
        yield
    except LrmError as error:
        if not (config.state / FOLDER / STACK).exists():
            raise
        raise LrmError(f"{error}; if that model was deployed, take it back: lrmd --config FILE --undo") from None


def save_stack(state: Path, stack: DeployedStack) -> None:
    """Writes the stack atomically: a power cut leaves the old or the new one. Raises `FileError`."""
    write_atomically(state / FOLDER / STACK, stack.model_dump_json(by_alias=True).encode())
