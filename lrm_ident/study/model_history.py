"""Model files of fits: parameters, standard errors, provenance, and the history of identification steps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.diagnosis.evidence import NO_EVIDENCE, Evidence
from lrm_ident.fitting.effect_plugins import file_of, sha256_of
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.tool_version import tool_version
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import arm_name_for
from lrm_math.effects import marked
from lrm_math.errors import FileError, LrmError
from lrm_math.model.covariance import CovarianceTable, covariance_table
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import (
    SCHEMA,
    HistoryTable,
    ModelFile,
    ProvenanceTable,
    as_tables,
    model_tables,
    to_model,
)
from lrm_math.model.step_name import StepName
from lrm_math.toml_file import read_toml

ARRAY = re.compile(r"^\S+ = \[\n(?:    .*\n)+\]$", re.MULTILINE)
"""An array as the TOML writer puts it, an item to a line: of a covariance thousands."""


def model_file(
    fit: Fit,
    data: Measurements,
    held_out: HeldOutResidual,
    arm: str,
    step: StepName,
    before: Sequence[HistoryTable] = (),
    prior: str | None = None,
    evidence: Evidence = NO_EVIDENCE,
) -> ModelFile:
    """The model file of a fit: one entry appended to the history `before`.

    Args:
        arm: name of a shipped arm or path of its file, as stored in the model file.
        step: what was done.
        prior: name of the prior of the fit, if any.
        evidence: for the effect that was added, if one was.
    """
    model, date = fit.model, datetime.now(UTC).isoformat(timespec="seconds")
    effects_file, rivals = file_of(model.effects), evidence.rivals
    entry = HistoryTable(
        step=step.kind,
        of=step.of,
        indistinguishable=list(evidence.equivalent),
        nominal_rms_mm=None if before else _nominal_rms_mm(fit, data),
        fit_rms_mm=error_stats(fit.residual).rms * 1e3,
        held_out_rms_mm=None if held_out.error is None else held_out.error.rms * 1e3,
        deployed_rms_mm=None if held_out.deployed is None else held_out.deployed.now.rms * 1e3,
        deployed_95_mm=_deployed_between(held_out),
        deployed_poses=None if held_out.deployed is None else held_out.deployed.fewer,
        rivals_mm=None if rivals is None else {name: round(rms * 1e3, 4) for name, rms in rivals.items()},
        rivals_refitted=list(evidence.refitted),
        sigma=sigma_table(fit),
        covariance=covariance_table_of(fit),
        **model_tables(model),
        provenance=ProvenanceTable(
            data=data.source.path.name,
            data_sha256=data.source.sha256,
            arm_sha256=arm_sha256(model.arm),
            poses=len(data),
            tool=tool_version(),
            date=date,
            loss=fit.loss.name,
            prior=prior,
            left_out=list(data.source.left_out),
            reading=data.source.reading if data.source.reading.said() else None,
            servos=data.source.servos,
            effects_file=None if effects_file is None else effects_file.resolve().as_posix(),
            effects_sha256=None if effects_file is None else sha256_of(effects_file),
        ),
    )
    return _file_at(arm, [*before, entry])


def _deployed_between(held_out: HeldOutResidual) -> list[float] | None:
    between = None if held_out.deployed is None else held_out.deployed.now.rms_between
    return None if between is None else [end * 1e3 for end in between]


def _nominal_rms_mm(fit: Fit, data: Measurements) -> float:
    return data.errors(solve_equilibrium(nominal_arm(fit.model.arm, data), data.poses)).rms * 1e3


def models_of_history(file: ModelFile) -> list[tuple[str, ModelFile]]:
    """Name of every step and the model file after it; a file without a history counts as one step."""
    entries = file.history
    return [(str(entry.name), _file_at(file.arm, entries[: k + 1])) for k, entry in enumerate(entries)] or [
        ("model", file)
    ]


def undo_step(file: ModelFile) -> ModelFile:
    """The model file before its last step. Raises `LrmError` if there was none."""
    if len(file.history) < 2:
        raise LrmError("nothing to undo: the model's history has no step before this one")
    return _file_at(file.arm, file.history[:-1])


def _file_at(arm: str, history: Sequence[HistoryTable]) -> ModelFile:
    """Model file of the last entry of a history."""
    of_model = {
        name: getattr(history[-1], name) for name in ModelFile.model_fields if name in HistoryTable.model_fields
    }
    return ModelFile(schema=SCHEMA, arm=arm, history=list(history), **of_model)


def sigma_table(fit: Fit) -> dict[str, float]:
    """Standard errors of the free parameters in the file's units; parameters at a bound have none."""
    model = fit.model
    return {
        key: float(error) / model.parameter(key).si
        for key, error in zip(model.free, fit.standard_error, strict=True)
        if key not in fit.at_bound
    }


def covariance_table_of(fit: Fit) -> CovarianceTable | None:
    """Covariance table of the free parameters that are not at a bound; None if there are none."""
    error = fit.standard_error
    fitted = [j for j, key in enumerate(fit.model.free) if key not in fit.at_bound and error[j] > 0.0]
    if not fitted:
        return None
    return covariance_table([fit.model.free[j] for j in fitted], fit.covariance[np.ix_(fitted, fitted)])


def as_written(model: Model, arm: str) -> Model:
    """The model as it would be read from its own file: effects in its order, values rounded by the change of units."""
    file = ModelFile(schema=SCHEMA, arm=arm, **model_tables(model))
    read = to_model(Path(arm), file, model.arm, tuple({type(effect) for effect in model.effects}))
    return replace(read, fitted_to=model.fitted_to)


def check_replaces(path: Path, steps: int) -> None:
    """Raises `FileError` if a model of more steps than `steps` stands at a path where one is to be written."""
    try:
        standing = len(read_toml(path, ModelFile).history) if path.exists() else 0
    except FileError:
        return  # no model: whether it may be replaced is not asked here
    if standing > steps:
        words = f"holds a model of {standing} steps, which one of {steps} would replace"
        raise FileError(path, "", words, "write to another file, or add --force")


def model_text(file: ModelFile) -> str:
    """TOML text of a model file, an array to a line, with a comment for every effect that names no cause."""
    beside = [f"# {words}\n" for name in file.effects if (words := marked(name)) != name]
    return "".join(beside) + ARRAY.sub(_on_one_line, tomli_w.dumps(as_tables(file)))


def _on_one_line(array: re.Match[str]) -> str:
    return " ".join(line.strip() for line in array[0].split("\n")).replace("[ ", "[").replace(", ]", "]")


def write_model(path: Path, file: ModelFile, arm: str) -> None:
    """Writes a model file; a path of an `arm` is stored relative to the file's folder. Raises `FileError`."""
    write_text(path, model_text(file.model_copy(update={"arm": arm_name_for(arm, path.parent)})))
