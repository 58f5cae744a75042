"""Steps of an identification: the first fit, an effect added, the steps of `auto`; each ends as a model file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.anchor import with_anchor
from lrm_ident.data.wording import enumerate_words
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.auto import AutoStep
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, fit_bounds, fit_model, nominal_model
from lrm_ident.fitting.priors import load_prior, prior_name_for
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.error_breakdown import HeldOutResidual, try_held_out
from lrm_ident.study.error_summary import ErrorSummary
from lrm_ident.study.inputs import ModelInputs
from lrm_ident.study.model_history import model_file
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile

RIVALS_NAMED = 30
NamedProgress = Callable[[str], OnProgress]
"""Called with what is being done; gives the callback of its progress."""


@dataclass(frozen=True, eq=False)
class AddedEffect:
    """The model file after an effect was added, the fit, and the errors before and after."""

    file: ModelFile
    fit: Fit
    before: ErrorSummary
    after: ErrorSummary


def first_fit(arm: Arm, arm_name: str, data: Measurements, named: NamedProgress) -> ModelFile:
    """As `lrm-ident fit DATA --arm ARM`: all identifiable parameters by least squares. Raises `LrmError`."""
    result = fit_model(nominal_model(arm, DEFAULT_EFFECTS), data, "identifiable", SQUARED)
    fitted = result.fit.model
    tick, prior = named("held-out error"), result.fit.weak_prior
    held_out = try_held_out(fitted, data, fit_bounds(fitted, False), SQUARED, tick, prior)
    return model_file(result.fit, data, held_out, arm_name, "fit", SQUARED.name)


def add_step(inputs: ModelInputs, found: Diagnosis, effect: str, named: NamedProgress) -> AddedEffect:
    """As `lrm-ident add`: an effect (`id` or `id@place`) added, everything refitted without the outliers.

    Args:
        found: the diagnosis of these inputs. Raises `LrmError`.
    """
    before, data, loss = inputs.model, found.data, inputs.loss
    fitted = add_effects(before, data, effects_at(before.arm, effect, inputs.catalogue), loss=loss)
    prior = fitted.weak_prior
    left_before = try_held_out(before, data, loss=loss, progress=named("held-out error, before"))
    left_after = try_held_out(fitted.model, data, loss=loss, progress=named("held-out error, after"), prior=prior)
    nominal = nominal_error(before.arm, data)
    errors_before = ErrorSummary(nominal, error_of(before, data), left_before)
    errors_after = ErrorSummary(nominal, error_stats(fitted.residual), left_after)
    step = f"add {effect}"
    file = model_file(fitted, data, left_after, inputs.file.arm, step, loss.name, inputs.file.history)
    return AddedEffect(file, fitted, errors_before, errors_after)


def step_words(step: AutoStep) -> str:
    """A step of `auto` in the history of a model file: the effect added, and the rest of its class."""
    rivals = f", or {enumerate_words(step.equivalent, RIVALS_NAMED)}: these data cannot tell" if step.equivalent else ""
    return f"add {step.added}{rivals}"


def auto_files(inputs: ModelInputs, steps: Iterable[AutoStep]) -> Iterator[ModelFile]:
    """The model file after every step of `auto` but its start."""
    file = inputs.file
    for step in steps:
        if step.added:
            left, loss = HeldOutResidual(step.held_out), inputs.loss.name
            file = model_file(step.fit, step.data, left, file.arm, step_words(step), loss, file.history)
            yield file


def prior_step(
    file: ModelFile, model: Model, data: Measurements, prior: str, catalogue: Catalogue, loss: Loss
) -> tuple[ModelFile, ErrorSummary]:
    """The file with one more step, all parameters fitted together with a prior (name or path), and its errors.

    Raises `LrmError`.
    """
    known = load_prior(prior, model, catalogue)
    result = fit_model(model, data, "identifiable", loss, prior=known).fit
    left = try_held_out(result.model, data, loss=loss, prior=known)
    errors = ErrorSummary(nominal_error(model.arm, data), error_stats(result.residual), left)
    step, where = f"with the prior {known.name}", prior_name_for(prior)
    return model_file(result, data, left, file.arm, step, loss.name, file.history, where), errors


def error_of(model: Model, data: Measurements) -> ErrorStats:
    """TCP error of a model as it is."""
    return error_stats(data.position_error(equilibrium(model, data.poses)))


def nominal_error(arm: Arm, data: Measurements) -> ErrorStats:
    """TCP error of the arm file's nominal arm."""
    return error_of(with_anchor(model_of(arm, ()), data), data)
