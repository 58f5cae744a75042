"""Promises of a residual field: not to appear where nothing is left, nor to mislead beyond its data; and its error on
poses that were drawn and measured apart from those of the fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.field.fit import fit_with_field
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.residual_field.nameless_arm import measured


def refused_on_null_data(seeds: int) -> int:
    """Number of arms without anything left that get no field."""
    refused = 0
    for seed in range(100, 100 + seeds):
        try:
            Study.of(measured(seed, 0.0)).fit("option1").add_field()
        except NoBetterPrediction:
            refused += 1
    return refused


def worst_on_null_data(seeds: int) -> float:
    """Largest error (RMS) at new poses with a field over that without, where nothing is left and it is added all the
    same."""
    unseen, worst = measured(99, 0.0), 0.0
    for seed in range(100, 100 + seeds):
        plain = Study.of(measured(seed, 0.0)).fit("option1")
        both = plain.model, fit_with_field(plain.taken.fit, plain.data).model
        errors = [error_stats(unseen.position_error(solve_equilibrium(one, unseen.poses))).rms for one in both]
        worst = max(worst, errors[1] / errors[0])
    return worst


def worst_on_other_half(data: Measurements, parameters: str = "option1") -> tuple[float, str]:
    """Largest error (RMS) with a field over that without, where one joint stands on the other side of its median from
    all poses that both were fitted on; and which joint and side. The field is added whether it helps or not."""
    start, worst, which = Study.of(data).fit(parameters).model, 0.0, ""
    for joint, column in enumerate(data.poses.q.T):
        for name, side in (("below", column < np.median(column)), ("above", column > np.median(column))):
            known, other = data.take(side), data.take(~side)
            if len(known) < 2 * len(start.free) or not len(other):
                continue
            plain = fit(start, known)
            errors = [
                error_stats(other.position_error(solve_equilibrium(model, other.poses))).rms
                for model in (plain.model, fit_with_field(plain, known).model)
            ]
            if errors[1] / errors[0] > worst:
                worst, which = errors[1] / errors[0], f"joint {joint + 1}, learned {name} its median"
    return worst, which


def models(data: Measurements) -> Iterator[tuple[str, Model]]:
    """Name and model of each way, all of them fitted to `data` alone; fields are added whether they help or not."""
    plain = Study.of(data).fit()
    for name, study in (("fit", plain), ("named (`auto`)", plain.auto()[1])):
        yield name, study.model
        yield f"field on {name}", fit_with_field(study.taken.fit, study.data).model


def errors_apart(data: Measurements, apart: Measurements) -> Iterator[tuple[str, ErrorStats, int]]:
    """Name and error (m) on `apart` of each way, and how many effects of the session of `data` are left out there."""
    for name, model in models(data):
        here, _ = model_for_data(model, apart.path, apart.sha256)
        residual = apart.position_error(solve_equilibrium(here, apart.poses))
        yield name, error_stats(residual), len(model.effects) - len(here.effects)


def apart_table(data: Measurements, apart: Measurements) -> Table:
    """A row for each way."""
    title = f"fitted to {len(data)} poses, {len(apart)} measured apart"
    table = Table("model", "mean mm", "RMS mm", "max mm", "effects of the session, left out", title=title)
    for name, error, left_out in errors_apart(data, apart):
        table.add_row(name, *(f"{1e3 * one:.3f}" for one in (error.mean, error.rms, error.max)), str(left_out))
    return table
