"""The step that adds a residual field: only where the model predicts better with it, poses held out."""

from __future__ import annotations

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import in_mm
from lrm_ident.fitting.cross_validation import held_out_blocks
from lrm_ident.fitting.field.fit import blocks_with_field, check_positions, fit_with_field
from lrm_ident.fitting.held_out import held_out_rows
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import Loss
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.better_prediction import predicts_better
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.residual.thresholds import MIN_NAMELESS_GAIN
from lrm_ident.study.step import StudyStep
from lrm_math.effects import NOT_A_CAUSE
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.errors import LrmError
from lrm_math.model.model import Model

WHAT_IT_IS = f"{NOT_A_CAUSE}: a smooth function of the joint angles that predicts better, and explains nothing"


class NoBetterPrediction(LrmError):
    """A residual field was not added, since the model does not surely predict better with it."""


def field_step(model: Model, data: Measurements, loss: Loss, prior: Prior | None, progress: OnProgress) -> StudyStep:
    """The step from a model without a field to one with it.

    Raises:
        NoBetterPrediction: held out it does not save a share worth naming, and more than by chance.
        LrmError: poses without a position, too few of them, or a fold that does not converge.
    """
    check_positions(data)
    field = ResidualField(model.arm, "tool")
    without = held_out_blocks(model, data, loss=loss, progress=progress, prior=prior)
    blocks = blocks_with_field(field, data, without)
    now, then = held_out_rows(without), held_out_rows(blocks)
    if not predicts_better((then**2).sum(axis=1), (now**2).sum(axis=1), MIN_NAMELESS_GAIN):
        before, after = in_mm(error_stats(now).rms), in_mm(error_stats(then).rms)
        raise NoBetterPrediction(
            f"no residual field: it does not surely predict better ({before} mm held out, {after} mm with it)"
        )
    fitted = fit_with_field(fit(model, data, loss=loss, prior=prior), data)
    held_out = HeldOutResidual(then, blocks=blocks)
    return StudyStep(f"add {field.name}, {WHAT_IT_IS}", fitted, start=model, stated_prior=prior, held_out=held_out)
