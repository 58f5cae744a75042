"""Step of an identification: a fit, how it was made, and what speaks for the effect that it added."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.evidence import NO_EVIDENCE, Evidence
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.parameter_sets import Bounds
from lrm_ident.fitting.priors import Prior
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_math.effects import effect_of
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.model.step_name import StepName


@dataclass(frozen=True, eq=False)
class Step:
    """A step that was taken: by `fit`, `add` and their like, or one of `auto`.

    Attributes:
        name: as in the history of the model file; None for a step without an entry, such as the start of `auto`.
        fit: of the model after it.
        data: the measurements that were fitted, outliers left out.
        start: the model before it; None for a first fit.
        bounds: of the fit and its cross-validation; None: those that the effects state.
        stated_prior: prior of the fit, if one was stated. prior_name: its name, as in a model file; None: that of the
            fit's own prior.
        held_out: held-out residual, where it is known already, as it is in every step of `auto`.
        evidence: for the effect that was added, if one was.
    """

    name: StepName | None
    fit: Fit
    data: Measurements
    start: Model | None = None
    bounds: Bounds | None = None
    stated_prior: Prior | None = None
    prior_name: str | None = None
    held_out: HeldOutResidual | None = None
    evidence: Evidence = NO_EVIDENCE

    @property
    def added(self) -> str:
        """The effect that was added (`id@place`), "" where none was."""
        return "" if self.name is None else self.name.added

    @property
    def names(self) -> tuple[str, ...]:
        """Causes that it can stand for (`effect@place`): the effects that a form refines, or itself; and its class."""
        return (*(self.evidence.refines or (self.added,)), *self.evidence.equivalent)

    @property
    def freed(self) -> tuple[str, ...]:
        """Keys of base parameters that became identifiable with the effect."""
        before = self.fit.model.free if self.start is None else self.start.free
        return tuple(key for key in self.fit.model.free if key not in before and effect_of(key) != self.added)

    @property
    def held_out_rms(self) -> float:
        """RMS of the held-out residual (m). Raises `LrmError` where it is not known yet."""
        if self.held_out is None or self.held_out.residual is None:
            raise LrmError("the held-out error of this step is not known")
        return error_stats(self.held_out.residual).rms

    @property
    def prior(self) -> Prior | None:
        """Prior of its fit, None of plain least squares: the stated one, or that of typical sizes."""
        return self.stated_prior or self.fit.stated

    @property
    def file_prior(self) -> str | None:
        """Name of that prior in a model file."""
        return self.prior_name or (None if self.prior is None else self.prior.name)
