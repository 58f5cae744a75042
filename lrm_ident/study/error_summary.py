"""Errors of a model on a data set: of the nominal arm, in the fit, held out."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_ident.data.error_stats import ErrorStats
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.residual.predictability import PredictableError


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of a model beside the nominal arm's, in the fit and held out."""

    nominal: ErrorStats
    fitted: ErrorStats
    held_out: HeldOutResidual
    nameless: PredictableError | None = None

    def as_json(self) -> dict[str, object]:
        """The table `error`."""
        reason = {} if self.held_out.error else {"held_out_reason": self.held_out.reason}
        nameless = {} if self.nameless is None else {"nameless": self.nameless}
        return {"nominal": self.nominal, "fit": self.fitted, "held_out": self.held_out.error, **reason, **nameless}
