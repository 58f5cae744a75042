"""Model files and measurements, read and checked as every command does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.data.measurement_file.metadata import metadata_of
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.anchor import with_anchor
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.fitting.effect_plugins import Catalogue, catalogue_with, file_of, sha256_of
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.loss import SQUARED, Loss, loss_named
from lrm_ident.study.model_history import fit_words
from lrm_math.arm.arm import Arm
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, arm_of, to_model
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import read_toml

OnNotice = Callable[[str], object]
"""Called with what a person should know of a file, one line each."""


@dataclass(frozen=True, eq=False)
class ModelInputs:
    """A model file as it stands, its model, measurements of its arm read as those of its fit, the known effects."""

    file: ModelFile
    model: Model
    data: Measurements
    catalogue: Catalogue

    @property
    def loss(self) -> Loss:
        """The loss of the model's last fit; least squares where the file does not say."""
        return loss_of(self.file)


def loss_of(file: ModelFile) -> Loss:
    """The loss of a model's last fit; least squares where the file does not say."""
    return SQUARED if file.provenance is None else loss_named(file.provenance.loss)


def read_model(path: Path, catalogue: Catalogue, notice: OnNotice) -> tuple[ModelFile, Model]:
    """A model file, as it stands and as a model; a notice if its own effects have changed since it was fitted."""
    file = read_toml(path, ModelFile)
    model = to_model(path, file, arm_of(path, file.arm), catalogue)
    own, known = file_of(model.effects), file.provenance
    if own and known and known.effects_sha256 not in (None, sha256_of(own)):
        notice(f"{own} is not the file that {path.name} was fitted with (its SHA-256 differs)")
    return file, model


def read_measurements(
    path: Path, arm: Arm, arm_name: str, notice: OnNotice, reading: Reading = AS_NAMED, usual: Reading | None = None
) -> Measurements:
    """Measurements that the arm can have made.

    Args:
        reading: how the numbers are read; where it and the file beside them say nothing, as `usual` says.
    """
    data = load_checked(path, arm, reading, usual)
    for words in data.notices:
        notice(f"{path.name}: {words}")
    metadata = metadata_of(path)
    if metadata and metadata.arm and metadata.arm != arm_name:
        notice(f"{path.name} was measured on {metadata.arm}, the model is of {arm_name}")
    return data


def read_inputs(
    model: Path, data: Path, effects_file: Path | None, notice: OnNotice, reading: Reading = AS_NAMED
) -> ModelInputs:
    """A model file and measurements of its arm, read as those of its fit."""
    catalogue = catalogue_with(effects_file)
    file, loaded = read_model(model, catalogue, notice)
    usual = None if file.provenance is None else file.provenance.reading
    measured = read_measurements(data, loaded.arm, file.arm, notice, reading, usual)
    data_used = as_fitted(file, measured, notice)
    return ModelInputs(file, with_anchor(loaded, data_used), data_used, catalogue)


def as_fitted(file: ModelFile, measured: Measurements, notice: OnNotice) -> Measurements:
    """Measurements without those that the model's fit left out, if they are the same."""
    known = file.provenance
    if known is None:
        return measured
    if known.data_sha256 == measured.sha256:
        measured = measured.without(known.left_out)
    if how := fit_words(known.loss, measured.left_out):
        notice(f"as in the model's fit: {how}")
    return measured


def identifiable(inputs: ModelInputs, notice: OnNotice) -> ModelInputs:
    """The same with a model whose free parameters the data alone identify, whatever a prior decided in the fit."""
    file, loaded, known = inputs.file, inputs.model, inputs.file.provenance
    if known is None or known.prior is None:
        return inputs
    fitted = fit_identifiable(loaded, inputs.data, loaded.free, inputs.loss).fit.model
    notice(
        f"the model was fitted with the prior '{known.prior}'; this goes on with the "
        f"{len(fitted.free)} of its {len(loaded.free)} parameters that the data can tell without it"
    )
    return ModelInputs(file, fitted, inputs.data, inputs.catalogue)
