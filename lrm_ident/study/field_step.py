"""Step that adds a residual field, where cross-validation shows that the model predicts better with it.

Random folds show whether it improves the prediction of new poses of the same kind. A block of joint space lies outside
the other poses, where a field fades: there it only has to do no harm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.cross_validation import held_out_blocks, random_folds
from lrm_ident.fitting.field.fit import blocks_with_field, check_positions, fit_with_field
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import Loss
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.better_prediction import predicts_better
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.residual.thresholds import MIN_GAIN, MIN_NAMELESS_GAIN
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.model.step_name import ADD, StepName


class NoBetterPrediction(LrmError):
    """Refusal of a residual field, since the model does not significantly predict better with it."""


def field_step(model: Model, data: Measurements, loss: Loss, prior: Prior | None, progress: OnProgress) -> Step:
    """The step from a model without a field to one with it.

    Raises:
        NoBetterPrediction: in random folds the held-out error does not fall significantly by `MIN_NAMELESS_GAIN`, or in
            blocks of joint space it rises significantly by `MIN_GAIN`.
        LrmError: poses without a position, too few of them, or a fold that does not converge.
    """
    check_positions(data)
    field = ResidualField(model.arm, "tool")

    def held_out(fold: NDArray[np.int64] | None) -> tuple[Array, tuple[HeldOutBlock, ...]]:
        """(N, 3), held-out residual without the field (m); blocks with it."""
        without = held_out_blocks(model, data, loss=loss, progress=progress, prior=prior, fold=fold)
        return held_out_residual(without), blocks_with_field(field, data, without)

    before, blocks = held_out(random_folds(data.poses.q, data.repeat_of))
    after = held_out_residual(blocks)
    if not predicts_better(_squares(after), _squares(before), MIN_NAMELESS_GAIN):
        raise NoBetterPrediction(f"no residual field: it does not surely predict better ({_words(before, after)})")
    before, blocks = held_out(None)
    after = held_out_residual(blocks)
    if predicts_better(_squares(before), _squares(after), MIN_GAIN):
        raise NoBetterPrediction(f"no residual field: beside the poses it predicts worse ({_words(before, after)})")
    fitted = fit_with_field(fit(model, data, loss=loss, prior=prior), data)
    return Step(
        StepName(ADD, field.name),
        fitted,
        data,
        start=model,
        stated_prior=prior,
        held_out=HeldOutResidual.of(fitted.model, data, blocks, loss, prior),
    )


def _squares(residual: Array) -> Array:
    """(N,), squared distances of a residual (N, 3)."""
    return np.asarray((residual**2).sum(axis=1))


def _words(before: Array, after: Array) -> str:
    return f"{in_mm(error_stats(before).rms)} mm held out, {in_mm(error_stats(after).rms)} mm with it"
