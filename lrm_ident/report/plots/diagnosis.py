"""Figure of `diagnose`: errors that candidates would leave, the evidence for the first, its form beside the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.candidate_view import candidate_view, refitted_keys
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, TITLE_LINE, figure_file, finish, legend_below
from lrm_ident.report.text.variables import axis_label, function_name, in_a_sentence, place_of, variable_name
from lrm_ident.residual.covariates import Covariate, ExplanatoryVariable, covariates
from lrm_ident.residual.free_functions import CommonMode, FreeFunction
from lrm_ident.residual.gravity_loads import known_covariates
from lrm_ident.residual.picture.error_field import joint_turns
from lrm_math.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = 9
EVIDENCE = {
    Support.SUPPORTED: (MODEL, "", "improves the prediction"),
    Support.INDISTINGUISHABLE: (MODEL, "//", "indistinguishable from others"),
    Support.NO_EVIDENCE: (NOMINAL, "..", "no evidence"),
}
"""Colour and hatch of a bar, and what they say."""
BANDS = ((MODEL, "o"), (HELD_OUT, "^"), (GREEN, "s"))


def draw_report(report: DiagnosisReport, path: Path | None) -> Figure:
    """Draws a diagnosis. Raises `FileError` for an unknown format or a place that cannot be written."""
    first, diagnosis = report.first, report.diagnosis
    fitted, data = diagnosis.screening.subset
    known = known_covariates(data, fitted.equilibrium)
    with figure_file(path, 13 if first is None else 19, 4.6) as figure:
        left, right, *third = figure.subplots(1, 2 if first is None else 3)
        _draw_ranking(left, report)
        if first is not None:
            view = candidate_view(first, diagnosis, known, np.arange(len(data)))
            _draw_evidence(right, plain_name(first.name), np.array(view["added"]), 1e3 * fitted.residual)
            by_name = {variable_name(covariate.variable): covariate for covariate in known}
            _draw_form(third[0], first, diagnosis, view, by_name)
        elif diagnosis.unexplained.ranking:
            _draw_anatomy(right, diagnosis, diagnosis.unexplained.ranking[0][0])
    return figure


def _draw_ranking(axes: Axes, report: DiagnosisReport) -> None:
    shown = report.ranking[:DRAWN][::-1]
    for verdict, (colour, hatch, words) in EVIDENCE.items():
        if bars := {row: a for row, a in enumerate(shown) if a.verdict == verdict}:
            style: Any = {"color": colour, "hatch": hatch, "edgecolor": "white", "label": words}
            drawn = axes.barh([*bars], [a.held_out_rms * 1e3 for a in bars.values()], **style)
            labels = [f"{'' if a.exact else '≈ '}{in_mm(a.held_out_rms)}" for a in bars.values()]
            axes.bar_label(drawn, labels, padding=8, bbox={"facecolor": "white", "linewidth": 0, "pad": 1})
    names = [f"{plain_name(a.scored.name)}\n{a.scored.name}" for a in shown]
    axes.set_yticks(range(len(shown)), names, fontsize=8)
    now, floor = report.held_out.rms * 1e3, report.diagnosis.floor.rms
    axes.axvline(now, color="black", linestyle="-", linewidth=1, label=f"now {now:.2f} mm")
    if floor is not None:
        axes.axvline(floor * 1e3, color="black", linestyle=":", linewidth=1.5, label=f"noise {floor * 1e3:.2f} mm")
    axes.set(xlim=(0, 1.2 * now), ylim=(-0.6, len(shown) - 0.4))
    axes.set_xlabel("held-out RMS error with the effect added, mm")
    legend_below(axes, 2)
    first = report.first
    missing = conclude(report).headline if first is None else f"Best candidate: {plain_name(first.scored.name)}"
    axes.set_title(fill(missing, TITLE_LINE))


def _draw_evidence(axes: Axes, name: str, motion: Array, residual: Array) -> None:
    """Added-variable plot: what the fit leaves, against what the effect would add beyond the fitted parameters (mm).

    One point for each pose and axis; along the dashed line the effect explains all of it.
    """
    for axis, (colour, marker) in enumerate(BANDS):
        label = f"along {'xyz'[axis]}"
        axes.scatter(motion[:, axis], residual[:, axis], s=12, color=colour, marker=marker, label=label)
    most = float(np.abs(motion).max())
    axes.plot([-most, most], [-most, most], color="black", linestyle="--", linewidth=1, label="all explained")
    finish(axes, f"motion that {name} would add, mm", "residual of the fit, mm", f"Added-variable plot: {name}")


def _draw_form(
    axes: Axes,
    first: RankedCandidate,
    diagnosis: Diagnosis,
    view: Mapping[str, Any],
    covariates_known: Mapping[str, Covariate],
) -> None:
    """The turn of the joint against what drives it: the form with its band, and what the poses show around it.

    A second quantity that the form follows is the colour of both, without a band.
    """
    driver, second = covariates_known[view["driver"]], covariates_known.get(view["second"])
    around, form = (np.array(view[name], dtype=np.float64) for name in ("around", "form"))
    order = np.argsort(driver.shown)
    x, name = driver.shown[order], plain_name(first.name)
    if second is not None:
        colours: Any = {"c": second.shown[order], "cmap": "viridis"}
        points = axes.scatter(x, around[order], s=10, label="poses: the effect and the residual", **colours)
        edges: Any = points.to_rgba(second.shown[order])
        axes.scatter(x, form[order], s=26, marker="D", facecolors="none", edgecolors=edges)
        axes.figure.colorbar(points, ax=axes, label=axis_label(second.variable))
    else:
        axes.scatter(x, around[order], s=10, color=NOMINAL, label="poses: the effect and the residual")
        axes.plot(x, form[order], ".", color=MODEL, markersize=4, label=name)
        if (error := _form_error(first, diagnosis, view["joint"])) is not None:
            style: Any = {"color": MODEL, "alpha": 0.3, "linewidth": 2, "label": "two standard errors"}
            axes.vlines(x, (form - 2.0 * error)[order], (form + 2.0 * error)[order], **style)
    turn, title = f"turn of joint {view['joint'] + 1}, deg", f"The effect beside the data: {name}"
    finish(axes, axis_label(driver.variable), turn, title)


def _form_error(first: RankedCandidate, diagnosis: Diagnosis, joint: int) -> Array | None:
    """(N,), standard error of a candidate's form as a turn of a joint (deg); None where it was not refitted."""
    candidate, fit, keys = first.scored.candidate, first.fit, refitted_keys(first)
    if fit is None or not keys:
        return None
    motions = candidate.columns(first.scored.shape).reshape(len(diagnosis.screening.screened), -1, len(keys))[:, :3]
    turns = np.stack([joint_turns(motions[:, :, k], diagnosis.joint_jacobian)[joint] for k in range(len(keys))], axis=1)
    rows = [fit.model.free.index(key) for key in keys]
    turns = turns / [parameter.typical for parameter in candidate.parameters]
    variance = np.einsum("nk,kl,nl->n", turns, fit.covariance[np.ix_(rows, rows)], turns)
    return np.asarray(np.degrees(np.sqrt(np.maximum(variance, 0.0))))


def _draw_anatomy(axes: Axes, diagnosis: Diagnosis, function: FreeFunction) -> None:
    """The motion that each residual acts like, against what it follows; a second quantity in three bands."""
    shift = function.shift
    motion = function.terms[0][0][:3] if shift is None else shift.direction
    length = np.maximum((motion**2).sum(axis=0), 1e-12)
    scale, acts_like = _motion_shown(function)
    amount = scale * (diagnosis.fit.residual[diagnosis.screening.screened].T * motion).sum(axis=0) / length
    first = function.covariates[0]
    values, name = _followed(diagnosis, first) if shift is None else (shift.force, f"{in_a_sentence(first)}, N")
    if len(function.covariates) == 1:
        axes.scatter(values, amount, s=12, color=MODEL)
    else:
        other, second = _followed(diagnosis, function.covariates[1])
        edges = np.quantile(other, [0, 1 / 3, 2 / 3, 1])
        for (colour, marker), low, high in zip(BANDS, edges, edges[1:], strict=False):
            band = (other >= low) & (other <= high)
            label = f"{second} from {low:.3g} to {high:.3g}"
            axes.scatter(values[band], amount[band], s=14, color=colour, marker=marker, label=label)
    limit = float(np.quantile(np.abs(amount), 0.98))
    axes.set_ylim(-1.3 * limit, 1.3 * limit)
    title = f"Structure of the residuals: {function_name(function)}"
    finish(axes, name, f"acts like a {acts_like}", title, legend=len(function.covariates) > 1)


def _motion_shown(function: FreeFunction) -> tuple[float, str]:
    """Factor to the unit that is shown, and the motion in words with that unit."""
    if function.shift is not None:
        return 1e3, f"shift of {place_of(function)} along that force, mm"
    if function.joint is not None:
        return float(np.degrees(1.0)), f"turn of {place_of(function)}, deg"
    if function.common is CommonMode.YIELDING:
        return 1.0, f"change of {place_of(function)}, rad/N·m"
    return 100.0, f"change of {place_of(function)}, %"


def _followed(diagnosis: Diagnosis, variable: ExplanatoryVariable) -> tuple[Array, str]:
    """Values of a variable at the poses that were screened, and its label; `before`: at the pose measured before."""
    torque, variable_after = diagnosis.fit.equilibrium.joint_torque, replace(variable, before=False)
    every = (*covariates(diagnosis.data, torque), Covariate("total torque", np.abs(torque).sum(axis=1)))
    shown = next(covariate.shown for covariate in every if covariate.variable == variable_after)
    screened, label = diagnosis.screening.screened, axis_label(variable_after)
    if variable_after == variable:
        return shown[screened], label
    return np.concatenate([shown[:1], shown[:-1]])[screened], f"{label}, at the pose before"
