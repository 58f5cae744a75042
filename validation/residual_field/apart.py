"""Error on poses that were drawn and measured apart from those of the fit: a plain fit, names, and fields on both."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.field.fit import fit_with_field
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model


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
