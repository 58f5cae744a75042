"""The identified model that the daemon uses: loaded from its file and checked against the arm."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arm.arm_file import arm_of, load_arm, shipped_arms
from lrm_math.effects import compensable
from lrm_math.errors import FileError
from lrm_math.model.covariance import Covariance
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import FIT_AGAIN, ModelFile, arm_mismatch, covariance_of, to_model
from lrm_math.model.uncertainty import FieldCoverage, field_coverage
from lrm_math.toml_file import bounded_content, read_toml
from lrmd.config import Config
from lrmd.ik.tip_movement import TipMovement
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind
from lrmd.ramp.shared_memory import NOMINAL


@dataclass(frozen=True, eq=False)
class DeployedModel:
    """A model and its source.

    `sha256`: of the file, empty for the nominal arm. `left_out`: ids of its effects that cannot be compensated online.
    `moved`: how far the tip moves against the model before; None where that was not asked. `residual`: RMS error that
    the model left at the poses of its fit (m), 0 where that is not known.
    """

    model: Model
    covariance: Covariance | None
    path: str
    sha256: str
    left_out: tuple[str, ...]
    moved: TipMovement | None = None
    residual: float = 0.0

    @property
    def digest(self) -> bytes:
        """SHA-256 that the processes compare, or `shared_memory.NOMINAL`."""
        return self.sha256.encode() or NOMINAL

    @property
    def uncompensated(self) -> tuple[str, ...]:
        """Those of `left_out` of which something never counts, not even where it is known since when the arm has power,
        and what it did before."""
        state = self.model.state
        followed = set() if state is None else {*state.warming, *state.memory}
        never = {effect.id for effect in self.model.effects if effect.name not in followed}
        return tuple(name for name in self.left_out if name in never)

    @cached_property
    def field(self) -> FieldCoverage | None:
        """Coverage of the reach by its residual field; None without one."""
        return field_coverage(self.model, self.covariance)


def deploy(config: Config) -> DeployedModel:
    """The model in use: the last one deployed, that of the configuration, or the nominal arm. Raises `FileError`."""
    return deploy_file(config, DeployedVersions.of(config, ModelKind.POSES).in_use)


def deploy_file(config: Config, path: Path | None) -> DeployedModel:
    """The model of a file, the nominal arm without one. Raises `FileError`."""
    if path is None:
        return DeployedModel(model_of(config.arm, ()), None, "nominal", "", ())
    content = _content(path)
    tables = read_toml(path, ModelFile)
    over_zenoh = DeployedVersions.of(config, ModelKind.POSES).holds(path)
    arm = named_arm(config, path, tables.arm) if over_zenoh else arm_of(path, tables.arm)
    _check_arm(config, path, tables, arm)
    if over_zenoh:
        tables = tables.model_copy(update={"provenance": None})
    model = to_model(path, tables, arm)
    covariance = covariance_of(path, tables, model)
    if _content(path) != content:
        raise FileError(path, "model", "changed while it was read", "write it whole, then load it again")
    left_out = tuple(sorted({e.id for e in model.effects if not compensable(e)}))
    digest = hashlib.sha256(content).hexdigest()
    return DeployedModel(model, covariance, str(path), digest, left_out, residual=tables.residual)


def _check_arm(config: Config, path: Path, tables: ModelFile, arm: Arm) -> None:
    """Raises `FileError`: the arm of a model is not the daemon's, or not as it was when the model was fitted."""
    if arm.name != config.arm.name:
        here = f"this daemon drives {config.arm.name} (the same arm elsewhere: lrm-ident transfer)"
        raise FileError(path, "arm", f"a model of {arm.name}", here)
    if arm_sha256(arm) != arm_sha256(config.arm):
        words = f"a model of another {arm.name}: {WHAT_COUNTS} differ from those of this daemon's arm file"
        raise FileError(path, "arm", words, FIT_AGAIN)
    if words := arm_mismatch(tables, arm):
        raise FileError(path, "arm", words, FIT_AGAIN)


def named_arm(config: Config, path: Path, name: str) -> Arm:
    """The arm of a text that came over zenoh: a path would tell its sender which files exist. Raises `FileError`."""
    if name == config.arm.name:
        return config.arm
    if name not in shipped_arms():
        raise FileError(
            path, "arm", f"{name[:64]!r} is no arm of this daemon's", f"this daemon drives {config.arm.name}"
        )
    return load_arm(name)


def digest_of(config: Config) -> bytes:
    """Present digest of the model file in use. Raises `FileError`."""
    path = DeployedVersions.of(config, ModelKind.POSES).in_use
    return NOMINAL if path is None else content_sha256(path).encode()


def content_sha256(path: Path) -> str:
    """SHA-256 of a model file. Raises `FileError`."""
    return hashlib.sha256(_content(path)).hexdigest()


def _content(path: Path) -> bytes:
    try:
        return bounded_content(path)
    except OSError as error:
        raise FileError(path, "model", error.strerror or "cannot be read") from None
