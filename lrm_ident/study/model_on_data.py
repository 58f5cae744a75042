"""Model on measurements of its arm: how it was fitted, and its errors in the fit and held out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

from lrm_ident.data.error_stats import ErrorStats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.fitting.typical_prior import prior_of_file, typical_prior
from lrm_ident.residual.error_breakdown import (
    HeldOutResidual,
    ModelComparison,
    compare,
    compare_unseen,
    try_held_out,
)
from lrm_ident.residual.predictability import PredictableError
from lrm_math.effects import CATALOGUE
from lrm_math.errors import LrmError
from lrm_math.model.covariance import Covariance
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, covariance_of, to_model
from lrm_math.model.uncertainty import field_speaks


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of the nominal arm, of a model in its fit, held out, and together with a Gaussian process."""

    nominal: ErrorStats
    fitted: ErrorStats
    held_out: HeldOutResidual
    nameless: PredictableError | None = None


@dataclass(frozen=True, eq=False)
class ModelOnData:
    """A model on measurements of its arm.

    Attributes:
        model: its free parameters are those that the next step fits.
        data: the measurements that are fitted; `data.source.left_out`: numbers of those that are not.
        arm: name of a shipped arm or path of an arm file, as in a model file.
        catalogue: every effect that may be tried or named.
        loss: of fits.
        source: the model file that the model was read from; None if it began with a fit.
        step: the last step; None before the first.
        progress: callback of long computations.
        apart: whether the model was fitted to none of these poses, though to others of the same file.
    """

    model: Model
    data: Measurements
    arm: str
    catalogue: Catalogue = CATALOGUE
    loss: Loss = SQUARED
    source: ModelFile | None = None
    step: Step | None = None
    progress: Progress = silent
    apart: bool = False

    def compare(self) -> ModelComparison:
        """Compares the model as it is with the data: error, held-out error, and breakdown by factors.

        On poses that no fit of the model saw its error is a held-out one, and nothing is refitted.
        """
        speaks = field_speaks(self.model, self.covariance, self.data.poses.q)
        if self.unseen:
            seen = compare_unseen(self.model, self.data, partial(self.progress, "what is left to find"))
        else:
            seen = compare(self.model, self.data, partial(self.progress, "held-out error"), self.prior, self.loss)
        return replace(seen, speaks=speaks)

    @property
    def unseen(self) -> bool:
        """Whether it is known to be fitted to none of these poses: to other data, or with all of them left out."""
        provenance = None if self.source is None else self.source.provenance
        if provenance is None:
            return self.step is None and (self.apart or self.model.fitted_to not in (None, self.data.source.sha256))
        return provenance.data_sha256 != self.data.source.sha256 or {*self.data.pose.tolist()} <= {*provenance.left_out}

    @cached_property
    def covariance(self) -> Covariance | None:
        """Covariance of the parameters of the last fit; None where the model file has none."""
        if self.step is not None:
            return Covariance(self.step.fit.model.free, self.step.fit.covariance)
        if self.source is None:
            return None
        whole = to_model(self.data.source.path, self.source, self.model.arm, self.catalogue)
        stored = covariance_of(self.data.source.path, self.source, whole)
        return None if stored is None else stored.marginal(whole, self.model)

    @property
    def taken(self) -> Step:
        """The last step. Raises `LrmError` if none was taken."""
        if self.step is None:
            raise LrmError("nothing is fitted yet")
        return self.step

    @cached_property
    def prior(self) -> Prior | None:
        """Prior of the last fit; of typical sizes where no fit is known. Raises `FileError` if its file is gone."""
        if self.step is not None:
            return self.step.prior
        if self.source is None:
            return typical_prior(self.model)
        return prior_of_file(self.source, self.model, self.catalogue)

    @property
    def prior_name(self) -> str | None:
        """Name of the prior, as in a model file."""
        if self.step is not None:
            return self.step.file_prior
        provenance = None if self.source is None else self.source.provenance
        return None if provenance is None else provenance.prior

    @cached_property
    def held_out(self) -> HeldOutResidual:
        """Held-out residual of the last fit, cross-validated in blocks of neighbouring poses."""
        if self.step is not None and self.step.held_out is not None:
            return self.step.held_out
        bounds = None if self.step is None else self.step.bounds
        return try_held_out(
            self._fitted, self.data, bounds, self.loss, partial(self.progress, "held-out error"), self.prior
        )

    @cached_property
    def errors(self) -> ErrorSummary:
        """Errors of the nominal arm, of the last fit, and held out."""
        fitted = self._error_of(self.model) if self.step is None else self.data.errors(self.step.fit.equilibrium)
        return ErrorSummary(self.nominal_error, fitted, self.held_out)

    @cached_property
    def errors_before(self) -> ErrorSummary:
        """Errors of the model before the last step, on the data of that step."""
        start = self.model if self.step is None or self.step.start is None else self.step.start
        tick = partial(self.progress, "held-out error, before")
        prior = None if self.prior is None else typical_prior(start)
        held_out = try_held_out(start, self.data, loss=self.loss, progress=tick, prior=prior)
        return ErrorSummary(self.nominal_error, self._error_of(start), held_out)

    @cached_property
    def nominal_error(self) -> ErrorStats:
        """TCP error of the nominal arm."""
        return self._error_of(nominal_arm(self.model.arm, self.data))

    @property
    def _fitted(self) -> Model:
        return self.model if self.step is None else self.step.fit.model

    def _say(self, what: str) -> None:
        self.progress(what, 0, 0)

    def _error_of(self, model: Model) -> ErrorStats:
        """TCP error of a model as it is."""
        return self.data.errors(solve_equilibrium(model, self.data.poses))
