"""The model that the daemon works with: loaded whole and checked, or not at all."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from lrm_math.covariance import Covariance
from lrm_math.errors import FileError
from lrm_math.model import Model, model_of
from lrm_math.model_file import load_covariance, load_model
from lrmd.config import Config


@dataclass(frozen=True, eq=False)
class Deployed:
    """A model and what it was read from. `left_out`: ids of its effects that no rover can compensate."""

    model: Model
    covariance: Covariance | None
    path: str
    sha256: str
    left_out: tuple[str, ...]


def deploy(config: Config) -> Deployed:
    """The model of the configuration, or the nominal arm if it names none.

    Raises:
        FileError: the file is not a model, or is one of another arm.
    """
    if config.model is None:
        return Deployed(model_of(config.arm, ()), None, "nominal", "", ())
    return _from_file(config, config.model)


def _from_file(config: Config, path: Path) -> Deployed:
    model = load_model(path)
    if model.arm.name != config.arm.name:
        raise FileError(path, "arm", f"a model of {model.arm.name}", f"this daemon drives {config.arm.name}")
    left_out = tuple(sorted({e.id for e in model.effects if not e.online and e.id != "quantisation"}))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Deployed(model, load_covariance(path), str(path), digest, left_out)
