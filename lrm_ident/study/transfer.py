"""Transfer of a calibrated arm to another installation, as the command, the API and a study take it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.transfer import TransferredModel, transferred
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.inputs import read_model
from lrm_ident.study.model_history import as_written, model_file, write_model
from lrm_ident.study.notices import Notice
from lrm_ident.study.tool_version import tool_version
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import arm_of, load_arm
from lrm_math.effects import CATALOGUE
from lrm_math.errors import FileError, LrmError
from lrm_math.model.covariance import Covariance, covariance_table
from lrm_math.model.deployed_model import FIT_STATE, unknown_state
from lrm_math.model.model import Model
from lrm_math.model.model_file import (
    FIT_AGAIN,
    SCHEMA,
    ModelFile,
    arm_mismatch,
    covariance_of,
    model_tables,
)
from lrm_math.model.step_name import TRANSFER, StepName
from lrm_math.model.uncertainty import expected_tip_error

AXES = 3


@dataclass(frozen=True, eq=False)
class Transfer:
    """A calibrated arm in another installation.

    Attributes:
        start: its model before anything was measured there.
        arm: name or path of the target arm, as in a model file.
        source: the model file of the bench.
        data: the few poses that were measured there. fit: to them, with the arm's part as prior. None: none were.
    """

    start: TransferredModel
    arm: str
    source: ModelFile
    data: Measurements | None = None
    fit: Fit | None = None

    @property
    def model(self) -> Model:
        """The model of the arm in its new installation."""
        return as_written(self.start.model if self.fit is None else self.fit.model, self.arm)

    @property
    def covariance(self) -> Covariance:
        """Covariance of its parameters."""
        return self.start.covariance if self.fit is None else Covariance(self.fit.model.free, self.fit.covariance)

    @property
    def bench_error(self) -> float:
        """RMS error (m) that the model left on the bench; that of the noise where its file has no history."""
        return math.sqrt(AXES) * (remaining_error(self.source) if self.source.history else self.start.noise)

    @cached_property
    def expected_tip_error(self) -> float:
        """RMS error of the tip (m) that is expected over the arm's range, as far as the parameters go."""
        return expected_tip_error(self.start.model if self.fit is None else self.fit.model, self.covariance)

    @cached_property
    def file(self) -> ModelFile:
        """The model file. Its history begins with the transfer, if poses were measured."""
        if self.fit is not None and self.data is not None:
            unknown = HeldOutResidual(None)
            return model_file(self.fit, self.data, unknown, self.arm, StepName(TRANSFER, self.start.bench))
        model, covariance = self.start.model, self.covariance
        units = np.array([model.parameter(key).si for key in covariance.keys])
        errors = np.sqrt(np.diag(covariance.matrix)) / units
        date, before = datetime.now(UTC).isoformat(timespec="seconds"), self.source.provenance
        changes = {"arm_sha256": arm_sha256(model.arm), "tool": tool_version(), "date": date, "reading": None}
        return ModelFile(
            schema=SCHEMA,
            arm=self.arm,
            sigma=dict(zip(covariance.keys, errors.tolist(), strict=True)),
            covariance=covariance_table(covariance.keys, covariance.matrix),
            **model_tables(model),
            provenance=None if before is None else before.model_copy(update=changes),
        )

    def save(self, path: str | Path) -> None:
        """Writes the model file, which the command line and the daemon read. Raises `FileError`."""
        write_model(Path(path), self.file, self.arm)


def read_transfer(
    path: Path, to: str, catalogue: Catalogue = CATALOGUE, noise: float | None = None
) -> tuple[Transfer, tuple[Notice, ...]]:
    """The transfer of a model file to an arm (name or path of an arm file), and notices.

    `noise`: standard deviation per axis (m) of what is measured there; poses weigh by it, or by the error that the
    model left on the bench if that is larger; None: by that.

    Raises `FileError`: no valid files, an arm that has changed since the fit, or a model without standard errors.
    `LrmError`: another arm.
    """
    file, model, notices = read_model(path, catalogue)
    if words := arm_mismatch(file, arm_of(path, file.arm)):
        raise FileError(path, "arm", words, FIT_AGAIN)
    return transfer_of(file, model, covariance_of(path, file, model), to, noise), notices


def transfer_of(
    file: ModelFile, model: Model, covariance: Covariance | None, to: str, noise: float | None = None
) -> Transfer:
    """The transfer of a model with the covariance of its parameters; arguments as of `read_transfer`."""
    if words := unknown_state(model):
        raise LrmError(f"{words}; {FIT_STATE}")
    if covariance is None:
        raise LrmError("the model has no [covariance]: how sure its parameters are is not known; fit it again")
    weigh = max(noise or 0.0, remaining_error(file)) if file.history or noise is None else noise
    return Transfer(transferred(model, covariance, load_arm(to), weigh), to, file)


def identified(transfer: Transfer, data: Measurements) -> Transfer:
    """The transfer with the installation identified from poses measured there (maximum a posteriori).

    Raises `LrmError`: no convergence, or an arm that shrinks, stretches or loses a length.
    """
    start = transfer.start
    fitted = fit(with_set_up(start.model, data), data, prior=start.prior)
    return replace(transfer, data=data, fit=fitted)


def remaining_error(file: ModelFile) -> float:
    """Error that a model left in its measurements, standard deviation per axis (m): as deployed, else held out, else in
    the fit. Raises `LrmError` if the file does not say."""
    if not file.history:
        raise LrmError("the model file has no [[history]], so its error is not known; state it with --noise-mm")
    last = file.history[-1]
    rms: Sequence[float | None] = (last.deployed_rms_mm, last.held_out_rms_mm, last.fit_rms_mm)
    return next(error for error in rms if error is not None) * 1e-3 / math.sqrt(AXES)
