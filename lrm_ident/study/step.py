"""Step of an identification: a fit, and how it was made."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_ident.diagnosis.evidence import NO_EVIDENCE, Evidence
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.parameter_sets import Bounds
from lrm_ident.fitting.priors import Prior
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_math.model.model import Model
from lrm_math.model.step_name import StepName


@dataclass(frozen=True, eq=False)
class StudyStep:
    """A step that was taken.

    Attributes:
        name: as in the history of the model file; None for a step without an entry.
        fit: of the model after it.
        start: the model before it; None for a first fit.
        bounds: of the fit and its cross-validation; None: those that the effects state.
        stated_prior: prior of the fit, if one was stated. prior_name: its name, as in a model file; None: that of the
            fit's own prior.
        held_out: held-out residual, where it is known already.
        evidence: for the effect that was added, if one was.
    """

    name: StepName | None
    fit: Fit
    start: Model | None = None
    bounds: Bounds | None = None
    stated_prior: Prior | None = None
    prior_name: str | None = None
    held_out: HeldOutResidual | None = None
    evidence: Evidence = NO_EVIDENCE

    @property
    def prior(self) -> Prior | None:
        """Prior of its fit, None of plain least squares: the stated one, or that of typical sizes."""
        return self.stated_prior or self.fit.stated

    @property
    def file_prior(self) -> str | None:
        """Name of that prior in a model file."""
        return self.prior_name or (None if self.prior is None else self.prior.name)
