"""From a fit to a model file: parameters, standard errors, provenance, and what each step left."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.error_stats import figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.error_breakdown import HeldOut
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_math.effects import Effect
from lrm_math.errors import LrmError
from lrm_math.model.covariance import CovarianceTable, covariance_table
from lrm_math.model.model import Model
from lrm_math.model.model_file import HistoryTable, ModelFile, ProvenanceTable, as_tables, parameter_tables


def tool_version() -> str:
    """`lrm-ident` and its version."""
    try:
        return f"lrm-ident {version('lrm-arm')}"
    except PackageNotFoundError:
        return "lrm-ident (not installed)"


def model_file(
    fit: Fit,
    data: Measurements,
    held_out: HeldOut,
    arm: str,
    step: str,
    loss: str,
    before: Sequence[HistoryTable] = (),
    prior: str | None = None,
) -> ModelFile:
    """The model file of a fit, one entry added to the history that came `before`.

    Args:
        arm: name of a shipped arm or path of its file, as the model file shall name it.
        step: what was done, in a few words.
        prior: name of the prior that the fit took, if any.
    """
    model, date = fit.model, datetime.now(UTC).isoformat(timespec="seconds")
    entry = HistoryTable(
        step=step,
        fit_rms_mm=figures(fit.residual).rms * 1e3,
        held_out_rms_mm=None if held_out.error is None else held_out.error.rms * 1e3,
        effects=effect_names(model.effects),
        parameters=parameter_tables(model),
        sigma=sigma_table(fit),
        covariance=covariance_table_of(fit),
        provenance=ProvenanceTable(
            data=data.path.name,
            data_sha256=data.sha256,
            poses=len(data),
            tool=tool_version(),
            date=date,
            loss=loss,
            prior=prior,
        ),
    )
    return _standing_at(arm, [*before, entry])


def undone(file: ModelFile) -> ModelFile:
    """The model file as it was before its last step. Raises `LrmError` if there was none."""
    if len(file.history) < 2:
        raise LrmError("nothing to undo: the model's history has no step before this one")
    return _standing_at(file.arm, file.history[:-1])


def _standing_at(arm: str, history: Sequence[HistoryTable]) -> ModelFile:
    """The file whose model is that of the last entry."""
    last = history[-1]
    return ModelFile(
        schema="lrm/model/1",
        arm=arm,
        effects=last.effects,
        parameters=last.parameters,
        sigma=last.sigma,
        covariance=last.covariance,
        history=list(history),
        provenance=last.provenance,
    )


def effect_names(effects: Sequence[Effect]) -> list[str]:
    """Effects as a model file names them: `id` where it stands at all its places, else `id@place`."""
    names: list[str] = []
    for effect in effects:
        everywhere = {e.place for e in effects if e.id == effect.id} == set(type(effect).places(effect.arm))
        name = effect.id if everywhere else f"{effect.id}@{effect.place}"
        if name not in names:
            names.append(name)
    return names


def sigma_table(fit: Fit) -> dict[str, float]:
    """Standard errors of the free parameters in the file's units; parameters at a bound have none."""
    model: Model = fit.model
    return {
        key: float(error) / model.parameters[model.position(key)].si
        for key, error in zip(model.free, fit.standard_error, strict=True)
        if key not in fit.at_bound
    }


def covariance_table_of(fit: Fit) -> CovarianceTable | None:
    """Correlations of the same parameters; None if nothing was fitted."""
    error = fit.standard_error
    told = [j for j, key in enumerate(fit.model.free) if key not in fit.at_bound and error[j] > 0.0]
    if not told:
        return None
    return covariance_table([fit.model.free[j] for j in told], fit.covariance[np.ix_(told, told)])


def model_text(file: ModelFile) -> str:
    """The file's TOML text."""
    return tomli_w.dumps(as_tables(file))


def arm_name_for(arm: str, folder: Path) -> str:
    """How a model file in `folder` shall name an arm that was given on the command line: a path seen from there."""
    path = Path(arm)
    if path.suffix != ".toml":
        return arm
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.resolve().as_posix()
