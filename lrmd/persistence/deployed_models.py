"""Versions of a model that were deployed over zenoh: files in a folder of the state directory, and which are on top.

`deployed.json` is a stack: a deployment puts a version on it, an undo takes the last one off. The model in use is the
one on top, or that of the configuration while the stack is empty. The last `KEPT` files of versions stay, for the
record; those in the stack are among them, so the stack forgets its oldest ones. The model of poses and that of motion
have a folder and a stack each: an undo of one leaves the other.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError, LrmError
from lrm_math.toml_file import StrictSchema
from lrmd.config import Config
from lrmd.errors import RequestError

STACK = "deployed.json"
KEPT = 10
"""Files of versions, and versions to which an undo goes back, the one in use among them."""
PATTERN = r"^\d{4,9}-[0-9a-f]{12}\.toml$"
VersionName = Annotated[str, Field(pattern=PATTERN)]


class ModelKind(StrEnum):
    """What a model is of: where the arm stands, or how it moves there."""

    POSES = "model"
    MOTION = "motion"


FOLDERS = {ModelKind.POSES: "models", ModelKind.MOTION: "motion_models"}


class DeployedStack(StrictSchema):
    """`deployed.json`, schema `lrm/deployed/1`: names of the version files, the one in use last."""

    schema_: Literal["lrm/deployed/1"] = Field(default="lrm/deployed/1", alias="schema")
    versions: tuple[VersionName, ...] = ()

    def with_version(self, name: str) -> DeployedStack:
        """The stack with a version on top, without its oldest one if there are more than `KEPT`."""
        return DeployedStack(versions=(*self.versions, name)[-KEPT:])


@dataclass(frozen=True)
class DeployedVersions:
    """The versions of one kind of model in a state directory; `configured`: file of the configuration, or None."""

    state: Path
    kind: ModelKind = ModelKind.POSES
    configured: Path | None = None

    @staticmethod
    def of(config: Config, kind: ModelKind) -> DeployedVersions:
        """Those of the daemon's state directory."""
        motion = None if config.motion.model is None else Path(config.motion.model)
        return DeployedVersions(config.state, kind, motion if kind is ModelKind.MOTION else config.model)

    @property
    def folder(self) -> Path:
        """Of the files."""
        return self.state / FOLDERS[self.kind]

    @property
    def stack(self) -> DeployedStack:
        """The stack, empty if nothing was deployed yet. Raises `FileError` if it is damaged."""
        path = self.folder / STACK
        try:
            return DeployedStack.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            return DeployedStack()
        except OSError as error:
            raise FileError(path, "", f"cannot be read ({error.strerror})") from None
        except ValidationError:
            raise FileError(path, "", "is damaged; without it the model of the configuration is used") from None

    @property
    def in_use(self) -> Path | None:
        """The file on top of the stack, else that of the configuration; None: there is none. Raises `FileError`."""
        return self._top(self.stack)

    def _top(self, stack: DeployedStack) -> Path | None:
        return self.folder / stack.versions[-1] if stack.versions else self.configured

    def holds(self, path: Path) -> bool:
        """Whether a file is a version that came over zenoh, not one of the administrator's."""
        return path.parent == self.folder

    @contextmanager
    def new(self, text: str) -> Iterator[Path]:
        """A model's text as a new version, in use once the block ends; whatever ends it early, its file is gone.

        Raises `LrmError`, without that file's name: who sent the text knows it by another.
        """
        stack, path = self.stack, self.write(text)
        try:
            yield path
            self.save(stack.with_version(path.name))
        except BaseException as error:
            path.unlink(missing_ok=True)
            if str(error).startswith(own := f"{path}: "):
                raise LrmError(str(error).removeprefix(own)) from None
            raise
        self.prune()

    @contextmanager
    def undone(self) -> Iterator[Path | None]:
        """The file in use before the last deployment, in use again once the block ends. Raises `LrmError`."""
        stack = self.stack
        if not stack.versions:
            text = {
                ModelKind.POSES: "no deployed model is in use; the one of the configuration is",
                ModelKind.MOTION: "no deployed model of motion is in use",
            }
            raise RequestError("nothing_to_undo", text[self.kind])
        before = DeployedStack(versions=stack.versions[:-1])
        yield self._top(before)
        self.save(before)

    def write(self, text: str) -> Path:
        """Writes a model's text as a new version, which is not in use yet. Raises `FileError`."""
        content = text.encode()
        try:
            self.folder.mkdir(mode=0o750, parents=True, exist_ok=True)
            number = 1 + max((_number(path) for path in self._files()), default=0)
        except OSError as error:
            raise FileError(self.folder, "", f"cannot be written ({error.strerror})") from None
        path = self.folder / f"{number:04d}-{hashlib.sha256(content).hexdigest()[:12]}.toml"
        write_atomically(path, content)
        return path

    def save(self, stack: DeployedStack) -> None:
        """Writes the stack atomically: a power cut leaves the old or the new one. Raises `FileError`."""
        write_atomically(self.folder / STACK, stack.model_dump_json(by_alias=True).encode())

    def prune(self) -> None:
        """Deletes the oldest files of versions beyond `KEPT` that are not in the stack. Raises `FileError`."""
        in_use, files = set(self.stack.versions), self._files()
        others = [path for path in files if path.name not in in_use]
        for path in others[: max(0, len(files) - KEPT)]:
            path.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        """Files of versions, the oldest first."""
        return sorted((path for path in self.folder.iterdir() if re.match(PATTERN, path.name)), key=_number)

    def undo_offline(self) -> str:
        """Takes the last deployed model back without a daemon, whatever is in its file; what was done, in one line.

        A damaged stack is set aside, and the model of the configuration is in use. Raises `LrmError`.
        """
        path = self.folder / STACK
        try:
            stack = self.stack
        except FileError:
            aside = path.with_suffix(".damaged")
            path.replace(aside)
            return f"{path} is damaged and was renamed to {aside.name}: the model of the configuration is in use"
        if not stack.versions:
            return "no deployed model is in use; the one of the configuration is"
        with self.undone() as before:
            pass
        now = before.name if before is not None and self.holds(before) else "the model of the configuration"
        return f"{stack.versions[-1]} was taken back; in use: {now}"

    @contextmanager
    def undo_named(self) -> Iterator[None]:
        """Adds to the error of a deployed model how to take it back without a daemon."""
        try:
            yield
        except LrmError as error:
            if not (self.folder / STACK).exists():
                raise
            undo = "lrmd --config FILE --undo" + (" motion" if self.kind is ModelKind.MOTION else "")
            raise LrmError(f"{error}; if that model was deployed, take it back: {undo}") from None


def _number(path: Path) -> int:
    return int(path.name.partition("-")[0])
