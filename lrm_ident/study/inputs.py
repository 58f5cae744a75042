"""Studies, models and measurements from files, read and checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements, Part, every_pose
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.data.weights.model_error import model_error_words, with_model_error
from lrm_ident.fitting.effect_plugins import Catalogue, catalogue_with, file_of, sha256_of
from lrm_ident.fitting.loss import SQUARED, loss_named
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.fitting.typical_prior import prior_of_file
from lrm_ident.study.arguments import path_of, reading_of
from lrm_ident.study.notices import Notice, NoticeKind, as_read
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import arm_of, shipped_arms
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import FIT_AGAIN, ModelFile, arm_mismatch, to_model
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import read_toml

ReadMeasurements = Callable[[Path, Arm, str, Reading, Reading | None, Part], Measurements]
"""Reader of measurements, with the arguments of `read_measurements`."""


@dataclass(frozen=True)
class FittedPart:
    """Chooses poses of measurements by the numbers that a fit left `left_out`, if `data_sha256` is that of its data."""

    select: Callable[[Measurements, Sequence[int]], Measurements]
    left_out: tuple[int, ...]
    data_sha256: str | None

    def __call__(self, data: Measurements) -> Measurements:
        """The poses of measurements that it chooses."""
        return self.select(data, self.left_out if data.source.sha256 == self.data_sha256 else ())


def read_study(
    model: str | Path,
    data: str | Path,
    effects_file: str | Path | None = None,
    reading: Reading = AS_NAMED,
    progress: Progress = silent,
    part: Callable[[Measurements, Sequence[int]], Measurements] = Measurements.without,
    read: ReadMeasurements | None = None,
) -> Study:
    """A model file and measurements of its arm, read as those of its fit and without those that it left out.

    On other measurements than those of its fit effects that belong to one session are left out (`model_for_data`).

    Args:
        effects_file: a Python file with effects of the user's own.
        reading: units, axes, frame and signs of the numbers; what neither it nor the file beside them states is as in
            the fit.
        part: selects poses, given the numbers that the fit left out if these are its own data.
        read: reader of the measurements; None: `read_measurements`.

    Raises `FileError`: with file, line and column of the first fault; `Misread` if the arm cannot have moved so.
    """
    path, table, catalogue = path_of(model), path_of(data), catalogue_with(effects_file)
    file, loaded, notices = read_model(path, catalogue)
    provenance = file.provenance
    usual = None if provenance is None else provenance.reading
    chosen: Part = every_pose
    if provenance is not None:
        chosen = FittedPart(part, tuple(provenance.left_out), provenance.data_sha256)
    measured = (read or read_measurements)(table, loaded.arm, file.arm, reading_of(reading), usual, chosen)
    notices += as_read(measured.source.notices)
    if provenance is not None and (provenance.loss != "squared" or measured.source.left_out):
        notices += (Notice(NoticeKind.AS_FITTED, (provenance.loss,), tuple(measured.source.left_out)),)
    here, left_out = model_for_data(loaded, measured.source.path, measured.source.sha256)
    anchored = with_set_up(here, measured)
    parameters = effective_parameters(file, anchored, catalogue)
    weighed = with_model_error(measured, solve_equilibrium(anchored, measured.poses), parameters)
    return Study(
        anchored,
        weighed,
        arm_from(path, file.arm),
        catalogue,
        SQUARED if provenance is None else loss_named(provenance.loss),
        file,
        notices=(*notices, *left_out, *as_read(model_error_words(weighed))),
        progress=progress,
    )


def effective_parameters(file: ModelFile, model: Model, catalogue: Catalogue) -> float:
    """Effective number of parameters (MacKay 1992) of a model as its file states it: of each free one the share of its
    prior's variance that the data of its fit removed. One at its bound counts as decided by the prior.
    """
    prior = prior_of_file(file, model, catalogue)
    if prior is None:
        return float(len(model.free))
    error = np.array([file.sigma.get(key, 0.0) * model.parameter(key).si for key in prior.keys])
    with_prior = np.isin(prior.keys, model.free)
    variance_ratio = np.where(error > 0.0, (error / prior.sd_of(prior.keys)) ** 2, 1.0)[with_prior]
    return len(model.free) - float(np.minimum(variance_ratio, 1.0).sum())


def read_model(path: Path, catalogue: Catalogue) -> tuple[ModelFile, Model, tuple[Notice, ...]]:
    """A model file and its model, with notices if the arm or the user's effects have changed since the fit."""
    file = read_toml(path, ModelFile)
    arm = arm_of(path, file.arm)
    model = to_model(path, file, arm, catalogue)
    effects_file, provenance, words = file_of(model.effects), file.provenance, arm_mismatch(file, arm)
    notices = [*as_read([f"{path.name}: {words}; {FIT_AGAIN}"] if words else [])]
    if effects_file and provenance and provenance.effects_sha256 not in (None, sha256_of(effects_file)):
        notices.append(Notice(NoticeKind.OTHER_EFFECTS, (str(effects_file), path.name)))
    return file, model, tuple(notices)


def read_measurements(
    path: Path,
    arm: Arm,
    arm_name: str,
    reading: Reading = AS_NAMED,
    usual: Reading | None = None,
    part: Part = every_pose,
) -> Measurements:
    """Measurements that the arm can have made, with notices that name the file.

    Args:
        arm_name: as model files name the arm.
        reading: units, axes, frame and signs of the numbers; what neither it nor the file beside them states is as in
            `usual`.
        part: chooses poses; the others are neither tested nor taken.
    """
    data = load_checked(path, arm, reading, usual, part)
    notices = [f"{path.name}: {words}" for words in data.source.notices]
    if data.source.arm_name not in (None, arm_name):
        notices.append(f"{path.name} was measured on {data.source.arm_name}, the model is of {arm_name}")
    return replace(data, source=replace(data.source, arm_name=arm_name, notices=tuple(notices)))


def arm_from(model: Path, arm: str) -> str:
    """The arm that a model file names: a shipped name, or its path made absolute."""
    named = model.parent / arm
    return arm if arm in shipped_arms() or not named.exists() else str(named.resolve())
