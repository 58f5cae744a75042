"""The model that the daemon works with: loaded whole and checked, or not at all."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from lrm_math.errors import FileError
from lrm_math.model.covariance import Covariance
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_covariance, load_model
from lrmd.config import Config
from lrmd.ramp.shared_memory import NOMINAL


@dataclass(frozen=True, eq=False)
class Deployed:
    """A model and what it was read from.

    `sha256`: of the file, empty for the nominal arm. `left_out`: ids of its effects that no rover can compensate.
    """

    model: Model
    covariance: Covariance | None
    path: str
    sha256: str
    left_out: tuple[str, ...]

    @property
    def digest(self) -> bytes:
        """What the processes compare, see `mailbox.NOMINAL`."""
        return bytes.fromhex(self.sha256) if self.sha256 else NOMINAL


def deploy(config: Config) -> Deployed:
    """The model of the configuration, or the nominal arm if it names none.

    Raises:
        FileError: the file is not a model, or is one of another arm.
    """
    if config.model is None:
        return Deployed(model_of(config.arm, ()), None, "nominal", "", ())
    return _from_file(config, config.model)


def digest_of(config: Config) -> bytes:
    """Digest of the configured model file as it is now. Raises `FileError`."""
    return NOMINAL if config.model is None else hashlib.sha256(_content(config.model)).digest()


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileError(path, "model", error.strerror or "cannot be read") from None


def _from_file(config: Config, path: Path) -> Deployed:
    content = _content(path)
    model, covariance = load_model(path), load_covariance(path)
    if _content(path) != content:
        raise FileError(path, "model", "changed while it was read", "write it whole, then load it again")
    if model.arm.name != config.arm.name:
        raise FileError(path, "arm", f"a model of {model.arm.name}", f"this daemon drives {config.arm.name}")
    left_out = tuple(sorted({e.id for e in model.effects if not e.online and e.id != "quantisation"}))
    return Deployed(model, covariance, str(path), hashlib.sha256(content).hexdigest(), left_out)
