"""Public API of the offline tool: measurements in, models and diagnoses out.

>>> import lrm_ident as lrm
>>> data = lrm.load(lrm.EXAMPLE)
>>> fit = lrm.fit(data)
>>> lrm.diagnose(fit.model, data).first.scored.name
'backlash@joint2'
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.examples import EXAMPLE
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.data.measurement_file.metadata import arm_for
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.anchor import with_anchor
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.auto import AutoRun, run_auto
from lrm_ident.diagnosis.diagnose import diagnose as run_diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED, Loss, loss_named
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, fit_model, nominal_model
from lrm_ident.fitting.priors import load_prior
from lrm_ident.residual.error_breakdown import ModelComparison, try_held_out
from lrm_ident.residual.error_breakdown import compare as run_compare
from lrm_ident.study.model_history import arm_name_for, model_file, model_text
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import load_model
from lrm_math.model.reading import AS_NAMED, Reading

__all__ = [
    "EXAMPLE",
    "add",
    "auto",
    "compare",
    "diagnose",
    "fit",
    "load",
    "load_model",
    "load_poses",
    "predict",
    "save",
]


def load(path: str | Path, arm: str | None = None, reading: Reading = AS_NAMED) -> Measurements:
    """Measured TCP positions of an arm.

    Args:
        path: a CSV with one row per pose (docs/files.md).
        arm: name of a shipped arm or path of an arm file; None: the one that the file beside the CSV names.
        reading: units, axes, frame, and the joints' signs and order, where the columns' names do not say them.

    Raises `FileError`: with file, line and column of the first fault; `Misread` if the arm cannot have moved so.
    """
    name, described = arm_for(Path(path), arm)
    return replace(load_checked(Path(path), described, reading), arm_name=name)


def fit(
    data: Measurements,
    effects: Sequence[str] = DEFAULT_EFFECTS,
    parameters: str = "identifiable",
    loss: str = "squared",
    prior: str | None = None,
) -> Fit:
    """Least-squares fit of an arm's model; its `model` goes into the other functions.

    Args:
        effects: ids, or `id@place`.
        parameters: 'identifiable', 'option1' to 'option5', or names and patterns by commas.
        loss: 'squared', 'huber' or 'cauchy'. prior: name of a shipped prior or path of a prior file.

    Raises `LrmError`: unknown names, data without an arm, too few poses, or no convergence.
    """
    if data.arm is None:
        raise LrmError(f"{data.path}: no arm; give measurements that were loaded with one")
    model = nominal_model(data.arm, effects)
    known = None if prior is None else load_prior(prior, model)
    return fit_model(model, data, parameters, loss_named(loss), prior=known).fit


def compare(model: Model | Fit, data: Measurements, loss: str | None = None) -> ModelComparison:
    """Error of a model on measurements beside its held-out error, split by what it may depend on.

    Here and below: a `Fit` brings its loss along; else `loss` says it, least squares if not given.
    """
    the_model, how = _ready(model, data, loss)
    return run_compare(the_model, data, loss=how)


def diagnose(model: Model | Fit, data: Measurements, loss: str | None = None) -> DiagnosisReport:
    """Which physical effect a model misses: `first` is the effect to add, `verdict` says if there is one."""
    the_model, how = _ready(model, data, loss)
    return build_report(run_diagnose(the_model, data, loss=how))


def add(model: Model | Fit, data: Measurements, effect: str, loss: str | None = None) -> Fit:
    """The model with an effect (`id` or `id@place`), all parameters fitted together. Raises `LrmError`."""
    the_model, how = _ready(model, data, loss)
    return add_effects(the_model, data, effects_at(the_model.arm, effect), loss=how)


def auto(model: Model | Fit, data: Measurements, max_effects: int = 20, loss: str | None = None) -> AutoRun:
    """Diagnoses and adds effects until nothing is supported; `model` is the result."""
    the_model, how = _ready(model, data, loss)
    return run_auto(the_model, data, max_effects, loss=how)


def _ready(model: Model | Fit, data: Measurements, loss: str | None) -> tuple[Model, Loss]:
    """A model that knows where the data's distances start, and the loss of its fit. Raises `UnknownName`."""
    the_model, own = (model.model, model.loss) if isinstance(model, Fit) else (model, SQUARED)
    return with_anchor(the_model, data), own if loss is None else loss_named(loss)


def predict(model: Model, poses: Poses) -> Array:
    """(N, 3) TCP positions (m) at elastic equilibrium. Raises `NotSettled` if there is none."""
    return equilibrium(model, poses).tcp


def save(fit: Fit, data: Measurements, path: str | Path) -> None:
    """Writes a model file, which the command line and the daemon read. Raises `FileError`."""
    held_out = try_held_out(fit.model, data, loss=fit.loss, prior=fit.weak_prior)
    arm = arm_name_for(data.arm_name or fit.model.arm.name, Path(path).parent)
    write_text(Path(path), model_text(model_file(fit, data, held_out, arm, "fit", fit.loss.name)))
