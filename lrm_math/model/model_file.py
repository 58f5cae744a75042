"""Model files: the effects of an arm and their parameters, read by the daemon and the offline tool."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.effects import CATALOGUE, Effect, effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.model.covariance import Covariance, CovarianceTable, to_covariance
from lrm_math.model.model import Model, model_of
from lrm_math.model.reading import Reading
from lrm_math.toml_file import StrictSchema, read_toml

MOST_EFFECTS = 1000


class ProvenanceTable(StrictSchema):
    """Table `[provenance]`: data, tool and date of the fit; and the file of the user's own effects, if it has any.

    `poses`: how many were fitted. `left_out`: numbers of those that were not.
    """

    data: str
    data_sha256: str
    poses: int
    tool: str
    date: str
    loss: str = "squared"
    prior: str | None = None
    left_out: list[int] = []
    effects_file: str | None = None
    effects_sha256: str | None = None
    reading: Reading | None = None


class HistoryTable(StrictSchema):
    """One `[[history]]` entry: a step, its errors, and the whole model after it."""

    step: str
    fit_rms_mm: float
    held_out_rms_mm: float | None = None
    effects: list[str]
    parameters: dict[str, float]
    sigma: dict[str, float] = {}
    covariance: CovarianceTable | None = None
    provenance: ProvenanceTable | None = None


class ModelFile(StrictSchema):
    """The whole file, schema `lrm/model/1`. `[parameters]` holds the fitted ones; others are zero."""

    schema_: Literal["lrm/model/1"] = Field(alias="schema")
    arm: str
    effects: Annotated[list[str], Field(max_length=MOST_EFFECTS)]
    parameters: dict[str, float] = {}
    sigma: dict[str, float] = {}
    covariance: CovarianceTable | None = None
    history: list[HistoryTable] = []
    provenance: ProvenanceTable | None = None


def load_model(file: str | Path, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Model:
    """The model of one file, its parameters free.

    Raises:
        FileError: the file, its arm, an effect or a parameter is not valid.
    """
    path = Path(file)
    tables = read_toml(path, ModelFile)
    return to_model(path, tables, arm_of(path, tables.arm), catalogue)


def load_covariance(path: Path, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Covariance | None:
    """Covariance of the parameters of a file's model (SI), or None if the file has none.

    Raises:
        FileError: as `load_model`, or a `[covariance]` that contradicts itself.
    """
    tables = read_toml(path, ModelFile)
    return covariance_of(path, tables, to_model(path, tables, arm_of(path, tables.arm), catalogue))


def covariance_of(path: Path, tables: ModelFile, model: Model) -> Covariance | None:
    """Covariance of the parameters of parsed tables' model (SI), None without one. Raises `FileError`."""
    if tables.covariance is None:
        return None
    try:
        return to_covariance(tables.covariance, tables.sigma, model)
    except LrmError as error:
        raise FileError(path, "covariance", str(error)) from None


def arm_of(path: Path, arm: str) -> Arm:
    """The arm named in a file: a shipped one, or a path relative to the file's folder or the working directory."""
    if arm in shipped_arms():
        return load_arm(arm)
    beside = path.parent / arm
    try:
        return load_arm(beside if beside.exists() else arm)
    except FileError as error:
        raise error if error.path.endswith(".toml") else FileError(path, "arm", str(error)) from None


def to_model(path: Path, tables: ModelFile, arm: Arm, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Model:
    """The model of parsed tables, in SI. Raises `FileError`."""
    where = "effects"
    if twice := next((name for name, times in Counter(tables.effects).items() if times > 1), None):
        raise FileError(path, where, f"{twice} is named twice", "name each effect once")
    try:
        effects = [effect for name in tables.effects for effect in effects_at(arm, name, catalogue)]
        where = "parameters"
        empty = model_of(arm, effects)
        values = {key: value * empty.parameters[empty.position(key)].si for key, value in tables.parameters.items()}
        where = "sigma"
        for key in tables.sigma:
            empty.position(key)
        model = model_of(arm, effects, values)
    except LrmError as error:
        raise FileError(path, where, str(error), _own_effects(tables) if where == "effects" else "") from None
    shape = {key for key, parameter in zip(model.keys, model.parameters, strict=True) if parameter.fixed is not None}
    return replace(model, free=tuple(key for key in model.keys if key in values and key not in shape))


def _own_effects(tables: ModelFile) -> str:
    """Place of a model's own effects, if it has any."""
    known = tables.provenance
    if known is None or known.effects_file is None:
        return ""
    gone = "" if Path(known.effects_file).exists() else ", which is gone"
    where = f"{known.effects_file}{gone} (sha256 {known.effects_sha256})"
    right = "give that file with --effects-file, in Python as read_study's third argument"
    return f"the model has effects of its own, from {where}; {right}"


def parameter_tables(model: Model) -> dict[str, float]:
    """The `[parameters]` table of a model in the file's units: the free ones, and shape parameters."""
    return {
        key: float(value) / parameter.si
        for key, parameter, value in zip(model.keys, model.parameters, model.values, strict=True)
        if key in model.free or parameter.fixed is not None or (value != parameter.default and math.isfinite(value))
    }


def as_tables(file: ModelFile) -> dict[str, Any]:
    """A model file as plain tables for a TOML writer."""
    return file.model_dump(by_alias=True, exclude_none=True)
