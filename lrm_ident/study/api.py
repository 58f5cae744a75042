"""Public API of the offline tool: measurements in, models and diagnoses out.

A `Study` is a model on measurements; its methods are the steps of an identification, and each gives a new study or a
result. The functions below do one step on a model and measurements.

>>> import lrm_ident as lrm
>>> data = lrm.load(lrm.EXAMPLE)
>>> study = lrm.Study.of(data).fit()
>>> study.diagnose().first.name
'backlash@joint2'
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from lrm_ident.data.examples import EXAMPLE
from lrm_ident.data.measurement_file import load as pose_files
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_ident.data.measurements import Measurements, every_pose
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED, loss_named
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_ident.study import inputs
from lrm_ident.study.arguments import (
    arm_named,
    check_poses,
    check_same_arm,
    measurements_of,
    model_of_fit,
    of_kind,
    options_in_python,
    path_of,
    reading_of,
)
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_ident.study.transfer import Transfer, identified, read_transfer
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import load_model
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.model.step_name import FIT, StepName

__all__ = [
    "EXAMPLE",
    "Reading",
    "Study",
    "add",
    "auto",
    "catalogue_with",
    "compare",
    "diagnose",
    "fit",
    "load",
    "load_model",
    "load_poses",
    "predict",
    "read_study",
    "save",
    "transfer",
]

read_study = options_in_python(inputs.read_study)


@options_in_python
def load(
    path: str | Path, arm: str | Path | None = None, reading: Reading = AS_NAMED, leave_out: Sequence[int] = ()
) -> Measurements:
    """Measured TCP positions of an arm.

    Args:
        path: a CSV with one row per pose (docs/files.md).
        arm: name of a shipped arm or path of an arm file; None: the one that the file beside the CSV names.
        reading: units, axes, frame, and the joints' signs and order, where the columns' names do not say them:
            `lrm.Reading(unit="m", angle_unit="rad")`. Every option of the commands is a field of it.
        leave_out: numbers of poses that were measured wrongly; a fit of the others remembers them.

    Warns of what a person should know of the file, such as rows that were left out. Raises `FileError`: with file, line
    and column of the first fault; `Misread` if the arm cannot have moved so.
    """
    file = path_of(path)
    name, described = arm_for(file, None if arm is None else arm_named(arm))
    part = partial(Measurements.without, numbers=leave_out) if len(leave_out) else every_pose
    data = inputs.read_measurements(file, described, name, reading_of(reading), part=part)
    for words in data.source.notices:
        warnings.warn(str(words), stacklevel=3)
    return data


@options_in_python
def load_poses(file: str | Path, arm: Arm | str | Path, reading: Reading = AS_NAMED) -> Poses:
    """Commanded poses: `q1_deg` …, optional `payload_g`, `t_s`, `session`, `temp_c`, `approach`, gravity.

    Args:
        arm: itself, the name of a shipped one or the path of an arm file.
        reading: as in `load`.

    Warns of what a person should know of the file. Raises `FileError`.
    """
    the_arm, path, how = arm if isinstance(arm, Arm) else load_arm(arm_named(arm)), path_of(file), reading_of(reading)
    poses, table = pose_files.load_pose_table(path, the_arm, how)
    for words in pose_files.pose_doubts(table, the_arm, how):
        warnings.warn(str(words), stacklevel=3)
    return poses


def fit(
    data: Measurements,
    effects: str | Sequence[str] = DEFAULT_EFFECTS,
    parameters: str | Sequence[str] = "identifiable",
    loss: str = "squared",
    prior: str | None = None,
) -> Fit:
    """Least-squares fit of an arm's model; its `model` goes into the other functions.

    Args:
        effects: `id`, at all places, or `id@place`; several by commas, or a list.
        parameters: 'identifiable', 'option1' to 'option5', or names and patterns, by commas or a list.
        loss: 'squared', 'huber' or 'cauchy'. prior: name of a shipped prior or path of a prior file.

    Raises `LrmError`: unknown names, data without an arm, too few poses, or no convergence.
    """
    return Study.of(data, effects).fit(parameters, loss, prior).taken.fit


def compare(model: Model | Fit | Study, data: Measurements, loss: str | None = None) -> ModelComparison:
    """Error and held-out error of a model on measurements, and its breakdown by factors.

    On poses that the fit did not see its error is a held-out one, and nothing is refitted: on those of another file, or
    of the same if a `Fit` or `Study` is given (`data.without(numbers)`, `data.only(numbers)`).

    Here and below: a `Fit` or `Study` brings its loss along; else `loss` says it, least squares if not given. On other
    data than those of the fit, effects that belong to one session are left out, and a warning names them.
    """
    return _study(model, data, loss).compare()


def diagnose(model: Model | Fit | Study, data: Measurements, loss: str | None = None) -> DiagnosisReport:
    """Finds which physical effect a model misses: `first` is the effect to add, `verdict` says if there is one."""
    return _study(model, data, loss).diagnose()


def add(model: Model | Fit | Study, data: Measurements, effect: str | RankedCandidate, loss: str | None = None) -> Fit:
    """Adds an effect (`id`, `id@place`, or a candidate), all parameters fitted together, without outliers.

    Raises `LrmError`.
    """
    return _study(model, data, loss).add(effect).taken.fit


def auto(
    model: Model | Fit | Study, data: Measurements, max_effects: int = MAX_EFFECTS, loss: str | None = None
) -> AutoRun:
    """Diagnoses and adds effects until nothing is supported; `model` is the result."""
    return _study(model, data, loss).auto(max_effects)[0]


def transfer(model: Study | str | Path, to: str | Path, data: Measurements | None = None) -> Transfer:
    """The arm's part of a calibrated model in another installation of the arm, such as from a bench to a rover.

    Args:
        model: a study, or the path of a model file.
        to: name of a shipped arm or path of an arm file; only its base, tool, gravity and limits may differ.
        data: a few poses measured there, loaded with that arm; None: it is mounted as its arm file says.

    Raises `LrmError`: another arm, with the value that differs; or a model without standard errors.
    """
    if isinstance(model, Study):
        return model.transfer(to, data)
    arm_part, notices = read_transfer(path_of(model), arm_named(to))
    for notice in notices:
        warnings.warn(str(notice), stacklevel=2)
    return arm_part if data is None else identified(arm_part, measurements_of(data))


def predict(model: Model | Fit | Study, poses: Poses) -> Array:
    """(N, 3) TCP positions (m) at elastic equilibrium. Raises `NotSettled` if there is none.

    At poses from another file than that of the fit, effects of a session are left out, and a warning names them; poses
    without a file keep them. A joint's drift follows the times of a file (`t_s`) where the model says so.
    """
    the_model = model_of_fit(model)
    check_poses(the_model, poses)
    return solve_equilibrium(
        the_model if poses.sha256 is None else _here(the_model, None, poses.sha256, poses), poses
    ).tcp


def save(fit: Fit, data: Measurements, path: str | Path) -> None:
    """Writes a model file of one step, which the command line and the daemon read. Raises `FileError`."""
    right = "lrm.save(fit, data, 'model.toml'); a study saves itself: study.save('model.toml')"
    numbers = of_kind(fit, Fit, "a fit", right).equilibrium.poses.number
    outliers = [] if numbers is None else np.setdiff1d(data.pose, numbers).tolist()
    fitted = data.without(outliers)
    replace(_study(fit, fitted, None), step=Step(StepName(FIT), fit, fitted)).save(path)


def _study(model: Model | Fit | Study, data: Measurements, loss: str | None) -> Study:
    """Study of a model on these data, with the anchor of measured distances. Raises `LrmError`."""
    the_model = model_of_fit(model)
    check_same_arm(the_model, measurements_of(data).source.arm)
    check_poses(the_model, data.poses)
    fitted_with = model.loss if isinstance(model, Fit | Study) else SQUARED
    how = fitted_with if loss is None else loss_named(loss)
    step = model.step if isinstance(model, Study) else None
    fitted = model if step is None else step.fit
    numbers = fitted.equilibrium.poses.number if isinstance(fitted, Fit) else None
    apart = numbers is not None and the_model.fitted_to == data.source.sha256 and not np.isin(data.pose, numbers).any()
    here = _here(the_model, data.source.path, data.source.sha256)
    return Study(with_set_up(here, data), data, data.source.arm_name or the_model.arm.name, loss=how, apart=apart)


def _here(model: Model, data: Path | None, sha256: str, poses: Poses | None = None) -> Model:
    """The model for the poses of a file; a warning names the effects that are left out."""
    here, left_out = model_for_data(model, data, sha256, poses)
    for notice in left_out:
        warnings.warn(str(notice), stacklevel=4)
    return here
